# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The campaign's short form: a few faults of each kind against one graph of real nodes.

In full, with limits on force and time of return: `make campaign`, docs/reliability.md.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from contextlib import closing
from functools import partial

import pytest

from benchmarks.reliability.caller import Caller
from benchmarks.reliability.clocks import try_step
from benchmarks.reliability.doubles import KINDS, try_double
from benchmarks.reliability.emergency import WAYS_MS, try_stop
from benchmarks.reliability.freezes import try_freeze
from benchmarks.reliability.kills import try_kill
from benchmarks.reliability.rig import MS, Rig, pushing
from benchmarks.reliability.stepped_clock import SteppedClock
from benchmarks.reliability.trial import Trial
from hapticmech_ros.nodes.entry import NODES
from ros.harness import RATE, next_domain
from sampling import sampled

pytestmark = pytest.mark.alone
# A stale tie or two masters pull with 4 N and more; engaging on a busy machine, with 1 N.
PEAK_N = 2.0


class Graph:
    """A graph whose clock is stepped, watched on all topics."""

    def __init__(self, rig: Rig, clock: SteppedClock) -> None:
        self.rig = rig
        self.clock = clock


@pytest.fixture(scope="module")
def graph(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Graph]:
    out = tmp_path_factory.mktemp("reliability")
    with SteppedClock(out) as clock:
        hosts = [(tuple(NODES), clock)]
        domain = next_domain()
        with Rig(
            out, "short", hosts, all_topics=True, domain=domain, clean=False, rate=RATE
        ) as rig:
            yield Graph(rig, clock)


def survived(trial: Trial) -> None:
    """Assert what a machine that is busy cannot change."""
    assert trial.zero_s <= trial.zero_goal_s, trial.line
    assert trial.came_back, trial.line
    assert trial.stale == 0, trial.line
    assert trial.peak < PEAK_N, trial.line
    assert trial.said, trial.line
    assert trial.alive, trial.line


@pytest.mark.parametrize("seconds", [-5.0, 600.0, -600.0])
def test_a_step_of_the_machines_clock(graph: Graph, seconds: float) -> None:
    survived(try_step(graph.rig, graph.clock, seconds, "machine's clock"))


@pytest.mark.parametrize(("seconds", "at_once"), [(-600.0, True), (5.0, False)])
def test_an_emergency_stop_after_a_step(graph: Graph, seconds: float, at_once: bool) -> None:
    with closing(Caller(graph.rig.environment)) as caller:
        stop = try_stop(graph.rig, caller, "a step", partial(graph.clock.step, seconds), at_once)
    assert stop.success, stop
    assert stop.zero_ms <= WAYS_MS, stop


@pytest.mark.parametrize("kind", sampled(KINDS, every=2), ids=lambda kind: kind.name)
def test_a_double(graph: Graph, kind: object) -> None:
    # The graph's own node and the double by turns are there first.
    survived(try_double(graph.rig, kind, before=KINDS.index(kind) % 2 == 0))


@pytest.mark.parametrize("node", NODES)
def test_a_kill(graph: Graph, node: str) -> None:
    # None where nobody heard the device's first output after it.
    trials = (try_kill(graph.rig, node) for _ in range(10))
    trial = next((one for one in trials if one is not None), None)
    assert trial is not None
    # 20 periods.
    assert trial.zero_goal_s == 0.08
    survived(trial)


@pytest.mark.parametrize("node", NODES)
def test_a_freeze(graph: Graph, node: str) -> None:
    survived(try_freeze(graph.rig, node, 0.2))


@pytest.mark.parametrize("node", NODES)
def test_a_pause_of_20_ms_does_not_end_rendering(graph: Graph, node: str) -> None:
    for _ in range(10):
        since, pid = graph.rig.ready(), graph.rig.pid(node)
        begun_ns = time.monotonic_ns()
        os.kill(pid, signal.SIGSTOP)
        time.sleep(0.02)
        os.kill(pid, signal.SIGCONT)
        lasted_ns = time.monotonic_ns() - begun_ns
        time.sleep(0.3)
        # Unless this process itself was kept waiting meanwhile.
        if lasted_ns < 25 * MS:
            break
    assert lasted_ns < 25 * MS
    found = graph.rig.samples(since)
    assert len(found) > 50
    assert pushing(found).all()
