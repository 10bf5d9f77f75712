# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Faults at 250 Hz, in a file of its own: two graphs at once are too much for two cores."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator

import pytest

from benchmarks.reliability.kills import try_kill
from benchmarks.reliability.rig import MS, Rig, pushing
from hapticmech_ros.nodes.entry import NODES
from ros.harness import next_domain
from ros.test_reliability import survived

pytestmark = [pytest.mark.ros, pytest.mark.alone]


@pytest.fixture(scope="module")
def slow(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """A graph at 250 Hz."""
    out = tmp_path_factory.mktemp("slow")
    with Rig(out, "slow", domain=next_domain(), clean=False, rate=250.0) as rig:
        yield rig


@pytest.mark.parametrize("node", NODES)
def test_a_kill_at_250_hz(slow: Rig, node: str) -> None:
    trials = (try_kill(slow, node) for _ in range(10))
    trial = next((one for one in trials if one is not None), None)
    assert trial is not None
    assert trial.zero_goal_s == 0.08
    survived(trial)


@pytest.mark.parametrize("node", NODES)
def test_a_pause_of_20_ms_does_not_end_rendering_at_250_hz(slow: Rig, node: str) -> None:
    for _ in range(10):
        since, pid = slow.ready(), slow.pid(node)
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
    found = slow.samples(since)
    assert len(found) > 50
    assert pushing(found).all()
