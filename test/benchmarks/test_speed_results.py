# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The speed benchmark's fronts, ratios, growth, goals, tables, files and command."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.__main__ import app_of
from benchmarks.goals import Verdict
from benchmarks.speed.benchmark import SpeedResults, plan, run_speed
from benchmarks.speed.equality import Check
from benchmarks.speed.fronts import Point, cost, front, ratios
from benchmarks.speed.goals import verdicts
from benchmarks.speed.own_peer import own_peer
from benchmarks.speed.pinocchio_peer import PINOCCHIO
from benchmarks.speed.result import RunResult
from benchmarks.speed.scaling import Growth, growth
from benchmarks.speed.tick import (
    MJ_STEP,
    SEE,
    TickTime,
    tick_times,
)


def result(peer: str, error: float, cpu_s_per_s: float, problem: str = "five_bar") -> RunResult:
    return RunResult(problem, peer, "rk4", 1e-3, {}, error, "", (cpu_s_per_s,))


def outcomes(found: tuple[Verdict, ...]) -> dict[str, str]:
    return {verdict.goal: verdict.outcome for verdict in found}


def test_a_front_leaves_out_what_is_neither_cheaper_nor_better() -> None:
    results = [
        result("a", 1e-2, 1.0),
        result("a", 1e-1, 2.0),
        result("a", 1e-4, 3.0),
        result("b", 0.0, 0.1),
    ]
    assert front(results, "a") == (Point(1e-2, 1.0), Point(1e-4, 3.0))


def test_between_points_a_rule_of_order_four_costs_what_it_should() -> None:
    # error = cpu^-4, so that an error costs error^(-1/4).
    points = [Point(cpu**-4, cpu) for cpu in (1.0, 3.0, 17.0, 300.0)]
    for target in (1e-2, 1e-4, 1e-8):
        assert cost(points, target) == pytest.approx(target**-0.25, rel=1e-12)


def test_nothing_is_extrapolated() -> None:
    points = [Point(1e-3, 1.0), Point(1e-5, 10.0)]
    assert cost(points, 1e-6) is None
    assert cost(points, 1e-5) == pytest.approx(10.0)
    # What is better than asked for from the start costs what it costs.
    assert cost(points, 1e-1) == 1.0
    assert cost([], 1.0) is None


def test_ratios_are_against_the_best_of_the_others() -> None:
    results = [
        result("hapticmech", 1e-9, 2.0),
        result("mujoco", 1e-5, 1.0),
        result("pinocchio", 1e-7, 8.0),
    ]
    found = {ratio.target: ratio for ratio in ratios(results, "hapticmech")}
    assert (found[1e-4].value, found[1e-4].best_peer) == (pytest.approx(2.0), "mujoco")
    assert (found[1e-6].value, found[1e-6].best_peer) == (pytest.approx(0.25), "pinocchio")
    assert found[1e-8].value is None
    assert found[1e-8].ours == pytest.approx(2.0)


def test_goals_are_met_missed_or_not_measured() -> None:
    nothing = verdicts((), (), ())
    assert {verdict.outcome for verdict in nothing} == {"not measured"}
    fast = [result("hapticmech", 1e-9, 1.0), result("mujoco", 1e-9, 3.5)]
    slow = [result("hapticmech", 1e-9, 1.0), result("mujoco", 1e-9, 2.0)]
    slower = [result("hapticmech", 1e-9, 1.0), result("mujoco", 1e-9, 0.5)]
    blunt = [result("hapticmech", 1e-3, 1.0), result("mujoco", 1e-9, 0.5)]
    alone = [result("hapticmech", 1e-9, 1.0)]
    for results, coarse, fine in (
        (fast, "pass", "pass"),
        (slow, "FAIL", "pass"),
        (slower, "FAIL", "FAIL"),
        (blunt, "FAIL", "FAIL"),
        (alone, "not measured", "not measured"),
    ):
        found = outcomes(verdicts(results, (), ()))
        assert found["five_bar at 1e-06: 3 x less CPU time than any peer"] == coarse
        assert found["five_bar at 1e-08: no peer is faster"] == fine


def test_goals_of_ticks_growth_and_the_large_row() -> None:
    ticks = [TickTime(name, time, time, time) for name, time in ((SEE, 2.0), (MJ_STEP, 1.0))]
    sizes = (10, 80)
    grown = [
        Growth("windows", "hapticmech", "rk4", sizes, (1.0, 8.0)),
        Growth("chain", "hapticmech", "rk4", sizes, (1.0, 64.0)),
        Growth("chain", "mujoco", "rk4", sizes, (1.0, 8.0)),
    ]
    large = [
        result("hapticmech", 1e-7, 1.0, "n_four_bar_40"),
        result("mujoco", 1e-5, 0.5, "n_four_bar_40"),
        result("mujoco", 1e-6, 2.0, "n_four_bar_40"),
    ]
    found = verdicts(large, grown, ticks)
    seen = {verdict.goal.split(":")[0]: verdict.outcome for verdict in found}
    assert outcomes(found)["five-bar: a tick at most 2.5 x mj_step"] == "pass"
    assert seen["A02, N parallelograms"] == "pass"
    assert seen["chain of N rods"] == "FAIL"
    # MuJoCo gets to 7.6e-6 between its two runs, in less than our second.
    assert seen["n_four_bar_40"] == "FAIL"


def test_growth_is_timed_with_who_passes_the_check() -> None:
    sizes = {"windows": (3,), "chain": (3,), "platform": (6,)}
    grown, checks = growth((own_peer(), PINOCCHIO), sizes, repeats=1, budget_s=0.01)
    assert all(check.passed for check in checks)
    assert {one.family for one in grown} == set(sizes)
    assert all(cpu is not None for one in grown for cpu in one.cpu_s_per_step)


def test_a_tick_is_timed_beside_others_that_agree() -> None:
    assert {SEE, MJ_STEP} <= {tick.name for tick in tick_times(rounds=1)}


def test_results_are_sound_if_each_peer_has_one_method_that_passes() -> None:
    passed, failed = Check("a", "mujoco", "x"), Check("a", "mujoco", "y", reason="no")
    unsuitable = Check("b", "mujoco", "x", reason="no", suitable=False)
    assert SpeedResults({}, {}, (passed, failed, unsuitable)).sound
    assert not SpeedResults({}, {}, (failed,)).sound
    assert not SpeedResults({}, {}, (Check("a", "hapticmech", "rk4", reason="no"),)).sound


def test_a_run_leaves_tables_numbers_and_a_picture(tmp_path: Path) -> None:
    chosen = plan(["pendulum"], ["pinocchio"], repeats=1, quick=True)
    told: list[str] = []
    results = run_speed(chosen, told.append)
    results.write(tmp_path)
    assert told
    assert results.sound
    document = json.loads((tmp_path / "bench_speed.json").read_text(encoding="utf-8"))
    assert {entry["peer"] for entry in document["results"]} == {"hapticmech", "pinocchio"}
    assert {entry["target"] for entry in document["ratios"]} == {1e-4, 1e-6, 1e-8}
    table = (tmp_path / "bench_speed.md").read_text(encoding="utf-8")
    for title in ("equality", "CPU time at equal error", "runs that were timed", "goals"):
        assert title in table
    assert (tmp_path / "bench_speed.png").stat().st_size > 10_000


def test_the_command_checks_equality_alone(tmp_path: Path) -> None:
    words = ["speed", "--smoke", "--scenes", "five_bar", "--peers", "mujoco,pinocchio"]
    found = CliRunner().invoke(app_of(), [*words, "--json", "--out", str(tmp_path)])
    assert found.exit_code == 0, found.output
    document = json.loads(found.stdout.splitlines()[-1])
    assert document["results"] == []
    assert all(check["passed"] for check in document["checks"])
    assert {check["peer"] for check in document["checks"]} == {"hapticmech", "mujoco", "pinocchio"}
    assert not (tmp_path / "bench_speed.png").exists()
