# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Commands that stand: for how long, and which of them counts for samples that are caught up."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.nodes.inputs import ExpiringWrench, Standing
from nodes.stand_ins import MS

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


def test_what_ran_out_during_a_stall_is_told_once_and_counts_no_more() -> None:
    command: Standing[str] = Standing()
    assert not command.lapsed(0, 12 * MS)
    command.put("before", 10 * MS)
    command.sampled()
    assert not command.lapsed(22 * MS, 12 * MS)
    assert command.lapsed(23 * MS, 12 * MS)
    assert not command.lapsed(23 * MS, 12 * MS)
    command.put("after", 100 * MS)
    # Not even for the time when it still stood.
    assert command.as_of(11 * MS)[0] is None
    assert command.as_of(100 * MS) == ("after", 100 * MS)


def test_over_a_period_acts_what_was_known_before_it_began() -> None:
    command: Standing[str] = Standing()
    command.put("first", 9 * MS)
    assert command.as_of(10 * MS - 1) == ("first", 9 * MS)
    command.sampled()
    command.put("with the tick", 10 * MS)
    command.put("after the tick", 10 * MS + 300)
    assert command.as_of(10 * MS - 1) == ("first", 9 * MS)
    command.sampled()
    assert command.as_of(11 * MS - 1) == ("after the tick", 10 * MS + 300)


def test_what_had_run_out_when_a_period_began_does_not_act_again_with_news() -> None:
    wrench = ExpiringWrench(timeout_ns=5 * MS, ramp_ns=10 * MS)
    wrench.put(PUSH, 9 * MS)
    wrench.sampled()
    wrench.put(2.0 * PUSH, 40 * MS + 300)
    assert not wrench.at(40 * MS - 1).any()
    wrench.sampled()
    assert np.array_equal(wrench.at(41 * MS - 1), 2.0 * PUSH)
