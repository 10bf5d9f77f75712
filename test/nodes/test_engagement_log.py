# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a controller says of its engagements: everything, in a few lines."""

from __future__ import annotations

import pytest

from benchmarks.reliability.fake_graph import ACTORS, FakeGraph, Log
from hapticmech_ros.nodes.controller_ports import EngagementLog
from nodes.stand_ins import heard, last_sample
from ros.harness import six


class Said:
    """A log, and a time that is set."""

    def __init__(self):
        self.now_ns, self.log = 0, Log()
        self.engagement = EngagementLog(lambda: self.log, lambda: self.now_ns)

    @property
    def lines(self):
        return self.log.lines


@pytest.fixture
def said():
    return Said()


def test_single_changes_are_said_at_once(said):
    for second in range(3):
        said.now_ns = 2_000_000_000 * second
        said.engagement.engaged()
        said.engagement.lost("lost device/state")
        said.engagement.report_counts()
    once = [("info", "engaged"), ("warning", "disengaged: lost device/state")]
    assert said.lines == 3 * once


def test_thirty_seconds_of_stalls_are_counted_in_few_lines(said):
    for tick in range(30 * 74):
        said.now_ns = tick * 1_000_000_000 // 74
        if tick % 15 == 0:
            said.engagement.engaged()
        if tick % 15 == 3:
            said.engagement.lost("lost device/state")
        if tick % 74 == 73:
            said.engagement.report_counts()
    assert 20 < len(said.lines) <= 65
    counted = [text.split()[1] for _, text in said.lines if "more time" in text]
    whole = [text for _, text in said.lines if text == "disengaged: lost device/state"]
    assert sum(map(int, counted)) + len(whole) == 30 * 74 // 15


@pytest.mark.parametrize("engaged", [True, False])
def test_the_last_line_says_how_it_is(said, engaged):
    said.engagement.engaged()
    said.engagement.lost("lost a")
    said.engagement.engaged()
    said.engagement.lost("lost b")
    if engaged:
        said.engagement.engaged()
    said.engagement.report_counts()
    state = "engaged" if engaged else "disengaged"
    assert said.lines[-1] == ("warning", f"disengaged 1 more time, the last: lost b; now {state}")


def test_what_explains_a_loss_is_said_with_it_or_with_what_comes_next(said):
    said.engagement.engaged()
    said.engagement.lost("lost a", "this process had no processor for 14 ms")
    said.engagement.engaged()
    said.now_ns = 2_000_000_000
    said.engagement.lost("lost b")
    said.engagement.engaged("the device had paused for 15 ms")
    assert [text for _, text in said.lines] == [
        "engaged",
        "disengaged: lost a: this process had no processor for 14 ms",
        "engaged",
        "disengaged: lost b",
        "engaged: the device had paused for 15 ms",
    ]


def test_of_those_that_are_counted_it_is_told_how_many_are_explained(said):
    said.engagement.engaged()
    said.engagement.lost("lost a")
    for explanation in ("this process had no processor for 14 ms", "", ""):
        said.engagement.engaged()
        said.engagement.lost("lost b", explanation)
    said.engagement.engaged("the device had paused for 15 ms")
    said.engagement.report_counts()
    assert said.lines[-1][1] == (
        "disengaged 3 more times (2 because a process paused), "
        "the last: lost b: the device had paused for 15 ms; now engaged"
    )


def test_a_stop_that_is_wanted_is_no_warning_and_leaves_nobody_under_force():
    graph = FakeGraph("five_bar", actors=ACTORS[:4])
    graph.run(0.5)
    host = graph.hosts["teleoperation_controller"]
    assert ("info", "engaged") in host.log.lines
    assert last_sample(graph).applied.any()
    commands = heard(graph, "/device/servo_cf", "/mechanism/handle/servo_cf")
    host.end()
    assert [[six(one) for one in received] for received in commands] == [[[0.0] * 6]] * 2
    graph.run(0.01)
    assert not last_sample(graph).applied.any()
    assert host.log.lines[-1] == ("info", "disengaged: deactivated")
    assert all(level != "warning" for level, _ in host.log.lines)
