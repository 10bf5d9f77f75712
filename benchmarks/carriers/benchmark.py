# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark of carriers: a message to another process of the host, and its answer."""

from __future__ import annotations

import gc
import importlib.util
import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import typer

from benchmarks.carriers.carriers import CARRIERS, Carrier, End
from benchmarks.children import BenchError
from benchmarks.machine import MachineResults, machine
from hapticmech_ros.analysis.study import Sheet, Show, number, silent
from hapticmech_ros.cli.console import OutOption
from hapticmech_ros.cli.study import JsonOption, carry_out
from hapticmech_ros.nodes.loop import wake_up_in_time

# As many bytes as a device's sample, and as an operational model.
SIZES = (320, 1300)
RATE_HZ = 1000.0
# Answers before the first one that is timed.
WARM_UP = 200
MEETS_WITHIN_S = 10.0


@dataclass(frozen=True, slots=True)
class Round:
    """Figures of one carrier in one round.

    Attributes:
        carrier: by name.
        size: of a message, bytes.
        p50_us, p99_us: from a message to its answer.
        cpu_us: CPU time of both processes for a message and its answer.
    """

    carrier: str
    size: int
    p50_us: float
    p99_us: float
    cpu_us: float


@dataclass(frozen=True)
class CarrierResults(MachineResults):
    """All rounds, and carriers that were left out because they are not installed."""

    NAME: ClassVar[str] = "bench_carriers"

    rounds: tuple[Round, ...]
    missing: tuple[str, ...]

    def sheets(self) -> Iterator[Sheet]:
        """Yield the medians of all rounds."""
        rows = []
        for name in dict.fromkeys(one.carrier for one in self.rounds):
            for size in SIZES:
                found = [one for one in self.rounds if (one.carrier, one.size) == (name, size)]
                values = [
                    float(np.median([getattr(one, what) for one in found]))
                    for what in ("p50_us", "p99_us", "cpu_us")
                ]
                rows.append((name, str(size), *(number(value, ".0f") for value in values)))
        rows += [(name, "", "not installed") for name in self.missing]
        count = len(self.rounds) // max(1, len(rows) - len(self.missing))
        yield Sheet(
            f"a message and its answer between two processes, {RATE_HZ:g} times a second",
            ("carrier", "bytes", "p50", "p99", "CPU"),
            tuple(rows),
            caption=f"µs, medians of {count} rounds; CPU time of both processes",
        )


def installed(name: str) -> bool:
    """Return whether a carrier can be had here."""
    return name != "iceoryx2" or importlib.util.find_spec(name) is not None


def run_benchmark(rounds: int, seconds: float, show: Show = silent) -> CarrierResults:
    """Time every carrier in turn, round by round, so that a drifting machine meets all of them.

    Args:
        rounds: of all carriers and sizes.
        seconds: for each.
        show: called with what is being done.
    """
    names = [name for name in CARRIERS if installed(name)]
    found = []
    for index in range(rounds):
        show(f"round {index + 1} of {rounds}")
        for name in names:
            found += [time_carrier(name, size, round(seconds * RATE_HZ)) for size in SIZES]
    missing = tuple(name for name in CARRIERS if name not in names)
    return CarrierResults(machine(), tuple(found), missing)


def time_carrier(name: str, size: int, count: int) -> Round:
    """Send messages to another process, a millisecond apart, and time their answers.

    Raises:
        BenchError: one did not come, or was another message.
    """
    answering = Answering(CARRIERS[name])
    messages = [bytes([index % 251]) * size for index in range(WARM_UP + count)]
    taken = np.zeros(len(messages))
    gc.collect()
    with answering as end:
        begun = time.process_time()
        deadline = time.monotonic()
        for index, message in enumerate(messages):
            deadline = max(deadline + 1.0 / RATE_HZ, time.monotonic())
            time.sleep(max(0.0, deadline - time.monotonic()))
            sent = time.perf_counter()
            end.send(message)
            answer = end.receive()
            taken[index] = time.perf_counter() - sent
            if answer != message:
                raise BenchError(f"{name}: message {index} of {size} bytes was not answered by it")
        own_s = time.process_time() - begun
    p50, p99 = 1e6 * np.percentile(taken[WARM_UP:], (50, 99))
    cpu_us = 1e6 * (own_s + answering.cpu_s) / len(messages)
    return Round(name, size, float(p50), float(p99), cpu_us)


class Answering:
    """A process that sends back what it receives; entering it gives this process's end.

    Attributes:
        cpu_s: the CPU time that it has taken, once it has ended.
    """

    def __init__(self, make: Callable[[], Carrier]) -> None:
        self._carrier = make()
        self._pid = 0
        self.cpu_s = 0.0

    def __enter__(self) -> End:
        """Start it."""
        wake_up_in_time()
        own_pid = os.getpid()
        self._pid = os.fork()
        if not self._pid:
            code = 1
            try:
                end = self._carrier.end(first=False)
                # As long as anybody can ask: a pause of the other process is not its end.
                while os.getppid() == own_pid:
                    if message := end.receive():
                        end.send(message)
                code = 0
            finally:
                os._exit(code)
        end = self._carrier.end(first=True)
        # Ends that find each other by name need a while. Each attempt is another message: the late
        # answer of an earlier one is not taken for the answer of the first message that is timed.
        deadline = time.monotonic() + MEETS_WITHIN_S
        attempt = 0
        while time.monotonic() < deadline:
            attempt += 1
            first = f"first {attempt}".encode()
            end.send(first)
            while answer := end.receive():
                if answer == first:
                    return end
        self.__exit__()
        raise BenchError("the other process does not answer")

    def __exit__(self, *error: object) -> None:
        """End it."""
        os.kill(self._pid, signal.SIGKILL)
        _, _, used = os.wait4(self._pid, 0)
        self.cpu_s = used.ru_utime + used.ru_stime


def carriers(
    rounds: Annotated[int, typer.Option(min=1, help="of all carriers")] = 5,
    seconds: Annotated[float, typer.Option(min=0.1, help="for each carrier in a round")] = 3.0,
    out: OutOption = Path("bench"),
    json_only: JsonOption = False,
) -> None:
    """Compare ways of a message from one process to another of the same host."""
    carry_out(lambda show: run_benchmark(rounds, seconds, show), out, json_only)
