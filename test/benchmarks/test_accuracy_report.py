# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The accuracy benchmark's plan, tables, picture, files and command."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.__main__ import app_of
from benchmarks.accuracy import cases
from benchmarks.accuracy.endurance import LongRun, LongRuns
from benchmarks.accuracy.run import (
    Run,
)

from .conftest import falling

LIBRARY = {case.name: case for case in cases()}


FAILED = Run("stone", "linearly_implicit", 1e-3, "m", False, failure="KeyError: [not] there")
PASSED = Run(
    "stone",
    "rk4",
    5e-4,
    "m",
    own=True,
    errors={"p": 2e-10},
    kept=True,
    energy_error=3e-9,
    closure_error=1e-14,
    rank=4,
    rank_changes=3,
    unexpected_ranks=1,
    singular_times=2,
    cpu_s_per_s=0.1,
)


def test_the_command_prints_json_and_nothing_else(tmp_path: Path) -> None:
    words = ["accuracy", "--cases", "bricard", "--integrators", "rk4", "--steps", "20"]
    figure = tmp_path / "picture.png"
    found = CliRunner().invoke(
        app_of(), [*words, "--json", "--out", str(tmp_path), "--figure", str(figure)]
    )
    assert found.exit_code == 0, found.output
    (run,) = json.loads(found.stdout)["runs"]
    assert (run["case"], run["step"]) == ("bricard", 0.02)
    assert 1e-9 < run["error"] < 1e-2
    assert figure.exists()


def test_the_command_fails_where_a_case_misses_its_tolerance(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    strict = replace(falling(), outputs=tuple(replace(o, tolerance=0.0) for o in falling().outputs))
    monkeypatch.setattr("benchmarks.accuracy.run.cases", lambda: (strict,))
    words = ["accuracy", "--integrators", "rk4", "--steps", "1", "--out", str(tmp_path)]
    assert CliRunner().invoke(app_of(), words).exit_code == 1


@pytest.mark.parametrize("failure", ["", "ClosureError: came apart"])
def test_the_long_command_writes_its_runs_and_fails_with_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failure: str
) -> None:
    seen = LongRun("bricard", 3600.0, 12.0, failure, 1e-9, 2e-9, 1e-14, (4,), None, 0.1)
    place = "benchmarks.accuracy.endurance"
    monkeypatch.setattr(f"{place}.hour_of", lambda case, show: seen)
    monkeypatch.setattr(f"{place}.minute_of_windows", lambda show: replace(seen, off_branch=0.0))
    words = ["accuracy", "--long", "--json", "--out", str(tmp_path)]
    found = CliRunner().invoke(app_of(), words)
    assert found.exit_code == (1 if failure else 0)
    document = json.loads(found.stdout)
    assert document == json.loads((tmp_path / "bench_accuracy_long.json").read_text("utf-8"))
    assert [run["off_branch"] for run in document["runs"]] == [0.0, None]
    (sheet,) = LongRuns({}, (seen,)).sheets()
    assert sheet.rows[0][-1] == failure
