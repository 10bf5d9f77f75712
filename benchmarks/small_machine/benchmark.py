# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether ``hapticmech demo`` works on a small and busy machine, and what else does beside it."""

from __future__ import annotations

import math
import os
import signal
import statistics
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Annotated, ClassVar

import typer

from benchmarks.children import BenchError, busy_programs
from benchmarks.machine import MachineResults, machine
from benchmarks.small_machine.cpu_group import NoGroupError, cpu_group, places
from benchmarks.small_machine.demo_run import (
    LOST,
    NOMINAL,
    SCENE,
    DemoRun,
    demo_command,
    watch_demo,
)
from benchmarks.small_machine.reader import Within, read_beside
from benchmarks.words import refuse_unknown
from hapticmech_ros.analysis.study import NOTHING, Sheet, Show, judged, number, silent
from hapticmech_ros.cli.console import OutOption, words
from hapticmech_ros.cli.study import JsonOption, carry_out
from hapticmech_ros.compilation.library import compile_ahead
from hapticmech_ros.graph.processes import RATES

PROCESSORS, BUSY, CORES = 2, 2, 1.2
# Figures of a summary about the graph, and how they are shown.
SHOWN = {
    "measured_rate_hz": ".1f",
    "missed_deadlines": ".0f",
    "loop_latency_p50_us": ".0f",
    "loop_latency_p99_us": ".0f",
    LOST: ".0f",
}
LOADS = ("alone", "busy", "quota")
# Beside a graph and nothing else, an ordinary program has read a message so many s after its start.
READS_WITHIN_S = 1.0


@dataclass(frozen=True, slots=True)
class Settings:
    """What is run.

    Attributes:
        runs: under each load.
        limit_s: s that a run may take, the start of its processes included.
        cores: quota of the load ``quota``, in processors.
        duration: s that the hand pushes; the scene's if None.
        loads: of :data:`LOADS`.
        readers: programs that are started beside a graph afterwards, at the rate of the last run in
            real time, or the demo's lowest.

    Raises:
        InvalidInputError: an unknown load.
    """

    runs: int = 10
    limit_s: float = 60.0
    cores: float = CORES
    duration: float | None = None
    loads: tuple[str, ...] = LOADS
    readers: int = 5

    def __post_init__(self) -> None:
        refuse_unknown("load", self.loads, LOADS)

    def words(self, load: str) -> str:
        """Return what a load is."""
        return {
            "alone": "alone",
            "busy": f"beside {BUSY} busy programs",
            "quota": f"quota of {self.cores:g} processors",
        }[load]


@dataclass(frozen=True, slots=True)
class Loaded:
    """All runs under one load.

    Attributes:
        load: by name.
        runs: in order.
        skipped: why there is none; empty if there are.
        reads_s: s from the start of a program beside the graph until it had read a message.
    """

    load: str
    runs: tuple[DemoRun, ...] = ()
    skipped: str = ""
    reads_s: tuple[float, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether there were runs, and all passed."""
        return bool(self.runs) and all(run.passed for run in self.runs)

    @property
    def read_in_time(self) -> bool:
        """Whether programs beside the graph alone read within :data:`READS_WITHIN_S`."""
        return self.load != "alone" or max(self.reads_s, default=0.0) <= READS_WITHIN_S

    def row(self, words: str) -> tuple[str, ...]:
        """Return a line of the table, medians of those runs that have figures."""
        if self.skipped:
            return words, "skipped", *[NOTHING] * 9
        seconds = [run.seconds for run in self.runs]
        return (
            words,
            judged(f"{sum(run.passed for run in self.runs)} of {len(self.runs)}", self.passed),
            self._rates() or NOTHING,
            f"{statistics.median(seconds):.1f}",
            f"{max(seconds):.1f}",
            *(number(self._median(name), style) for name, style in SHOWN.items()),
            self._reads(),
        )

    def _rates(self) -> str:
        """Return the rates, and how many runs advanced by messages instead."""
        rates = {rate for run in self.runs if (rate := run.figure(NOMINAL)) is not None}
        without = sum(run.figure(NOMINAL) is None for run in self.runs if run.passed)
        lockstep = [f"{without} in lockstep"] if without else []
        return ", ".join([*(f"{rate:g}" for rate in sorted(rates, reverse=True)), *lockstep])

    def _reads(self) -> str:
        if not self.reads_s:
            return NOTHING
        told = f"{statistics.median(self.reads_s):.2f} ({max(self.reads_s):.2f})"
        return judged(told, self.read_in_time) if self.load == "alone" else told

    def _median(self, name: str) -> float | None:
        values = [value for run in self.runs if (value := run.figure(name)) is not None]
        return statistics.median(values) if values else None


@dataclass(frozen=True)
class SmallMachineResults(MachineResults):
    """All runs.

    Attributes:
        settings: what was to be run.
        loads: under which.
    """

    NAME: ClassVar[str] = "bench_small_machine"
    FAULT: ClassVar[str] = "a run of the demo did not pass, or a program beside it came too late"

    settings: Settings
    loads: tuple[Loaded, ...]

    @property
    def sound(self) -> bool:
        """Whether all passed, of those loads that were not skipped."""
        return all(one.passed and one.read_in_time for one in self.loads if not one.skipped)

    def sheets(self) -> Iterator[Sheet]:
        """Yield a line for each load."""
        times = ("seconds", "longest", "measured, Hz", "missed", "p50, µs", "p99, µs", "lost")
        headings = ("load", "passed", "rate, Hz", *times, "a program, s")
        rows = tuple(one.row(self.settings.words(one.load)) for one in self.loads)
        caption = (
            f"passed: done within {self.settings.limit_s:g} s with right physics; medians: time of "
            "the command, rate of the device, deadlines missed by all nodes, sample to answer, "
            "messages lost by the recorder; a program: from its start until it has read from "
            "a graph at the last run's rate in real time, median (longest), beside it alone within "
            f"{READS_WITHIN_S:g} s"
        )
        yield Sheet(f"hapticmech demo {SCENE}", headings, rows, caption=caption, kept=40)

    def notes(self) -> list[str]:
        """Return what was skipped, what failed, and what the machine is."""
        told = []
        for one in self.loads:
            words = self.settings.words(one.load)
            if one.skipped:
                told.append(f"{words}: skipped: {one.skipped}")
            for index, run in enumerate(one.runs, start=1):
                if not run.passed:
                    why = "; ".join(run.failures)
                    told.append(f"{words}, run {index}: {why}; last line: {run.last_line}")
        return [*told, *super().notes()]


def run_small_machine(settings: Settings, out: Path, show: Show = silent) -> SmallMachineResults:
    """Run the demo under each load in turn, on two processors.

    What each run wrote, and printed, is in ``out/small_machine/<load>/<number>``.

    Raises:
        BenchError: hapticmech is not installed, or a group could not be removed.
    """
    # Once, and in no run's time.
    compile_ahead()
    with _ended_in_order(), _pinned():
        folder = out / "small_machine"
        loads = tuple(_under(load, settings, folder, show) for load in settings.loads)
        return SmallMachineResults(machine(), settings, loads)


def small_machine(
    runs: Annotated[int, typer.Option(min=1, help="under each load")] = 10,
    quick: Annotated[bool, typer.Option("--quick", help="one run under each load")] = False,
    limit: Annotated[float, typer.Option(min=1.0, help="s that a run may take")] = 60.0,
    cores: Annotated[float, typer.Option(min=0.2, help="processors of the quota")] = CORES,
    duration: Annotated[
        float | None,
        # The second joint constraint is felt after 2.3 s.
        typer.Option(min=3.0, help="s that the hand pushes", show_default="the scene's"),
    ] = None,
    loads: Annotated[str, typer.Option(help="of alone, busy and quota")] = ",".join(LOADS),
    readers: Annotated[int, typer.Option(min=0, help="programs beside a graph, each load")] = 5,
    out: OutOption = Path("bench"),
    json_only: JsonOption = False,
) -> None:
    """Run hapticmech demo alone, beside busy programs, and with a quota of processor time."""
    settings = Settings(1 if quick else runs, limit, cores, duration, words(loads), readers)
    carry_out(lambda show: run_small_machine(settings, out, show), out, json_only)


def _under(load: str, settings: Settings, out: Path, show: Show) -> Loaded:
    """Return all runs under a load, or why there are none."""
    runs: list[DemoRun] = []
    reads_s: tuple[float, ...] = ()
    try:
        with _loaded(load, settings.cores) as within:
            for index in range(1, settings.runs + 1):
                show(f"{settings.words(load)}: run {index} of {settings.runs}")
                folder = out / load / f"{index}"
                command = within(demo_command(folder, settings.duration))
                runs.append(watch_demo(command, folder, settings.limit_s))
                if not runs[-1].passed:
                    show(f"  did not pass: {'; '.join(runs[-1].failures)}")
            rates = [rate for run in runs if (rate := run.figure(NOMINAL)) is not None]
            if settings.readers:
                rate_hz = rates[-1] if rates else min(RATES)
                show(f"{settings.words(load)}: {settings.readers} programs beside a graph")
                log = folder.with_name("graph.log")
                try:
                    reads_s = read_beside(rate_hz, within, settings.readers, log)
                except BenchError as error:
                    # The runs before it count all the same.
                    show(f"  {error}")
                    reads_s = (math.inf,)
    except NoGroupError as error:
        show(f"{settings.words(load)}: skipped: {error}")
        return Loaded(load, skipped=str(error))
    return Loaded(load, tuple(runs), reads_s=reads_s)


@contextmanager
def _loaded(load: str, cores: float) -> Iterator[Within]:
    """Keep up a load, and yield what takes a command under it.

    Raises:
        NoGroupError: the system does not let this user.
    """
    if load == "quota":
        with cpu_group(cores, places()) as group:
            yield group.within
        return
    with busy_programs(BUSY if load == "busy" else 0):
        yield list


@contextmanager
def _pinned() -> Iterator[None]:
    """Stay on two processors meanwhile, with all that is started."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(before)[:PROCESSORS])
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


@contextmanager
def _ended_in_order() -> Iterator[None]:
    """Let signals that ask this process to end do so as Ctrl-C does: groups are removed."""

    def end(number: int, frame: FrameType | None) -> None:
        for one in before:
            signal.signal(one, signal.SIG_IGN)
        raise SystemExit(128 + number)

    before = {one: signal.signal(one, end) for one in (signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
