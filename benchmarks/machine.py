# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What Linux says of processes and of the whole machine, in /proc."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from hapticmech_ros.analysis.study import Results

PROC = Path("/proc")


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
    """Return what a reader has to know of the machine."""
    return {
        "cores": len(os.sched_getaffinity(0)),
        "processor": _processor(),
        "kernel": platform.release(),
        "python": platform.python_version(),
    }


def _processor() -> str:
    for line in (PROC / "cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()


@dataclass(frozen=True)
class MachineResults(Results):
    """Results that depend on the machine.

    Attributes:
        machine: cores, kernel, versions.
    """

    machine: Mapping[str, object]

    def notes(self) -> list[str]:
        """Return what the machine is, in a line."""
        return [", ".join(f"{name} {value}" for name, value in self.machine.items())]
