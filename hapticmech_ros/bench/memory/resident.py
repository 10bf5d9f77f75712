"""What Linux says of a process's memory, in /proc."""

from __future__ import annotations

import re
from typing import NamedTuple

from hapticmech_ros.bench.machine import PROC

_RSS = re.compile(r"^VmRSS:\s+(\d+) kB$", re.MULTILINE)
_DIRTY = re.compile(r"^Private_Dirty:\s+(\d+) kB$", re.MULTILINE)
_KILO = 1024


class Resident(NamedTuple):
    """Memory of a process at one time, bytes.

    Attributes:
        resident: VmRSS, all pages that are in memory, shared ones included.
        private: pages that it alone has and has written to; NaN where the kernel does not tell.
    """

    resident: float
    private: float


def resident(pid: int) -> Resident | None:
    """Return the memory of a process now; None if there is no such process any more."""
    try:
        status = (PROC / str(pid) / "status").read_text(encoding="utf-8")
    except (FileNotFoundError, ProcessLookupError):
        return None
    size = _RSS.search(status)
    if size is None:  # It has ended, and waits for its parent.
        return None
    try:
        rollup = (PROC / str(pid) / "smaps_rollup").read_text(encoding="utf-8")
    except OSError:  # Older kernels have no such file; others' processes do not show theirs.
        rollup = ""
    dirty = _DIRTY.search(rollup)
    return Resident(
        float(_KILO * int(size[1])), float("nan") if dirty is None else float(_KILO * int(dirty[1]))
    )
