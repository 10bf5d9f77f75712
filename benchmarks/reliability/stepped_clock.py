# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A clock of the day that a test steps: of one process, of one host's, or of all.

The processes load a small library before the C library (LD_PRELOAD) that adds an offset to
whatever tells the time of day. The offset stands in a file of 8 bytes that all of them map: to
write it is to step their clocks, all at once. Monotonic clocks go on as they are, and so does the
clock of every process that does not load the library.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.numerics.times import NANOSECONDS

SOURCE = Path(__file__).with_name("clock_shim.c")


class NoCompilerError(HapticMechError):
    """No C compiler: clocks cannot be stepped on this machine."""


def compiler() -> str:
    """Return the C compiler of this machine, a path.

    Raises:
        NoCompilerError: there is none.
    """
    for path in filter(None, map(shutil.which, ("cc", "gcc", "clang"))):
        return path
    raise NoCompilerError("no C compiler (cc, gcc, clang), and the stepped clock needs one")


class SteppedClock(AbstractContextManager["SteppedClock"]):
    """The clock of the processes that are started with :meth:`environment`.

    It begins at the machine's time, and builds the library unless that is there.

    Args:
        folder: for the library and the offset; must exist as long as the processes run.
        name: of this clock: several share a folder.

    Raises:
        NoCompilerError: there is no C compiler.
        HapticMechError: the library cannot be built.
    """

    def __init__(self, folder: Path, name: str = "clock") -> None:
        self._library = folder / "clock_shim.so"
        self._path = folder / f"{name}.offset"
        if not self._library.exists():
            build(self._library)
        self._offset = np.memmap(self._path, np.int64, "w+", shape=1)

    def __exit__(self, *error: object) -> None:
        """Leave the offset to the processes that live by it."""

    def environment(self, environment: Mapping[str, str] | None = None) -> dict[str, str]:
        """Return an environment (this process's if left out) whose processes have this clock."""
        given = dict(os.environ if environment is None else environment)
        loaded = [str(self._library), *given.get("LD_PRELOAD", "").split()]
        return {**given, "LD_PRELOAD": " ".join(loaded), "STEPPED_CLOCK": str(self._path)}

    @property
    def offset_ns(self) -> int:
        """How far the clock is ahead of the machine's, ns."""
        return int(self._offset[0])

    def step(self, seconds: float) -> int:
        """Step the clock forward, or back if negative; return when, ns of the monotonic clock."""
        offset_ns, when = self.offset_ns + round(seconds * NANOSECONDS), time.monotonic_ns()
        # Eight bytes at an aligned place: whoever reads sees the old offset or the new one.
        self._offset[0] = offset_ns
        return when


def build(library: Path) -> None:
    """Compile the library that steps clocks.

    Raises:
        NoCompilerError: there is no C compiler.
        HapticMechError: it refuses the source.
    """
    partial = library.with_suffix(f".{os.getpid()}")
    files = ["-o", str(partial), str(SOURCE)]
    command = [compiler(), "-O2", "-shared", "-fPIC", *files, "-ldl", "-pthread"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise HapticMechError(f"{SOURCE.name}: cannot be built: {done.stderr.strip()[-400:]}")
    partial.rename(library)
