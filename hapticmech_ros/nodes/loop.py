"""The one loop that runs nodes: an executor that waits no longer than the next deadline.

A bare spin() of the events executor hangs on an endless deadline, so waiting with a finite timeout
happens here and nowhere else. One thread runs callbacks and ticks, so nodes need no locks.
"""

from __future__ import annotations

import ctypes
import gc
import inspect
import signal
import sys
import time
from collections.abc import Sequence
from types import FrameType
from typing import Protocol

import rclpy
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.task import Future

from hapticmech_ros.times import NANOSECONDS

# Longest wait for a message or deadline: also how late a signal is answered at the worst.
LONGEST_WAIT_S = 0.1
# A deadline closer than this is waited for by looking at the clock: timers wake up later than that.
SHORTEST_WAIT_S = 20e-6
_PR_SET_TIMERSLACK = 29


class StopRequest:
    """Set by the first SIGINT or SIGTERM; further ones change nothing, nor disturb the end."""

    def __init__(self) -> None:
        self.asked = False
        signal.signal(signal.SIGINT, self._handle)
        signal.signal(signal.SIGTERM, self._handle)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self.asked = True
        # Python takes its handlers away as it ends: a second Ctrl-C would kill it there.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)


def wake_up_in_time() -> None:
    """Ask Linux not to gather this process's wake-ups, by which it delays each by some 50 µs."""
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1)


def wait_for_messages(executor: Executor, timeout_s: float, until: Future | None = None) -> None:
    """Run callbacks for ``timeout_s``, which must be finite, or until a future is done.

    One by one: each call of the events executor's ``spin_until_future_complete`` leaves an object
    of 24 bytes behind (rclpy 7.1), which at 1 kHz comes to 70 MB an hour.
    """
    end, left = time.monotonic() + timeout_s, timeout_s
    while until is None or not until.done():
        executor.spin_once(timeout_sec=max(left, 0.0))
        left = end - time.monotonic()
        if left <= 0.0:
            return


class HasDeadlines(Protocol):
    """A node that says when it wants to act next."""

    def look_at_clock(self) -> None:
        """Notice it if the machine's clock was set."""

    def now_ns(self) -> int:
        """Return the node's time, ns."""

    def next_deadline_ns(self) -> int | None:
        """Return the next deadline by the node's time, ns; None: never."""

    def act(self, now_ns: int) -> None:
        """Act on the deadlines that have come."""


def run_until(stop: StopRequest, nodes: Sequence[HasDeadlines]) -> None:
    """Run nodes in this thread until a signal: messages as they come, deadlines when they come."""
    executor = EventsExecutor()
    for node in nodes:
        executor.add_node(node)  # type: ignore[arg-type]
    _find_callers()
    gc.collect()
    gc.freeze()
    while rclpy.ok() and not stop.asked:
        wait_for_messages(executor, _wait_s(nodes))
        for node in nodes:
            node.look_at_clock()
            deadline = node.next_deadline_ns()
            if deadline is not None and deadline <= (now := node.now_ns()):
                node.act(now)
    executor.shutdown()


class Reports(Protocol):
    """A node that has something to say as it ends."""

    def final_report(self) -> str:
        """Return what is printed then."""


def print_report(node: Reports) -> None:
    """Print a node's last line in one write: processes that share a terminal end together."""
    sys.stdout.write(f"{node.final_report()}\n")
    sys.stdout.flush()


def _find_callers() -> None:
    """Do now what rclpy does for its first log line, when a device may wait for an answer.

    It asks inspect for the caller, which then looks through all modules: up to 0.1 s.
    """
    frame = inspect.currentframe()
    if frame is not None:
        inspect.getframeinfo(frame)


def _wait_s(nodes: Sequence[HasDeadlines]) -> float:
    """Return how long to wait for messages: to the next deadline, within finite bounds."""
    ahead = [
        (deadline - node.now_ns()) / NANOSECONDS
        for node in nodes
        if (deadline := node.next_deadline_ns()) is not None
    ]
    return min(max(min(ahead, default=LONGEST_WAIT_S), SHORTEST_WAIT_S), LONGEST_WAIT_S)
