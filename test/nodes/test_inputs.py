"""Commands that stand: for how long, and which of them counts for samples that are caught up."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.nodes.inputs import ExpiringWrench, Standing

MS = 1_000_000
PUSH = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.5])


def test_what_came_after_a_stall_does_not_count_for_the_time_of_the_stall() -> None:
    command: Standing[str] = Standing()
    command.put("before", 10 * MS)
    command.sampled()
    command.put("first after", 100 * MS)
    command.put("last after", 101 * MS)
    assert command.as_of(50 * MS) == ("before", 10 * MS)
    assert command.as_of(101 * MS) == ("last after", 101 * MS)
    command.sampled()
    assert command.as_of(101 * MS) == ("last after", 101 * MS)


def test_nothing_stood_before_the_first() -> None:
    command: Standing[str] = Standing()
    command.put("first", 10 * MS)
    assert command.as_of(9 * MS)[0] is None
    command.sampled()
    command.clear()
    assert command.as_of(20 * MS)[0] is None


def test_a_wrench_ran_out_during_a_stall_whatever_came_after_it() -> None:
    wrench = ExpiringWrench(timeout_ns=50 * MS, ramp_ns=50 * MS)
    wrench.put(PUSH, 0)
    wrench.sampled()
    wrench.put(2.0 * PUSH, 200 * MS)
    assert np.array_equal(wrench.at(50 * MS), PUSH)
    assert np.array_equal(wrench.at(75 * MS), 0.5 * PUSH)
    assert not wrench.at(100 * MS).any()
    assert not wrench.at(199 * MS).any()
    assert np.array_equal(wrench.at(200 * MS), 2.0 * PUSH)
