# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Processors: their numbers as Linux writes them (``0,2-3``), and how many this process may use."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path, PurePosixPath

from hapticmech_ros.errors import InvalidInputError

ANY = "any"
_RULE = "must be numbers and ranges of CPUs, such as 0,2-3, or 'any'"
# Control groups of versions 2 and 1, and where a process's own are listed.
GROUPS, OWN_GROUPS = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")
_PART = re.compile(r"(\d{1,4})(?:-(\d{1,4}))?")


def cpus_of(text: str) -> frozenset[int]:
    """Return the processors that a list names; none for an empty one, and for :data:`ANY`.

    Raises:
        InvalidInputError: no such list.
    """
    found: set[int] = set()
    for part in text.split(",") if text.strip() not in ("", ANY) else ():
        match = _PART.fullmatch(part.strip())
        if match is None:
            raise InvalidInputError("cpu_affinity", text, _RULE)
        first = int(match[1])
        last = first if match[2] is None else int(match[2])
        if last < first:
            raise InvalidInputError("cpu_affinity", text, _RULE)
        found.update(range(first, last + 1))
    return frozenset(found)


def listed(cpus: Iterable[int]) -> str:
    """Return processors as a list, neighbours as ranges."""
    runs: list[list[int]] = []
    for cpu in sorted(cpus):
        if runs and cpu == runs[-1][1] + 1:
            runs[-1][1] = cpu
        else:
            runs.append([cpu, cpu])
    return ",".join(str(a) if a == b else f"{a}-{b}" for a, b in runs)


def available_cores() -> float:
    """Return how many processors this process may use: its affinity, and quotas of its groups.

    A container with ``--cpus 1.5`` has 1.5, with any number of visible processors.
    """
    found = float(len(os.sched_getaffinity(0)))
    with suppress(OSError):
        for line in OWN_GROUPS.read_text(encoding="utf-8").splitlines():
            _, controllers, name = line.split(":", 2)
            folder = GROUPS / "cpu" if "cpu" in controllers.split(",") else GROUPS
            if controllers and folder == GROUPS:
                continue
            own = PurePosixPath(name.lstrip("/"))
            for group in (own, *own.parents):
                found = min(found, _quota(folder / group))
    return found


def _quota(group: Path) -> float:
    """Return how many processors a control group may use; infinity: any number."""
    with suppress(OSError, ValueError):
        most, period = (group / "cpu.max").read_text(encoding="ascii").split()
        return float("inf") if most == "max" else int(most) / int(period)
    with suppress(OSError, ValueError):
        most = (group / "cpu.cfs_quota_us").read_text(encoding="ascii")
        period = (group / "cpu.cfs_period_us").read_text(encoding="ascii")
        return int(most) / int(period) if int(most) > 0 else float("inf")
    return float("inf")
