# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node's time goes on evenly whatever is done to the clock of the machine; a step is noticed."""

from __future__ import annotations

import itertools
import time

import pytest

from hapticmech_ros.nodes.node_time import STEP_NS, NodeTime, clock_step_text
from nodes.stand_ins import MS

S = 1000 * MS


class Machine:
    """Both clocks of a machine; each look at one takes a microsecond, or as long as is said."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.monotonic = 7 * S
        self.ahead = 1_700_000_000 * S
        self.pauses = itertools.repeat(1000)
        monkeypatch.setattr(time, "monotonic_ns", self.look_at_monotonic)
        monkeypatch.setattr(time, "time_ns", lambda: self.look_at_monotonic() + self.ahead)

    def look_at_monotonic(self) -> int:
        self.monotonic += next(self.pauses)
        return self.monotonic


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Machine:
    return Machine(monkeypatch)


def test_it_is_the_machines_as_long_as_nobody_sets_it(machine: Machine) -> None:
    node = NodeTime()
    for _ in range(1000):
        machine.monotonic += MS
        assert node.step_ns() == 0
        # Two looks, a microsecond each.
        assert abs(node.now_ns() - time.time_ns()) <= 2000


@pytest.mark.parametrize("step", [-600 * S, -5 * S, -6 * MS, 6 * MS, 5 * S, 600 * S])
def test_a_step_changes_nothing_until_it_is_noticed_and_is_noticed_once(
    machine: Machine, step: int
) -> None:
    node = NodeTime()
    before = node.now_ns()
    machine.ahead += step
    assert 0 < node.now_ns() - before < MS
    # Both clocks are looked at one after the other.
    assert abs(node.step_ns() - step) <= 2000
    assert node.step_ns() == 0
    assert abs(node.now_ns() - time.time_ns()) <= 2000


@pytest.mark.parametrize("step", [-STEP_NS // 2, STEP_NS // 2])
def test_small_steps_add_up(machine: Machine, step: int) -> None:
    node = NodeTime()
    machine.ahead += step
    assert node.step_ns() == 0
    machine.ahead += 2 * step
    assert abs(node.step_ns() - 3 * step) <= 2000


def test_a_process_that_is_interrupted_sees_no_step(machine: Machine) -> None:
    node = NodeTime()
    # For 30 ms between the first looks at both clocks; then once more, and then never.
    machine.pauses = itertools.chain([1000, 30 * MS, 30 * MS], itertools.repeat(1000))
    assert node.step_ns() == 0
    assert abs(node.now_ns() - time.time_ns()) <= 2000


def test_what_is_said_of_a_step() -> None:
    assert clock_step_text(-5 * S) == "clock set back by 5 s"
    assert clock_step_text(250 * MS) == "clock set forward by 0.25 s"
