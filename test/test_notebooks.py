# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The notebooks of examples/: each runs from its first cell to its last, and was saved unrun."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from commands import printed_by
from sampling import sampled

FOLDER = Path(__file__).resolve().parents[1] / "examples" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def cells_of(path: Path) -> list[dict[str, Any]]:
    book = json.loads(path.read_text(encoding="utf-8"))
    assert (book["nbformat"], book["metadata"]["kernelspec"]["name"]) == (4, "python3")
    cells: list[dict[str, Any]] = book["cells"]
    return cells


@pytest.mark.parametrize("path", sampled(NOTEBOOKS, every=2), ids=lambda path: path.stem)
def test_a_notebook_runs_in_order(path: Path, tmp_path: Path) -> None:
    code = ["".join(cell["source"]) for cell in cells_of(path) if cell["cell_type"] == "code"]
    assert len(code) >= 3
    script = tmp_path / "cells.py"
    script.write_text("import matplotlib\nmatplotlib.use('agg')\n" + "\n\n".join(code))
    assert printed_by(script, cwd=FOLDER, timeout=300.0)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_explains_itself_and_has_no_results_in_it(path: Path) -> None:
    cells = cells_of(path)
    assert cells[0]["cell_type"] == "markdown"
    assert cells[0]["source"][0].startswith("# ")
    assert len({cell["id"] for cell in cells}) == len(cells)
    for cell in cells:
        if cell["cell_type"] == "code":
            assert not cell["outputs"]
            assert cell["execution_count"] is None


def test_there_are_three() -> None:
    assert len(NOTEBOOKS) == 3
