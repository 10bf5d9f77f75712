# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What Linux says of processes and of the machine, in /proc, and how fast the machine is."""

from __future__ import annotations

import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from hapticmech_ros.analysis.study import Results

PROC = Path("/proc")
# Fixed work by which figures of different days are compared: about 50 ms in all.
SCENE, SUMMED = "five_bar", 10_000
ANALYSES, REPEATS = 50, 51


@dataclass(frozen=True, slots=True)
class Usage:
    """Counters at one time.

    Attributes:
        time_s: of a monotonic clock.
        cpu_s: CPU time by name of process.
        all_s, idle_s, steal_s: of all cores together; stolen is what the host gave to others.
    """

    time_s: float
    cpu_s: Mapping[str, float]
    all_s: float
    idle_s: float
    steal_s: float


@dataclass(frozen=True, slots=True)
class MachineLoad:
    """The machine during a window.

    Attributes:
        cpu: share of one core by name of process.
        busy: share of all cores that was not idle, by whomever.
        stolen: share of all cores that the host gave to others.
        load_1min: load average at the end.
    """

    cpu: Mapping[str, float]
    busy: float
    stolen: float
    load_1min: float


def usage(processes: Mapping[str, int]) -> Usage:
    """Return the counters now, of processes by name (ids); one that has ended is left out."""
    tick = os.sysconf("SC_CLK_TCK")
    cpu = {}
    for name, pid in processes.items():
        try:
            text = (PROC / str(pid) / "stat").read_text(encoding="utf-8")
        except (FileNotFoundError, ProcessLookupError):
            continue
        cpu[name] = cpu_ticks(text) / tick
    line = (PROC / "stat").read_text(encoding="utf-8").splitlines()[0]
    # user nice system idle iowait irq softirq steal; guest time is within user and nice.
    values = [int(value) / tick for value in line.split()[1:9]]
    return Usage(time.monotonic(), cpu, sum(values), values[3] + values[4], values[7])


def cpu_ticks(stat: str) -> int:
    """Return user and system time of a line of /proc/PID/stat, clock ticks."""
    # The name, in brackets, may hold anything.
    rest = stat.rsplit(")", 1)[1].split()
    return int(rest[11]) + int(rest[12])


def load_between(before: Usage, after: Usage) -> MachineLoad:
    """Return the load from one time to a later one."""
    elapsed = max(after.time_s - before.time_s, 1e-9)
    whole = max(after.all_s - before.all_s, 1e-9)
    cpu = {n: (s - before.cpu_s[n]) / elapsed for n, s in after.cpu_s.items() if n in before.cpu_s}
    idle = after.idle_s - before.idle_s
    stolen = (after.steal_s - before.steal_s) / whole
    return MachineLoad(cpu, 1.0 - idle / whole, stolen, os.getloadavg()[0])


def machine() -> dict[str, object]:
    """Return what a reader has to know of the machine: what it is, and how fast at the moment."""
    return {
        "cores": len(os.sched_getaffinity(0)),
        "processor": _processor(),
        "kernel": platform.release(),
        "python": platform.python_version(),
        **speed(),
    }


def speed() -> dict[str, float]:
    """Return how long fixed work takes, medians of CPU time, µs.

    ``analysis_us`` is a call of the kernel that analyses the shipped five-bar, ``python_loop_us``
    the sum of a range in Python.
    """
    # Not before: what these import would count in the memory of a benchmark that does not use it.
    from hapticmech_ros.loading import load_scene
    from hapticmech_ros.operational import Analyser
    from hapticmech_ros.simulation import Simulator

    simulator = Simulator(load_scene(SCENE))
    analyser, state = Analyser(simulator.mechanism), simulator.initial_state()

    def analyse() -> None:
        for _ in range(ANALYSES):
            analyser.observe(state.q, state.v, state.active)

    def add() -> None:
        sum(range(SUMMED))

    return {"analysis_us": _median_us(analyse) / ANALYSES, "python_loop_us": _median_us(add)}


def speed_line(facts: Mapping[str, object]) -> str:
    """Return what :func:`machine` tells of the speed, in a line."""
    return (
        f"speed of this machine: {facts['analysis_us']:.2f} µs for one analysis of {SCENE}, "
        f"{facts['python_loop_us']:.0f} µs for sum(range({SUMMED:_}))"
    )


def _median_us(work: Callable[[], None]) -> float:
    work()
    times = []
    for _ in range(REPEATS):
        begun = time.thread_time_ns()
        work()
        times.append(time.thread_time_ns() - begun)
    return 1e-3 * statistics.median(times)


def _processor() -> str:
    for line in (PROC / "cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()


@dataclass(frozen=True)
class MachineResults(Results):
    """Results that depend on the machine.

    Attributes:
        machine: cores, kernel, versions, speed.
    """

    machine: Mapping[str, object]

    def notes(self) -> list[str]:
        """Return what the machine is, in a line, and how fast, in another."""
        known = {name: value for name, value in self.machine.items() if not name.endswith("_us")}
        about = ", ".join(f"{name} {value}" for name, value in known.items())
        return [about, speed_line(self.machine)]

    def markdown(self) -> str:
        """Return the tables for a document, and below them how fast the machine was."""
        return f"{super().markdown()}\n{speed_line(self.machine)}\n"
