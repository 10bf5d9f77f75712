# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a node's process ends: signals that come late, and its last line."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from hapticmech_ros.nodes import loop
from hapticmech_ros.nodes.loop import print_line, run_each, run_until

# Python has taken its own handlers away when it clears modules; what is told there comes last.
ENDS = """
import os, signal
from hapticmech_ros.nodes.loop import StopRequest

class Last:
    def __del__(self, kill=os.kill, pid=os.getpid(), number=signal.{name}):
        kill(pid, number)

stop = StopRequest()
last = Last()
os.kill(os.getpid(), signal.SIGINT)
print("asked", stop.asked, flush=True)
"""


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_second_signal_does_not_kill_a_process_that_ends(name: str) -> None:
    script = ENDS.format(name=name)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert done.stdout == "asked True\n"
    assert done.returncode == 0, signal.Signals(-done.returncode)


def test_the_last_line_is_one_write(monkeypatch: pytest.MonkeyPatch) -> None:
    pieces: list[str] = []
    monkeypatch.setattr(sys, "stdout", SimpleNamespace(write=pieces.append, flush=int))
    print_line("device: rendered")
    assert pieces == ["device: rendered\n"]


class Stop:
    """A request to stop."""

    def __init__(self) -> None:
        self.asked, self.calls = threading.Event(), list[Callable[[], None]]()

    def ask(self) -> None:
        self.asked.set()
        for call in self.calls:
            call()


@pytest.mark.parametrize("early", [True, False])
def test_a_loop_that_fails_stops_the_others_and_is_heard_of(early: bool) -> None:
    stop, calls = Stop(), list[str]()

    def fail(begun: Callable[[], None]) -> None:
        if not early:
            begun()
        raise KeyError("as of a defect")

    def go_on(begun: Callable[[], None]) -> None:
        assert signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())
        begun()
        assert stop.asked.wait(20.0)
        calls.append("ended")

    with pytest.raises(KeyError, match="as of a defect"):
        run_each(stop, [go_on, fail, go_on], lambda: calls.append("begun"))  # type: ignore[arg-type]
    assert calls == [*([] if early else ["begun"]), "ended", "ended"]


@pytest.mark.parametrize("has_stepped", [True, False])
def test_after_its_steps_a_kernel_does_the_next_one_and_not_python(
    monkeypatch: pytest.MonkeyPatch, has_stepped: bool
) -> None:
    passes, acted = list[float](), list[int]()
    stop = SimpleNamespace(asked=False, calls=[])

    def wait(timeout_s: float) -> None:
        passes.append(timeout_s)
        stop.asked = len(passes) == 3

    nothing = SimpleNamespace(
        add_node=id, shutdown=int, have_listened=bool, go_round=int, end=int, acted=int, wait=wait
    )
    for name in ("EventsExecutor", "Threads", "Watchdog", "Inbox"):
        monkeypatch.setattr(loop, name, lambda *_: nothing)
    monkeypatch.setattr(loop.rclpy, "ok", lambda: True)
    exchange = SimpleNamespace(ring=int, has_stepped=has_stepped)
    node = SimpleNamespace(
        look_at_clock=int, next_deadline_ns=lambda: 5, now_ns=lambda: 7, act=acted.append
    )
    run_until(stop, [node], exchange)  # type: ignore[arg-type, list-item]
    assert passes == [loop.SHORTEST_WAIT_S] * 3
    assert acted == ([] if has_stepped else [7] * 3)
