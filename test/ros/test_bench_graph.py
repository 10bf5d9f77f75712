# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The graph's benchmark over real nodes: what it reports hangs together. Nothing here is timed."""

from __future__ import annotations

import json
import os
from dataclasses import astuple
from pathlib import Path

import pytest

from benchmarks.graph.bare_node import PHASES
from benchmarks.graph.benchmark import GraphResults, run_benchmark
from benchmarks.graph.checks import Expected
from benchmarks.graph.plan import Configuration, Plan, Step
from benchmarks.graph.run import Run, measure
from benchmarks.graph.statuses import ANSWERS, SAID_HOPS
from hapticmech_ros.graph import private_environment
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.nodes.haptic_device import HapticDevice
from hapticmech_ros.nodes.mechanism_simulator import MechanismSimulator
from hapticmech_ros.wire.topics import ANALYSER, CONTROLLER, DEVICE, MECHANISM
from ros.harness import RATE
from sampling import long_ones

pytestmark = pytest.mark.ros

SECONDS = 2.0
# Figures are said once a second and rates are taken between them: to a sample or two at each end.
SLACK_HZ = 2.0


@pytest.fixture
def alone(domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in private_environment(domain).items():
        monkeypatch.setitem(os.environ, name, value)
    # Nothing is timed.
    monkeypatch.setattr("benchmarks.graph.run.SETTLES_S", 0.5)


def run(out: Path, layout: str) -> tuple[GraphResults, list[str]]:
    plan = Plan("five_bar", (RATE,), (layout,), (True,), SECONDS, 1)  # type: ignore[arg-type]
    told: list[str] = []
    results = run_benchmark(plan, out, told.append)
    results.write(out)
    return results, told


def conserves(run: Run) -> None:
    """Assert what no machine, however slow, can break."""
    assert run.failure == ""
    assert run.window_s >= SECONDS
    for kept in run.clocked.values():
        assert 0 <= kept.missed <= kept.periods
        assert 0.0 < kept.rate_hz <= RATE + SLACK_HZ
    for node, clocked in ((CONTROLLER, DEVICE), (ANALYSER, MECHANISM)):
        # Figures of two nodes are of different moments: rates may differ while they change.
        assert 0.0 < run.answers_hz[node] <= RATE + SLACK_HZ
        assert clocked in run.clocked
    for latency in run.said.values():
        values = astuple(latency)
        assert values[0] > 0.0
        assert list(values) == sorted(values)
    assert run.load is not None
    assert all(0.0 <= share <= os.cpu_count() for share in run.load.cpu.values())  # type: ignore[operator]
    assert 0.0 <= run.load.busy <= 1.0
    assert run.recorded is not None
    for part in run.recorded.losses.values():
        # The bare graph's losses are told like the real one's: never more answers than samples.
        assert 0 < part.answered <= part.asked
        assert part.lost == part.asked - part.answered


def says_the_same(results: GraphResults) -> None:
    """Assert that the bags of both graphs have the same in them."""
    (comparison,) = results.comparisons
    assert comparison.alike is not None
    assert comparison.alike.held, comparison.alike.seen


def test_both_graphs_are_run_and_written_down(alone: None, tmp_path: Path) -> None:
    results, told = run(tmp_path, "separate")
    assert [one.step.kind for one in results.runs] == ["real", "bare"]
    assert sum("graph, run" in line for line in told) == 2
    for one in results.runs:
        conserves(one)
        assert set(one.said) == set(SAID_HOPS)
        assert set(one.answers_hz) == set(ANSWERS)
        assert one.load is not None
        assert {*NODES, "probe", "recorder"} == set(one.load.cpu)
    says_the_same(results)
    assert not (tmp_path / "bag").exists()
    assert results.machine["rmw"] == "rmw_fastrtps_cpp"
    document = json.loads((tmp_path / "bench_graph.json").read_text())
    assert document["sound"] == results.sound
    assert len(document["runs"]) == 2
    assert (tmp_path / "bench_graph.png").stat().st_size > 0
    # What the nodes printed as they ended is kept, not shown.
    log = (tmp_path / "nodes.log").read_text()
    lines = [line.partition(": ")[0] for line in log.splitlines()]
    wanted = [*NODES, *(f"bare {name}" for name in NODES)]
    assert [name for name in wanted if name not in lines] == [], log


@long_ones
def test_both_graphs_in_one_process_say_the_same(alone: None, tmp_path: Path) -> None:
    results, _ = run(tmp_path, "composed")
    for one in results.runs:
        conserves(one)
        assert one.load is not None
        assert {"composed", "recorder", "probe"} == set(one.load.cpu)
    says_the_same(results)


def test_the_bare_graph_keeps_the_real_ones_phases() -> None:
    assert {actor.name: actor.phase for actor in (HapticDevice, MechanismSimulator)} == PHASES


def test_a_graph_that_does_not_start_is_a_result(
    alone: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A module that says something else and ends.
    monkeypatch.setattr("benchmarks.graph.run.BARE", "this")
    step = Step(Configuration(RATE, "composed", False), 1, "bare")
    nothing = Expected((), (), False)
    found = measure(step, tmp_path / "scene.yaml", "handle", SECONDS, tmp_path, nothing)
    assert "ended by itself" in found.failure
    assert not found.sound
    assert found.said == {}
