# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A group of processes with a quota of processor time: Linux' control groups, version 1 or 2."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from benchmarks.children import BenchError
from benchmarks.machine import PROC
from hapticmech_ros.errors import HapticMechError

# Short, so that a group that has used up its quota waits for milliseconds and not for a tenth of a
# second: so is a slower processor.
PERIOD_US = 5000
# Linux refuses quotas below.
LEAST_QUOTA_US = 1000
PREFIX = "hapticmech_"
EMPTY_WITHIN_S, LOOK_AGAIN_S = 5.0, 0.02


class NoGroupError(HapticMechError):
    """This user cannot make a group with a quota on this machine."""


@dataclass(frozen=True, slots=True)
class CpuGroup:
    """A group of processes.

    Attributes:
        folder: of the control group.
    """

    folder: Path

    def within(self, command: Sequence[str]) -> list[str]:
        """Return a command that does the same, with all that it starts, in the group."""
        # A shell becomes the command: whoever starts it has one process, with one id.
        script = 'echo $$ > "$0" && exec "$@"'
        return ["/bin/sh", "-c", script, str(self.folder / "cgroup.procs"), *command]


@contextmanager
def cpu_group(cores: float, places: Sequence[Path]) -> Iterator[CpuGroup]:
    """Yield a new group; afterwards end what is in it, and remove it.

    Args:
        cores: quota, in processors.
        places: control groups in which it may be made, the first possible one is taken.

    Raises:
        NoGroupError: in none of them.
        BenchError: it could not be removed.
    """
    group = _made(cores, places)
    try:
        yield group
    finally:
        _remove(group.folder)


def places(process: Path = PROC / "self") -> list[Path]:
    """Return the control groups of processor time that a process is in, the innermost first.

    Args:
        process: folder of the process in /proc.
    """
    own = {}
    for line in (process / "cgroup").read_text(encoding="utf-8").splitlines():
        _, controllers, path = line.split(":", 2)
        own.update(dict.fromkeys(controllers.split(","), path))
    found = []
    for line in (process / "mounts").read_text(encoding="utf-8").splitlines():
        _, mount, kind, options, *_ = line.split(" ")
        if kind == "cgroup" and "cpu" in options.split(","):
            path = own.get("cpu", "/")
        elif kind == "cgroup2":
            path = own.get("", "/")
        else:
            continue
        inner = Path(path.lstrip("/"))
        found += [Path(mount) / part for part in (inner, *inner.parents)]
    # In a container the path may be that of its host.
    return [folder for folder in dict.fromkeys(found) if folder.is_dir()]


def _made(cores: float, places: Sequence[Path]) -> CpuGroup:
    reasons = []
    for place in places:
        _remove_left_behind(place)
        folder = place / f"{PREFIX}{os.getpid()}"
        try:
            folder.mkdir()
        except OSError as error:
            reasons.append(f"{place}: {error.strerror}")
            continue
        group = CpuGroup(folder)
        try:
            _limit(folder, cores)
            if subprocess.run(group.within(["true"]), check=False, capture_output=True).returncode:
                raise NoGroupError("no process may enter a group there")
        except BaseException as error:
            _remove(folder)
            if not isinstance(error, OSError | NoGroupError):
                raise
            reasons.append(f"{place}: {getattr(error, 'strerror', None) or error}")
        else:
            return group
    why = "; ".join(reasons) or "no control group of processor time is mounted"
    raise NoGroupError(f"this user cannot make a group with a quota of processor time ({why})")


def _limit(folder: Path, cores: float) -> None:
    quota = max(round(cores * PERIOD_US), LEAST_QUOTA_US)
    if (folder / "cpu.max").exists():
        (folder / "cpu.max").write_text(f"{quota} {PERIOD_US}", encoding="ascii")
    elif (folder / "cpu.cfs_quota_us").exists():
        (folder / "cpu.cfs_period_us").write_text(f"{PERIOD_US}", encoding="ascii")
        (folder / "cpu.cfs_quota_us").write_text(f"{quota}", encoding="ascii")
    else:
        raise NoGroupError("groups have no quota there")


def _remove_left_behind(place: Path) -> None:
    """Remove empty groups of processes that were killed before they could do so."""
    for folder in place.glob(f"{PREFIX}*"):
        maker = folder.name.removeprefix(PREFIX)
        if maker.isdecimal() and (maker == f"{os.getpid()}" or not (PROC / maker).exists()):
            with suppress(OSError):
                folder.rmdir()


def _remove(folder: Path) -> None:
    """End the processes of a group, and remove it.

    Raises:
        BenchError: it cannot be removed in time.
    """
    end = time.monotonic() + EMPTY_WITHIN_S
    while True:
        try:
            for member in (folder / "cgroup.procs").read_text(encoding="ascii").split():
                with suppress(ProcessLookupError):
                    os.kill(int(member), signal.SIGKILL)
            folder.rmdir()
        except OSError as error:
            if time.monotonic() > end:
                raise BenchError(f"{folder}: cannot be removed: {error.strerror}") from None
            time.sleep(LOOK_AGAIN_S)
        else:
            return
