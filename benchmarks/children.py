# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Processes that a benchmark starts: where their output goes, and what they tell in JSON."""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import Any, TypeVar

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.graph.processes import start_process, stop_process

Found = TypeVar("Found")

# Where this package is found, which is not installed.
ROOT = Path(__file__).resolve().parents[1]
LOOK_AGAIN_S = 0.2
# Without end, and with nothing of the environment.
BUSY = [sys.executable, "-I", "-S", "-c", "while True: sum(range(10_000))"]
STARTS_WITHIN_S = 30.0


class BenchError(HapticMechError):
    """A run of a benchmark that could not be carried through."""


class ReportingProcess(AbstractContextManager["ReportingProcess"]):
    """A process that tells how it goes by lines of JSON, which a thread gathers.

    Use as a context manager: leaving it stops the process.

    Raises:
        BenchError: it ends, or does not say ``ready`` in time.
    """

    def __init__(self, command: Sequence[str], environment: Mapping[str, str]) -> None:
        self.name = command[2]
        self.events: list[dict[str, Any]] = []
        self.process = start_process(command, environment, pipe_output=True)
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()
        try:
            wait_until(
                lambda: self.of("ready"), STARTS_WITHIN_S, f"{self.name} to start", self.check
            )
        except BenchError:
            self.stop()
            raise

    def of(self, kind: str) -> list[dict[str, Any]]:
        """Return the events of a kind, as yet."""
        return [event for event in list(self.events) if event.get("event") == kind]

    def check(self) -> None:
        """Raise BenchError if the process has ended by itself."""
        if (code := self.process.poll()) is not None:
            reasons = [str(event.get("reason")) for event in self.of("failed")]
            why = reasons[-1] if reasons else f"exit code {code}"
            raise BenchError(f"{self.name} ended by itself: {why}")

    def stop(self) -> None:
        """End the process and read it to its last word."""
        stop_process(self.process)
        self._thread.join(LOOK_AGAIN_S * 10)

    def __exit__(self, *error: object) -> None:
        self.stop()

    def _listen(self) -> None:
        for line in self.process.stdout or ():
            if line.startswith("{"):
                self.events.append(json.loads(line))


def next_line(process: subprocess.Popen[str], seconds: float) -> str | None:
    """Return the next line of a process that says one at a time.

    Args:
        process: with its output in a pipe.
        seconds: that it may take.

    Returns:
        The line; empty if the process has ended, None if nothing comes.
    """
    if process.stdout is None:
        raise BenchError("a process whose output is not heard")
    ready, _, _ = select.select([process.stdout], [], [], seconds)
    return process.stdout.readline() if ready else None


def wait_until(
    condition: Callable[[], Found],
    timeout_s: float,
    what: str,
    check: Callable[[], object] = lambda: None,
    look_again_s: float = LOOK_AGAIN_S,
) -> Found:
    """Return the first true value of a function; ``check`` is called meanwhile, which may raise.

    Raises:
        BenchError: there is none in time.
    """
    end = time.monotonic() + timeout_s
    while not (found := condition()):
        check()
        if time.monotonic() > end:
            raise BenchError(f"waited {timeout_s:g} s in vain for {what}")
        time.sleep(look_again_s)
    return found


def finding_benchmarks(environment: Mapping[str, str]) -> dict[str, str]:
    """Return an environment in which ``python -m benchmarks...`` works from any folder."""
    paths = [*filter(None, [environment.get("PYTHONPATH")]), str(ROOT)]
    return {**environment, "PYTHONPATH": os.pathsep.join(paths)}


@contextmanager
def busy_programs(count: int) -> Iterator[None]:
    """Keep programs running meanwhile that never stop computing, each in a session of its own.

    As from other terminals: docs/realtime.md has what Linux does to those of the graph's session.
    """
    with ExitStack() as stack:
        for _ in range(count):
            process = start_process(("setsid", *BUSY), os.environ)
            stack.callback(process.wait)
            stack.callback(process.kill)
        yield


@contextmanager
def output_to(path: Path) -> Iterator[None]:
    """Let processes that are started within write into a file what they would print here."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = os.dup(1), os.dup(2)
    try:
        with path.open("ab") as file:
            os.dup2(file.fileno(), 1)
            os.dup2(file.fileno(), 2)
        yield
    finally:
        for number, copy in enumerate(kept, start=1):
            os.dup2(copy, number)
            os.close(copy)
