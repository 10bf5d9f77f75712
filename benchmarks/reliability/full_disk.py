# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A disk of a few megabytes, and full when asked for. Needs root, as mounting does."""

from __future__ import annotations

import os
import subprocess
from contextlib import suppress
from pathlib import Path

from hapticmech_ros.errors import HapticMechError

_BLOCK = bytes(4096)


class NoDiskError(HapticMechError):
    """This machine lets nobody mount a disk in memory."""


class FullDisk:
    """A disk in memory. Use as a context manager: leaving it takes the disk away.

    Args:
        path: folder to be made, where it is mounted.
        megabytes: its size.
    """

    def __init__(self, path: Path, megabytes: int) -> None:
        self.path = path
        self._size = f"size={megabytes}m"

    def fill(self) -> None:
        """Leave no room on it."""
        with (self.path / "filler").open("ab", buffering=0) as file, suppress(OSError):
            while file.write(_BLOCK):
                pass

    def __enter__(self) -> FullDisk:
        if os.geteuid():
            raise NoDiskError("a disk in memory needs root")
        self.path.mkdir(parents=True, exist_ok=True)
        command = ["mount", "-t", "tmpfs", "-o", self._size, "tmpfs", str(self.path)]
        done = subprocess.run(command, check=False, capture_output=True, text=True)
        if done.returncode:
            raise NoDiskError(done.stderr.strip())
        return self

    def __exit__(self, *error: object) -> None:
        # Also while somebody has a file of it open still.
        subprocess.run(["umount", "--lazy", str(self.path)], check=False, capture_output=True)
