# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The process in which a live session runs, and the pipe to it.

It has a separate process because drawing and serving a page would take the time that ticks need.
"""

from __future__ import annotations

import signal
import threading
import time
from contextlib import AbstractContextManager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection

from hapticmech_ros.compilation.library import COMPILE_TIMEOUT_S
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.live.commands import COMMANDS, Command, Failed, Open, Report, newest
from hapticmech_ros.live.live_session import AT_ONCE_S, LiveSession


class Mailbox:
    """Reports that were not taken yet; may be used from several threads.

    Args:
        ended: text of the error once no more can come.
    """

    def __init__(self, ended: str) -> None:
        self._ended, self._is_closed = ended, False
        self._came = threading.Condition()
        self._news: list[Report] = []

    def put(self, report: Report) -> None:
        """Add a report; of states only the newest is kept."""
        with self._came:
            self._news = newest([*self._news, report])
            self._came.notify_all()

    def close(self) -> None:
        """Mark that no more will come."""
        with self._came:
            self._is_closed = True
            self._came.notify_all()

    def first(self, timeout_s: float) -> Report | None:
        """Return the first report, and leave it there; None if nothing has come in time.

        Args:
            timeout_s: how long to wait for anything, s.

        Raises:
            HapticMechError: nothing is left, and no more can come.
        """
        with self._came:
            self._wait(timeout_s)
            return self._news[0] if self._news else None

    def take(self, timeout_s: float) -> list[Report]:
        """Return all that has come, in its order.

        Args:
            timeout_s: how long to wait for anything, s.

        Raises:
            HapticMechError: nothing is left, and no more can come.
        """
        with self._came:
            self._wait(timeout_s)
            found, self._news = self._news, []
        return found

    def _wait(self, timeout_s: float) -> None:
        self._came.wait_for(lambda: self._news or self._is_closed, timeout_s)
        if self._is_closed and not self._news:
            raise HapticMechError(self._ended)


# Between two states that are sent, s.
STATE_PERIOD_S = 1.0 / 60.0
# Commands taken between two steps: they may come as fast as they are taken.
MOST_COMMANDS = 64
# How long the child is given to begin, kernels compiled if need be, and to end by itself, s.
_START_S, _END_S = COMPILE_TIMEOUT_S + 60.0, 5.0
_NOT_BEGUN = f"the live session did not begin within {_START_S:g} s"
_ENDED = "the live session's process has ended by itself"


class LiveProcess(AbstractContextManager["LiveProcess"]):
    """A live session in a child process; may be used from several threads.

    As a context manager it ends the child. A child whose parent is gone ends by itself. Its reports
    are taken from the pipe at once: it never waits for a slow page.

    Args:
        asked: the scene to begin with.

    Raises:
        HapticMechError: the scene is refused, or cannot begin.
    """

    takes: frozenset[type] = COMMANDS

    def __init__(self, asked: Open) -> None:
        context = get_context("spawn")
        self._pipe, there = context.Pipe()
        self._sending = threading.Lock()
        self._replies = Mailbox(_ENDED)
        self._process = context.Process(
            target=_serve, args=(there, asked), name="live session", daemon=True
        )
        self._process.start()
        there.close()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        try:
            self._begin()
        except HapticMechError:
            self.close()
            raise

    def send(self, command: Command) -> None:
        """Send the session a command, unless it has ended."""
        with self._sending, suppress(OSError):  # it has ended
            self._pipe.send(command)

    def news(self, timeout_s: float) -> list[Report]:
        """Return reports: of states only the newest, the others in their order.

        Args:
            timeout_s: how long to wait for anything.

        Raises:
            HapticMechError: the process has ended.
        """
        return self._replies.take(timeout_s)

    def close(self) -> None:
        """End the process."""
        with self._sending, suppress(OSError):  # it has ended
            self._pipe.send(None)
        self._process.join(_END_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._reader.join()
        self._pipe.close()

    def __exit__(self, *_: object) -> None:
        self.close()

    def _begin(self) -> None:
        """Wait until the session has begun."""
        first = self._replies.first(_START_S)
        if first is None:
            raise HapticMechError(_NOT_BEGUN)
        if isinstance(first, Failed):
            raise HapticMechError(first.reason)

    def _read(self) -> None:
        while True:
            try:
                self._replies.put(self._pipe.recv())
            except (EOFError, OSError):
                self._replies.close()
                return


def _serve(pipe: Connection, asked: Open) -> None:
    """Run the session until the pipe closes."""
    # Ctrl-C is for the parent, which then closes the pipe.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        live = LiveSession(asked, time.monotonic())
    except HapticMechError as error:
        pipe.send(Failed(str(error)))
        return
    try:
        pipe.send(live.opened)
        _run(pipe, live)
    except (EOFError, OSError):  # the parent is gone
        return
    finally:
        live.close()


def _run(pipe: Connection, live: LiveSession) -> None:
    sent = 0.0
    while True:
        wait = 0.0 if live.is_behind else AT_ONCE_S
        for _ in range(MOST_COMMANDS):
            if not pipe.poll(wait):
                break
            command = pipe.recv()
            if command is None:
                return
            reply = live.take(command, time.monotonic())
            if reply is not None:
                pipe.send(reply)
            wait = 0.0
        live.advance(time.monotonic())
        now = time.monotonic()
        if now - sent >= STATE_PERIOD_S:
            pipe.send(live.state())
            sent = now
