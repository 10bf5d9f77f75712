"""The wait of a node's loop: deadlines are met though the system wakes it up late."""

from __future__ import annotations

import pytest

from hapticmech_ros.nodes import loop
from hapticmech_ros.nodes.loop import AWAKE_SHARE, Inbox

US = 1_000


class LateSystem:
    """A clock, and an exchange that waits by it, too long by ``late_ns``."""

    def __init__(self, late_ns: int) -> None:
        self.now, self.late_ns = 0, late_ns
        self.lane, self.linked, self.has_later, self.is_waiting = self, True, False, False
        self.looks = self.awake_ns = self.brought = 0
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

    def collect(self, timeout_s: float = 0.0) -> None:
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
    return made


def inbox_of(system: LateSystem) -> Inbox:
    made = Inbox(None, system)  # type: ignore[arg-type]
    made._latest_ns = 1 << 62
    return made


@pytest.mark.parametrize("late_us", [0, 5, 30, 60])
def test_deadlines_are_met_however_late_the_system_wakes_up(
    system: LateSystem, late_us: int
) -> None:
    inbox = inbox_of(system)
    system.late_ns = late_us * US
    lateness = []
    for _ in range(60):
        begun = system.now
        inbox.wait(0.9e-3)
        lateness.append(system.now - begun - 900 * US)
    # The first ones tell how late it is.
    assert max(lateness[40:]) <= 8 * US
    assert min(lateness) >= 0
    # No more than is needed: half as much again.
    assert system.awake_ns <= 60 * (late_us / 2 + 10) * US


def test_of_a_wait_no_more_than_a_share_is_spent_awake(system: LateSystem) -> None:
    inbox = inbox_of(system)
    system.late_ns = 500 * US
    for _ in range(50):
        inbox.wait(0.9e-3)
    begun, system.late_ns, system.awake_ns = system.now, 0, 0
    inbox.wait(0.9e-3)
    assert system.awake_ns <= 900 * US // AWAKE_SHARE + 8 * US
    assert system.now - begun <= 908 * US


def test_a_message_ends_the_wait_also_while_it_looks(system: LateSystem) -> None:
    inbox = inbox_of(system)
    for _ in range(50):
        inbox.wait(0.9e-3)
    for after in (300 * US, 880 * US):
        begun = system.now
        system.message_ns = begun + after
        inbox.wait(0.9e-3)
        assert system.now - begun == after


class Busy:
    """An executor with callbacks to run, on a slow machine or a fast one."""

    def __init__(
        self, system: LateSystem, nothing_ns: int, callback_ns: int, messages: bool = False
    ) -> None:
        self._system, self._nothing_ns, self._callback_ns = system, nothing_ns, callback_ns
        self._messages = messages
        self.waiting = self.calls = 0

    def spin_once(self, timeout_sec: float) -> None:
        assert timeout_sec < 0.0
        self.calls += 1
        self._system.brought += bool(self._messages and self.waiting)
        self._system.now += self._callback_ns if self.waiting else self._nothing_ns
        self.waiting = max(0, self.waiting - 1)


@pytest.mark.parametrize(
    ("nothing_us", "callback_us", "messages"),
    [
        *((4, 9, False), (5, 40, False), (20, 45, False), (30, 200, False)),
        # Messages that are dropped at once, since they came another way before.
        *((4, 5, True), (20, 21, True)),
    ],
)
def test_all_that_the_middleware_has_brought_is_taken_and_nothing_more(
    system: LateSystem, nothing_us: int, callback_us: int, messages: bool
) -> None:
    executor = Busy(system, nothing_us * US, callback_us * US, messages)
    inbox = Inbox(executor, system)  # type: ignore[arg-type]
    system.strange_ns = -(1 << 62)  # type: ignore[attr-defined]
    for waiting in (3, 0, 1, 30, 7):
        executor.waiting = waiting
        system.now += 10_000 * US
        executor.calls = 0
        inbox.look()
        assert executor.waiting == 0
    assert executor.calls == 8


class Lane:
    """Of an exchange whose messages come by themselves."""

    linked = True

    def look(self) -> None:
        """As of a lane."""


class Gathered:
    """An exchange that notes how often it is asked for what has come."""

    def __init__(self) -> None:
        self.lane, self.asked, self.delivered, self.brought = Lane(), 0, 0, 0
        self.strange_ns = -(1 << 62)

    def collect(self, timeout_s: float = 0.0, whole: bool = False) -> None:
        assert timeout_s == 0.0
        assert whole
        self.asked += 1

    def deliver(self) -> None:
        self.delivered += 1


class NoMessages:
    """An executor to which the middleware brings nothing."""

    def spin_once(self, timeout_sec: float) -> None:
        """As of an executor."""


@pytest.mark.parametrize("waiting", [1, 100, 1000])
def test_who_answers_nobody_takes_all_that_the_middleware_has_brought(
    monkeypatch: pytest.MonkeyPatch, system: LateSystem, waiting: int
) -> None:
    exchange, executor = Gathered(), Busy(system, 4 * US, 9 * US)
    monkeypatch.setattr(loop.time, "sleep", system.sleep)
    inbox = Inbox(executor, exchange)  # type: ignore[arg-type]
    inbox.gather()
    for _ in range(3):
        executor.waiting = waiting
        inbox.gather()
        # No more than in the time in which it comes.
        most = int(loop.GATHER_S / 9e-6)
        assert executor.waiting <= max(0, waiting - most)


def test_who_answers_nobody_stops_where_the_middleware_never_does(
    monkeypatch: pytest.MonkeyPatch, system: LateSystem
) -> None:
    executor = Busy(system, 4 * US, 9 * US)
    monkeypatch.setattr(loop.time, "sleep", system.sleep)
    inbox = Inbox(executor, Gathered())  # type: ignore[arg-type]
    inbox.gather()
    executor.waiting = 1 << 30
    begun = system.now
    inbox.gather()
    assert system.now - begun < 2.1e9 * loop.GATHER_S


def test_who_answers_nobody_wakes_up_once_in_a_while() -> None:
    exchange = Gathered()
    inbox = Inbox(NoMessages(), exchange)  # type: ignore[arg-type]
    begun = loop.time.monotonic()
    for _ in range(10):
        inbox.gather()
    assert loop.time.monotonic() - begun >= 10 * loop.GATHER_S
    assert exchange.asked == exchange.delivered == 10
