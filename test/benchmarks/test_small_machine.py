# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The demo on a small machine: what passes, what does not, and what the command makes of it."""

from __future__ import annotations

import copy
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from benchmarks.__main__ import app_of
from benchmarks.small_machine import benchmark
from benchmarks.small_machine.demo_run import (
    FIGURES,
    LOST,
    NOMINAL,
    DemoRun,
    faults,
    watch_demo,
)

# What a run that is right writes, in round numbers.
RIGHT: dict[str, Any] = {
    "constraints": {
        "changes": [{"time_s": 2.3, "from": 1, "to": 2}],
        "while_held": [
            {"count": 1, "force_gain_median": 1.003},
            {"count": 2, "force_gain_median": 1.0},
        ],
    },
    "agreement": {
        "count_change_difference_max_s": 0.001,
        **{
            f"{body}_deviation_max_{unit}": 0.1
            for body in ("device", "point")
            for unit in ("mm", "deg")
        },
    },
    "graph": {
        "measured_rate_hz": 999.0,
        "missed_deadlines": 4,
        "loop_latency_p50_us": 130.0,
        "loop_latency_p99_us": 900.0,
    },
}
# Writes what it is told to beside a bag, says a word, and ends as it is told to.
PROGRAM = """
import json, pathlib, sys, time
out, summary, files, seconds, code = sys.argv[1], *map(json.loads, sys.argv[2:])
out = pathlib.Path(out)
(out / "bag").mkdir()
for name in files:
    (out / name).write_text(json.dumps(summary))
print("starting the graph", flush=True)
print("error: as it was told to", end="\\n\\n", file=sys.stderr, flush=True)
time.sleep(seconds)
sys.exit(code)
"""
WRITTEN = [*FIGURES, "summary.json"]
PASSED = DemoRun(20.0, (), "results: demo", {"nominal_rate_hz": 1000.0, "recorder_lost": 0})
FAILED = DemoRun(35.0, ("exit code 1",), "error: the hand did not start")


def changed(*path: str | int, value: object) -> dict[str, Any]:
    summary: Any = copy.deepcopy(RIGHT)
    place = summary
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return dict(summary)


def demo(
    out: Path,
    summary: object = RIGHT,
    files: Sequence[str] = WRITTEN,
    seconds: float = 0.0,
    code: int = 0,
) -> list[str]:
    told = [json.dumps(one) for one in (summary, files, seconds, code)]
    return [sys.executable, "-I", "-S", "-c", PROGRAM, str(out), *told]


@pytest.mark.parametrize(
    ("path", "value", "told"),
    [
        (("constraints", "changes"), [], "joint constraints change as"),
        (("constraints", "changes", 0, "to"), 3, "joint constraints change as"),
        (("constraints", "while_held", 1, "force_gain_median"), 0.97, "force with 2"),
        (("constraints", "while_held", 0, "force_gain_median"), None, "force with 1"),
        (("agreement", "count_change_difference_max_s"), 0.06, "0.060 s off"),
        (("agreement", "device_deviation_max_mm"), 0.6, "device: 0.6 mm"),
        (("agreement", "point_deviation_max_mm"), 0.6, "point: 0.6 mm"),
        (("agreement", "device_deviation_max_deg"), float("nan"), "device: nan deg"),
        (("agreement", "point_deviation_max_deg"), 0.6, "point: 0.6 deg"),
    ],
)
def test_each_fault_of_the_physics_is_told(
    path: tuple[str | int, ...], value: object, told: str
) -> None:
    (found,) = faults(changed(*path, value=value))
    assert told in found


def test_a_run_passes_and_its_figures_are_read(tmp_path: Path) -> None:
    out = tmp_path / "1"
    run = watch_demo(demo(out), out, 60.0)
    assert run.passed
    assert [run.figure(name) for name in benchmark.SHOWN] == [999.0, 4, 130.0, 900.0, None]
    # Summaries may not have these.
    assert run.figure(NOMINAL) is None
    assert run.figure(LOST) is None
    assert not (out / "bag").exists()
    assert run.seconds > 0.0
    graph = {**RIGHT["graph"], "nominal_rate_hz": 500.0, "recorder_lost": 3}
    run = watch_demo(demo(out, changed("graph", value=graph)), out, 60.0)
    assert (run.figure(NOMINAL), run.figure(LOST)) == (500.0, 3)
    graph["lockstep"] = True
    run = watch_demo(demo(out, changed("graph", value=graph)), out, 60.0)
    assert run.passed
    assert [run.figure(name) for name in (NOMINAL, *benchmark.SHOWN)] == [*[None] * 5, 3]


def test_a_run_that_fails_is_told_with_the_last_line_of_its_output(tmp_path: Path) -> None:
    out = tmp_path / "1"
    run = watch_demo(demo(out, code=3), out, 60.0)
    assert run.failures == ("exit code 3",)
    assert run.last_line == "error: as it was told to"
    assert "starting the graph" in (out / "output.log").read_text()
    # Figures of the run before do not count.
    run = watch_demo(demo(out, files=[*FIGURES[1:], "summary.json"]), out, 60.0)
    assert run.failures == ("no fig5a.png",)
    run = watch_demo(demo(out, files=FIGURES), out, 60.0)
    assert run.failures == ("no summary.json",)
    run = watch_demo(demo(out, changed("constraints", "changes", value=[])), out, 60.0)
    assert not run.passed
    assert run.figure("measured_rate_hz") == 999.0
    assert (out / "bag").is_dir()


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[Path]]:
    """Return what lets runs end one after the other as it is given."""

    def put(*found: DemoRun) -> list[Path]:
        left, folders = list(found), list[Path]()

        def watch(command: Sequence[str], out: Path, limit_s: float) -> DemoRun:
            folders.append(out)
            return left.pop(0)

        monkeypatch.setattr(benchmark, "watch_demo", watch)
        monkeypatch.setattr(benchmark, "places", list)
        monkeypatch.setattr(benchmark, "read_beside", lambda *given: (0.5, 0.5, 1.5))
        return folders

    return put


def command(out: Path, *options: str) -> tuple[int, str, dict[str, Any]]:
    given = ["small_machine", *options, "--out", str(out)]
    ended = CliRunner().invoke(app_of(["small_machine"]), given, env={"COLUMNS": "200"})
    return ended.exit_code, ended.output, json.loads((out / "bench_small_machine.json").read_text())


def test_a_failed_run_gives_exit_code_1_and_is_told(
    runs: Callable[..., list[Path]], tmp_path: Path
) -> None:
    runs(PASSED, FAILED)
    code, printed, document = command(tmp_path, "--runs", "2", "--loads", "alone")
    assert code == 1
    assert "alone, run 2: exit code 1; last line: error: the hand did not start" in printed
    assert document["sound"] is False
    assert [run["passed"] for run in document["loads"][0]["runs"]] == [True, False]


def test_a_program_that_reads_late_beside_the_graph_alone_gives_exit_code_1(
    runs: Callable[..., list[Path]], tmp_path: Path
) -> None:
    runs(PASSED, PASSED)
    code, printed, document = command(tmp_path, "--quick", "--loads", "busy")
    assert code == 0
    assert "0.50 (1.50)" in printed
    code, printed, document = command(tmp_path, "--quick", "--loads", "alone")
    assert code == 1
    assert document["loads"][0]["reads_s"] == [0.5, 0.5, 1.5]
