# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The wait of a node's loop: deadlines are met though the system wakes it up late."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace

import pytest

from hapticmech_ros.nodes import loop
from hapticmech_ros.nodes.loop import AWAKE_NS, AWAKE_SHARE, Inbox

US = 1_000


class LateSystem:
    """A clock, and an exchange that waits by it, too long by ``late_ns``."""

    def __init__(self, late_ns: int) -> None:
        self.now, self.late_ns = 0, late_ns
        self.lane, self.linked, self.has_later, self.is_waiting = self, True, False, False
        self.looks = self.awake_ns = 0
        # As of a lane whose wait nothing else does.
        self.worked, self.turn = False, None
        self.message_ns: int | None = None

    def monotonic_ns(self) -> int:
        return self.now

    def monotonic(self) -> float:
        return self.now * 1e-9

    def sleep(self, seconds: float) -> None:
        self.now += round(seconds * 1e9)

    def look(self) -> None:
        """As of a lane."""

    def deliver(self) -> None:
        self.is_waiting = False

    def collect(self, timeout_s: float = 0.0, longest_s: float = 0.0) -> None:
        waited = round(timeout_s * 1e9)
        end = self.now + (waited + self.late_ns if waited else 4 * US)
        if self.message_ns is not None and self.message_ns <= end:
            end, self.message_ns = max(self.now, self.message_ns), None
            self.is_waiting = True
        elif not waited:
            self.looks += 1
            self.awake_ns += end - self.now
        self.now = end


@pytest.fixture
def system(monkeypatch: pytest.MonkeyPatch) -> LateSystem:
    made = LateSystem(70 * US)
    monkeypatch.setattr(loop.time, "monotonic_ns", made.monotonic_ns)
    monkeypatch.setattr(loop.time, "monotonic", made.monotonic)
    monkeypatch.setattr(loop.time, "sleep", made.sleep)
    return made


@pytest.fixture
def inbox(system: LateSystem) -> Inbox:
    return Inbox(None, system, SimpleNamespace(begin=lambda turn: None))  # type: ignore[arg-type]


def waited_ns(inbox: Inbox, system: LateSystem) -> int:
    """Wait for 0.9 ms, and return how long that was."""
    begun = system.now
    inbox.wait(0.9e-3)
    return system.now - begun


@pytest.mark.parametrize("late_us", [0, 5, 30, 60])
def test_deadlines_are_met_however_late_the_system_wakes_up(
    inbox: Inbox, system: LateSystem, late_us: int
) -> None:
    system.late_ns = late_us * US
    lateness = [waited_ns(inbox, system) - 900 * US for _ in range(60)]
    # The first ones tell how late it is.
    assert max(lateness[40:]) <= max(0, late_us * US - AWAKE_NS) + 8 * US
    assert min(lateness) >= 0
    # No more than is needed: half as much again.
    assert system.awake_ns <= 60 * (late_us / 2 + 10) * US
    assert system.awake_ns <= 60 * (AWAKE_NS + 8 * US)


def test_of_a_wait_no_more_than_a_share_is_spent_awake(inbox: Inbox, system: LateSystem) -> None:
    system.late_ns = 500 * US
    for _ in range(50):
        inbox.wait(0.9e-3)
    system.late_ns = system.awake_ns = 0
    assert waited_ns(inbox, system) <= 908 * US
    assert system.awake_ns <= min(900 * US // AWAKE_SHARE, AWAKE_NS) + 8 * US


def test_a_message_ends_the_wait_also_while_it_looks(inbox: Inbox, system: LateSystem) -> None:
    for _ in range(50):
        inbox.wait(0.9e-3)
    for after in (300 * US, 880 * US):
        system.message_ns = system.now + after
        assert waited_ns(inbox, system) == after


def test_a_wait_that_something_else_has_ended_teaches_nothing(
    inbox: Inbox, system: LateSystem
) -> None:
    collect = system.collect

    def rung(timeout_s: float = 0.0, longest_s: float = 0.0) -> None:
        collect(min(timeout_s, 0.1e-3), longest_s)

    system.late_ns = 0
    for _ in range(60):
        inbox.wait(0.9e-3)
    system.collect = rung  # type: ignore[method-assign]
    for _ in range(200):
        assert waited_ns(inbox, system) <= 110 * US
    system.collect = collect  # type: ignore[method-assign]
    assert 900 * US <= waited_ns(inbox, system) <= 910 * US


class Busy:
    """An executor with ``waiting`` callbacks to run, some of which take no longer than none."""

    def __init__(self, system: LateSystem, callback_ns: int) -> None:
        self._system, self._callback_ns = system, callback_ns
        self._queue: deque[Callable[[], None]] = deque()
        self.calls = 0

    @property
    def waiting(self) -> int:
        return len(self._queue)

    def wait(self, number: int, ns: int | None = None) -> None:
        for _ in range(number):
            self._queue.append(partial(self._pass, self._callback_ns if ns is None else ns))

    def _pass(self, ns: int) -> None:
        self._system.now += ns

    def create_task(self, callback: Callable[[], None]) -> None:
        self._queue.append(callback)

    def spin_once(self, timeout_sec: float) -> None:
        assert timeout_sec < 0.0
        self.calls += 1
        self._system.now += US
        if self._queue:
            self._queue.popleft()()


def test_all_that_the_middleware_has_brought_is_taken_and_nothing_more(system: LateSystem) -> None:
    executor = Busy(system, 40 * US)
    for waiting in (3, 0, 1, 30, 7):
        executor.wait(waiting)
        executor.calls = 0
        loop.run_waiting(executor, 1.0)  # type: ignore[arg-type]
        assert executor.waiting == 0
        # One for the mark behind them.
        assert executor.calls == waiting + 1


def test_events_without_messages_keep_nobody_waiting(system: LateSystem) -> None:
    """As of messages that were replaced before they were taken: as short as nothing at all."""
    executor = Busy(system, 40 * US)
    executor.wait(1000, ns=0)
    begun = system.now
    loop.run_waiting(executor, 100e-6)  # type: ignore[arg-type]
    assert executor.calls >= 90
    assert system.now - begun <= 110 * US


class Gathered:
    """An exchange that notes how often it is asked for what has come."""

    def __init__(self) -> None:
        self.lane = SimpleNamespace(linked=True, look=int, fullest=0)
        self.asked = self.delivered = 0

    def collect(self, timeout_s: float = 0.0, whole: bool = False) -> None:
        assert timeout_s == 0.0
        assert whole
        self.asked += 1

    def deliver(self) -> None:
        self.delivered += 1


class NoMessages:
    """An executor to which the middleware brings nothing."""

    def __init__(self) -> None:
        self._tasks: list[Callable[[], None]] = []

    def create_task(self, callback: Callable[[], None]) -> None:
        self._tasks.append(callback)

    def spin_once(self, timeout_sec: float) -> None:
        while self._tasks:
            self._tasks.pop()()


def gathering(system: LateSystem, callback_ns: int = 9 * US) -> tuple[Inbox, Busy]:
    """Return an inbox of one who answers nobody, and its executor."""
    executor = Busy(system, callback_ns)
    return Inbox(executor, Gathered()), executor  # type: ignore[arg-type]


@pytest.mark.parametrize("waiting", [1, 100, 1000])
def test_who_answers_nobody_takes_all_that_the_middleware_has_brought(
    system: LateSystem, waiting: int
) -> None:
    inbox, executor = gathering(system)
    inbox.gather()
    for _ in range(3):
        executor.wait(waiting)
        before = executor.waiting
        inbox.gather()
        # No more than in the time in which it comes.
        most = int(loop.GATHER_S / 10e-6) - 2
        assert executor.waiting <= max(0, before - most)


def test_who_answers_nobody_stops_where_the_middleware_never_does(system: LateSystem) -> None:
    inbox, executor = gathering(system)
    inbox.gather()
    executor.wait(10_000)
    begun = system.now
    inbox.gather()
    assert system.now - begun < 2.1e9 * loop.GATHER_S


def test_callbacks_that_take_seconds_keep_nobody_from_his_clock(system: LateSystem) -> None:
    """As a recorder's, on a machine with other work, where a lane has filled."""
    inbox, executor = gathering(system, 2_000_000 * US)
    executor.wait(1000)
    inbox.gather()
    assert system.now < 2.1e9
    assert executor.calls == 1


def test_who_ends_takes_all_that_has_come_but_not_for_ever(system: LateSystem) -> None:
    inbox, executor = gathering(system)
    executor.wait(10_000)
    inbox.drain(1.0)
    assert executor.waiting == 0
    executor.wait(200_000)
    begun = system.now
    inbox.drain(1.0)
    assert executor.waiting > 0
    assert system.now - begun < 1.1e9


@pytest.mark.parametrize(
    ("bytes_per_s", "period_s"),
    [(0, loop.GATHER_S), (1e6, loop.GATHER_S), (20e6, 0.007), (1e9, loop.GATHER_LEAST_S)],
)
def test_who_answers_nobody_wakes_up_before_a_socket_is_more_than_a_third_full(
    system: LateSystem, bytes_per_s: float, period_s: float
) -> None:
    exchange = Gathered()
    inbox = Inbox(NoMessages(), exchange)  # type: ignore[arg-type]
    taken_s, periods = [system.monotonic()], []

    def collect(timeout_s: float = 0.0, whole: bool = False) -> None:
        taken_s.append(system.monotonic())
        periods.append(taken_s[-1] - taken_s[-2])
        exchange.lane.fullest = round(bytes_per_s * periods[-1])

    exchange.collect = collect  # type: ignore[method-assign]
    for _ in range(10):
        inbox.gather()
    assert periods[2:] == pytest.approx([period_s] * 8, rel=1e-3)
    assert exchange.delivered == 10
