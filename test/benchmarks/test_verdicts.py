# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Goals: met by runs made to meet them, and each missed by the run that misses it alone."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from benchmarks.graph.checks import Check
from benchmarks.graph.comparison import Comparison, compare, verdicts
from benchmarks.graph.plan import Configuration
from benchmarks.graph.run import Run
from benchmarks.graph.statuses import RATE, ROUND_TRIP, latency
from hapticmech_ros.analysis.study import plain
from hapticmech_ros.wire.topics import DEVICE

from .conftest import COMPOSED, SEPARATE, MakeRun


def compared(runs: list[Run], configuration: Configuration = SEPARATE) -> Comparison:
    return compare(configuration, runs, "handle")


def failing(*comparisons: Comparison) -> list[str]:
    return [verdict.goal for verdict in verdicts(comparisons) if verdict.outcome == "FAIL"]


def test_good_runs_meet_every_goal(make_run: MakeRun) -> None:
    separate = compared([make_run("real"), make_run("bare")])
    composed = compared([make_run(k, COMPOSED) for k in ("real", "bare")], COMPOSED)
    found = verdicts([separate, composed])
    assert {verdict.outcome for verdict in found} == {"pass"}
    assert len({verdict.goal for verdict in found}) == len(found)


def test_what_was_not_run_is_neither_met_nor_missed(make_run: MakeRun) -> None:
    assert {verdict.outcome for verdict in verdicts([])} == {"not measured"}
    other = Configuration(500.0, "separate", True)
    elsewhere = compared([make_run(kind, other) for kind in ("real", "bare")], other)
    assert {verdict.outcome for verdict in verdicts([elsewhere])} == {"not measured"}


@pytest.mark.parametrize(
    ("changes", "goals"),
    [
        ({"lost": 1}, ["no control message lost"]),
        ({"rate_hz": 998.9}, ["1000 ± 1 Hz"]),
        ({"missed": 201}, ["deadlines missed"]),
        ({"latency_us": 40.1}, ["p50 of"]),
        ({"latency_us": 60.1}, ["p50 of", "p99 of"]),
    ],
)
def test_each_goal_can_be_missed_alone(
    make_run: MakeRun, changes: dict[str, float], goals: list[str]
) -> None:
    # The first run is good: one bad run is enough; deadlines are counted over both together.
    runs = [make_run("real"), make_run("real", repeat=2, **changes)]
    if "latency_us" in changes:
        runs = runs[1:]
    missed = failing(compared([*runs, make_run("bare")]))
    assert len(missed) == len(goals)
    for goal, words in zip(missed, goals, strict=True):
        assert words in goal


def test_limits_themselves_are_good_enough(make_run: MakeRun) -> None:
    real = make_run("real", rate_hz=999.0, missed=100, latency_us=40.0)
    assert failing(compared([real, make_run("bare")])) == []


def test_goals_are_of_the_graph_as_shipped_whatever_else_was_run(make_run: MakeRun) -> None:
    other = replace(SEPARATE, transport="middleware")
    slow = compared([make_run("real", other, latency_us=900.0), make_run("bare", other)], other)
    shipped = compared([make_run("real"), make_run("bare")])
    assert failing(slow, shipped) == []
    assert {verdict.outcome for verdict in verdicts([slow])} == {"not measured"}


def test_the_composed_graph_may_not_use_more_than_its_share(make_run: MakeRun) -> None:
    runs = [make_run("real", COMPOSED, cpu=71.0), make_run("bare", COMPOSED)]
    (missed,) = failing(compared(runs, COMPOSED))
    assert "70 %" in missed


def test_runs_that_fail_their_checks_meet_no_goal_in_silence(make_run: MakeRun) -> None:
    broken = make_run("real", checks=(Check("the mechanism never fails", False, "3 failures"),))
    assert not broken.sound
    comparison = compared([broken, make_run("bare")])
    assert comparison.real.failures == ("run 1: the mechanism never fails: 3 failures",)
    assert ["passes its checks" in goal for goal in failing(comparison)] == [True]


def test_a_run_without_figures_leaves_the_others_standing(make_run: MakeRun) -> None:
    dead = Run(make_run("real", repeat=2).step, failure="haptic_device ended by itself")
    comparison = compared([make_run("real"), dead, make_run("bare")])
    assert "ended by itself" in comparison.real.failures[0]
    assert comparison.real.figures[f"{DEVICE}: {RATE}"] == 1000.0
    text = comparison.sheet().markdown()
    assert "| runs that passed all checks | 1 of 2 | 1 of 1 |" in text
    assert "ended by itself" in text
    alone = compared([dead])
    assert alone.real.figures == {}
    assert "pass" not in {verdict.outcome for verdict in verdicts([alone])}
    json.dumps(plain([comparison, alone]), allow_nan=False)


def test_ratios_are_of_medians_over_runs(make_run: MakeRun) -> None:
    runs = [make_run("real", repeat=n, latency_us=us) for n, us in enumerate((200, 300, 900), 1)]
    runs += [make_run("bare", repeat=n, latency_us=us) for n, us in enumerate((90, 100, 500), 1)]
    for one in ("p50", "p90", "p99", "max"):
        assert compared(runs).ratio(latency(ROUND_TRIP, one)) == 3.0
    assert compared(runs).ratio("what nobody measured") is None


def test_graphs_that_do_not_say_the_same_are_not_alike(make_run: MakeRun) -> None:
    smaller = replace(make_run("bare"), sizes={"/device/state": 300})
    comparison = compared([make_run("real"), smaller])
    assert comparison.alike is not None
    assert not comparison.alike.held
    assert "308 and 300" in comparison.alike.seen
    alike = compared([make_run("real"), make_run("bare")]).alike
    assert alike is not None
    assert alike.held
