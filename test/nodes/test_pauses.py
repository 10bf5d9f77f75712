# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A process tells its own pauses from waiting and computing, and a sender's from lost messages."""

from __future__ import annotations

import pytest

from hapticmech_ros.nodes.lane_kernels import LONG_PAUSE_NS, MOST_PAUSES, Link, note_pause
from hapticmech_ros.nodes.sources import MIDDLEWARE, NO_ORIGIN, Origin
from hapticmech_ros.nodes.timeouts import (
    MINUTE_NS,
    SEVERAL,
    Losses,
    OwnPauses,
    Remedy,
    SenderPauses,
)
from nodes.stand_ins import MS

TIMEOUT_NS = 12 * MS


class Process:
    """A process with a period of 1 ms, whose clocks are set."""

    def __init__(self) -> None:
        self.now_ns = self.computed_ns = 1000 * MS
        self.due_ns: int | None = self.now_ns
        self.pauses = OwnPauses(
            lambda: None if self.due_ns is None else self.due_ns - self.now_ns,
            lambda: self.now_ns,
            lambda: self.computed_ns,
        )
        self.said: list[str] = []
        self.losses = Losses(self.pauses, 1000.0, self.said.append)
        self.go_on(0)

    def go_on(self, later_ns: int, computed_ns: int = 0, wait_ns: int = MS) -> None:
        """Go on so much later, of which it computed for a while and wanted to wait for another."""
        self.now_ns += later_ns
        self.computed_ns += computed_ns
        if self.due_ns is not None:
            self.due_ns = self.now_ns - later_ns + wait_ns
        self.pauses.look()

    def lose(self, silence_ns: int | None, sender: SenderPauses | None = None) -> str:
        return self.losses.explained(silence_ns, TIMEOUT_NS, self.now_ns, sender)


@pytest.fixture
def process() -> Process:
    return Process()


def test_who_is_late_without_having_computed_had_no_processor(process: Process) -> None:
    process.go_on(15 * MS)
    assert process.pauses.within(20 * MS) == (14 * MS, 14 * MS)
    assert process.lose(15 * MS) == "this process had no processor for 14 ms"
    assert process.losses.figures()["lost_without_processor"] == "1"


def test_of_a_longer_pause_counts_what_lies_within(process: Process) -> None:
    process.go_on(51 * MS)
    process.go_on(2 * MS)
    assert process.pauses.within(10 * MS) == (8 * MS, 50 * MS)


@pytest.mark.parametrize(
    ("computed_ns", "wait_ns"), [(15 * MS, 0), (0, 15 * MS), (8 * MS, 7 * MS), (MS, 13 * MS)]
)
def test_who_computed_or_wanted_to_wait_had_one(
    process: Process, computed_ns: int, wait_ns: int
) -> None:
    process.go_on(15 * MS, computed_ns, wait_ns)
    assert process.pauses.within(20 * MS) == (0, 0)
    assert process.lose(15 * MS) == ""
    assert process.losses.figures()["lost_without_processor"] == "0"


def test_a_kernel_notes_short_pauses_and_returns_after_a_long_one_or_many() -> None:
    link, later = Link(), 1 << 60
    link.until, pauses = later, link.pauses
    for number in range(1, MOST_PAUSES):
        note_pause(link, pauses, number * 100 * MS, number * MS // 2)
        assert pauses.count == number
        assert link.until == later
    note_pause(link, pauses, MOST_PAUSES * 100 * MS, 2 * MS)
    assert link.until == 0
    note_pause(link, pauses, 9000 * MS, 2 * MS)
    assert pauses.count == MOST_PAUSES
    ends, lengths = zip(*link.pauses.each(), strict=True)
    assert list(ends) == [number * 100 * MS for number in range(1, MOST_PAUSES + 1)]
    assert lengths[-1] == 2 * MS
    link = Link()
    link.until = later
    note_pause(link, link.pauses, 100 * MS, LONG_PAUSE_NS + 1)
    assert link.until == 0


def test_each_of_a_senders_pauses_that_a_kernel_noted_counts_at_its_time() -> None:
    sender = SenderPauses("the device", MS)
    origin = Origin(7, 0, 100)
    sender.went_on(1000 * MS, origin, 1000 * MS, [[300 * MS, 4 * MS], [995 * MS, 2 * MS]])
    assert sender.within(20 * MS) == (2 * MS, 2 * MS)
    assert sender.within(800 * MS) == (6 * MS, 6 * MS)


def test_a_pause_that_a_kernel_noted_explains_a_loss_at_that_time_only(process: Process) -> None:
    process.go_on(MS)
    now_ns = process.now_ns
    process.pauses.paused(now_ns - 50 * MS, 4 * MS)
    assert process.pauses.within(20 * MS) == (0, 0)
    assert process.pauses.within(52 * MS) == (2 * MS, 4 * MS)


def test_who_waits_for_ever_is_never_late(process: Process) -> None:
    process.due_ns = None
    process.go_on(1000 * MS)
    assert process.pauses.within(2000 * MS) == (0, 0)


def test_a_pause_that_does_not_explain_a_silence_is_not_blamed_for_it(process: Process) -> None:
    """A peer that was killed long before stays away, whatever happened here."""
    process.go_on(8 * MS)
    assert process.lose(40 * MS) == ""
    process.go_on(1000 * MS, wait_ns=1000 * MS)
    assert process.lose(13 * MS) == ""
    # Every process is late now and then: too little for its peer's death.
    process.go_on(5 * MS)
    assert process.lose(13 * MS) == ""


def test_a_loss_without_a_known_silence_is_explained_by_half_a_timeout(process: Process) -> None:
    process.go_on(6 * MS)
    assert process.lose(None) == ""
    process.go_on(8 * MS)
    assert process.lose(None) == "this process had no processor for 12 ms"


def receives(sender: SenderPauses, times: range, via: int = 1, behind: int = 0) -> None:
    """Hear a message in each of these periods, which stamps and counts go on with."""
    for period in times:
        number = period - behind
        origin = Origin(via, 0, number) if via else Origin(MIDDLEWARE, number)
        sender.received(period * MS, origin, period * MS)


@pytest.mark.parametrize("via", [MIDDLEWARE, 1])
def test_a_sender_whose_count_stood_still_had_paused(process: Process, via: int) -> None:
    sender = SenderPauses("the device", MS)
    receives(sender, range(1, 1000), via)
    process.now_ns = 1012 * MS
    assert process.lose(13 * MS, sender) == ""
    assert process.losses.explained_now(1012 * MS) == ""
    receives(sender, range(1015, 1016), via, behind=15)
    assert process.losses.explained_now(1015 * MS) == "the device had paused for 15 ms"
    assert process.losses.explained_now(1015 * MS) == ""
    assert process.losses.sender_paused == 1
    assert process.losses.figures() == {"losses": "1", "lost_without_processor": "0"}


@pytest.mark.parametrize("via", [MIDDLEWARE, 1])
def test_messages_that_were_lost_on_the_way_are_no_pause(via: int) -> None:
    sender = SenderPauses("the device", MS)
    receives(sender, range(1, 1000), via)
    receives(sender, range(1015, 1016), via)
    assert sender.within(100 * MS) == (0, 0)


def test_another_sender_and_one_that_is_not_counted_have_not_paused() -> None:
    sender = SenderPauses("the device", MS)
    receives(sender, range(1, 1000), via=1)
    receives(sender, range(1015, 1016), via=2, behind=15)
    for period in (2000, 2050):
        sender.received(period * MS, NO_ORIGIN, period * MS)
    assert sender.within(5000 * MS) == (0, 0)


def test_the_remedy_is_told_after_several_losses_once_a_minute() -> None:
    remedy = Remedy()
    told = []
    for second in range(150):
        now = second * 1000 * MS
        if said := remedy.after((20 + second % 10) * MS, 1000.0, now):
            told.append((second, said))
    assert [second for second, _ in told] == [SEVERAL - 1, SEVERAL + 59, SEVERAL + 119]
    assert "61 times" in told[1][1]
    assert "up to 29 ms" in told[1][1]
    assert "(1000 Hz): see docs/realtime.md" in told[1][1]


def test_losses_that_are_far_apart_are_no_sign_of_a_slow_machine() -> None:
    remedy = Remedy()
    assert not any(remedy.after(20 * MS, 1000.0, n * MINUTE_NS // 2 + n) for n in range(20))


def test_nodes_of_one_process_share_the_remedy(process: Process) -> None:
    other = Losses(process.pauses, 1000.0, process.said.append)
    for _ in range(SEVERAL):
        process.go_on(15 * MS)
        for losses in (process.losses, other):
            assert losses.explained(15 * MS, TIMEOUT_NS, process.now_ns)
    assert len(process.said) == 1
