# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is shown: failures are told, and the picture and the JSON take every kind of run."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from rich.console import Console

from benchmarks.goals import goal_sheet
from benchmarks.graph.benchmark import ANSWERING
from benchmarks.graph.checks import Check
from benchmarks.graph.comparison import Comparison, compare
from benchmarks.graph.goals import verdicts
from benchmarks.graph.plan import Configuration
from benchmarks.graph.report import configuration_sheets, drawn
from benchmarks.graph.run import Run
from hapticmech_ros.analysis.study import plain
from hapticmech_ros.experiment.figure_style import save

from .conftest import COMPOSED, SEPARATE, MakeRun


@pytest.fixture
def comparisons(make_run: MakeRun) -> list[Comparison]:
    wrong = make_run("real", lost=7, checks=(Check("no message is refused", False, "12 refused"),))
    dead = Configuration(4000.0, "separate", True)
    runs = [wrong, make_run("bare")]
    runs += [make_run(kind, COMPOSED) for kind in ("real", "bare")]
    runs += [Run(make_run(kind, dead).step, failure="never engaged") for kind in ("real", "bare")]
    return [compare(c, runs, ANSWERING, "handle") for c in (SEPARATE, COMPOSED, dead)]


def test_what_failed_is_said(comparisons: list[Comparison]) -> None:
    shown = io.StringIO()
    console = Console(width=160, file=shown)
    for comparison in comparisons:
        for sheet in configuration_sheets(comparison):
            console.print(sheet)
    console.print(goal_sheet(verdicts(comparisons)))
    text = shown.getvalue()
    for words in ("7 of 20000", "12 refused", "never engaged", "FAIL", "pass"):
        assert words in text
    assert text.count("FAIL") == sum(v.outcome == "FAIL" for v in verdicts(comparisons))


def test_results_are_json_without_infinities(comparisons: list[Comparison]) -> None:
    text = json.dumps(plain(comparisons), allow_nan=False)
    assert len(json.loads(text)) == len(comparisons)


def test_the_picture_is_drawn_also_of_runs_without_figures(
    comparisons: list[Comparison], tmp_path: Path
) -> None:
    for number in range(1, len(comparisons) + 1):
        path = save(drawn(comparisons[-number:], 20.0, 2), tmp_path / f"{number}.png")
        assert path.read_bytes().startswith(b"\x89PNG")
