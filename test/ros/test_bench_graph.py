# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The graph's benchmark over real nodes: what it reports hangs together. Nothing here is timed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.graph.benchmark import run_benchmark
from benchmarks.graph.plan import Plan
from benchmarks.graph.recorded import ASKED, LOST
from benchmarks.graph.run import STOLEN, Run, processor_share
from benchmarks.graph.statuses import ANSWERS, MISSED, PERCENTILES, SAID_HOPS, latency
from benchmarks.graph.statuses import RATE as RATE_OF
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.wire.topics import DEVICE, MECHANISM
from ros.harness import RATE

SECONDS = 2.0
# Figures are said once a second and rates are taken between them: to a sample or two at each end.
SLACK_HZ = 2.0


@pytest.fixture
def alone(in_domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    # Nothing is timed.
    monkeypatch.setattr("benchmarks.graph.run.SETTLES_S", 0.5)


def conserves(run: Run) -> None:
    """Assert what no machine, however slow, can break."""
    assert run.failure == ""
    found = run.figures
    for node in (DEVICE, MECHANISM):
        assert 0.0 <= found[f"{node}: {MISSED}"] <= 100.0
        assert 0.0 < found[f"{node}: {RATE_OF}"] <= RATE + SLACK_HZ
    for node in ANSWERS:
        # Figures of two nodes are of different moments: rates may differ while they change.
        assert found[f"{node}: samples answered, %"] > 0.0
    for hop in SAID_HOPS:
        values = [found[latency(hop, one)] for one in PERCENTILES]
        assert values[0] > 0.0
        assert values == sorted(values)
    assert 0.0 <= found[STOLEN] <= 100.0
    lost = {name: value for name, value in found.items() if name.endswith(f": {LOST}")}
    assert len(lost) == 3
    for name, value in lost.items():
        # The bare graph's losses are told like the real one's: never more than samples.
        assert 0 <= value < found[name.replace(LOST, ASKED)]


def processes(run: Run) -> set[str]:
    """Return the processes whose processor time is known."""
    known = {*NODES, "composed", "probe", "recorder"}
    return {name for name in known if processor_share(name) in run.figures}


def test_both_graphs_are_run_and_written_down(alone: None, tmp_path: Path) -> None:
    plan, told = Plan("five_bar", (RATE,), ("separate",), (True,), SECONDS, 1), []
    results = run_benchmark(plan, tmp_path, told.append)
    results.write(tmp_path)
    assert [one.step.kind for one in results.runs] == ["real", "bare"]
    assert sum("graph, run" in line for line in told) == 2
    for one in results.runs:
        conserves(one)
        assert {*NODES, "probe", "recorder"} == processes(one)
    # The bags of both graphs have the same in them.
    (comparison,) = results.comparisons
    assert comparison.alike.held, comparison.alike.seen
    assert not (tmp_path / "bag").exists()
    assert results.machine["rmw"] == "rmw_fastrtps_cpp"
    document = json.loads((tmp_path / "bench_graph.json").read_text())
    assert document["sound"] == results.sound
    assert len(document["runs"]) == 2
    # What the nodes printed as they ended is kept, not shown.
    log = (tmp_path / "nodes.log").read_text()
    lines = [line.partition(": ")[0] for line in log.splitlines()]
    wanted = [*NODES, *(f"bare {name}" for name in NODES)]
    assert [name for name in wanted if name not in lines] == [], log
