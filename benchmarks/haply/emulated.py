# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The emulated service as a process, and what its device did."""

from __future__ import annotations

import re
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np

from benchmarks.children import STARTS_WITHIN_S, BenchError, next_line
from hapticmech_ros.graph.processes import private_environment, start_process, stop_process
from hapticmech_ros.numerics import Array


class Emulator:
    """The process of ``hapticmech device emulate inverse3``.

    Args:
        arguments: of the command.
        port: to serve at; 0: any that is free.

    Attributes:
        process: of it.
        port: at which it serves.
    """

    def __init__(self, *arguments: str, port: int = 0) -> None:
        emulate = [sys.executable, "-m", "hapticmech_ros", "device", "emulate", "inverse3"]
        self.process: subprocess.Popen[str] = start_process(
            [*emulate, "--port", str(port), *arguments], private_environment(), pipe_output=True
        )
        line = next_line(self.process, STARTS_WITHIN_S)
        if (found := re.search(r"ws://127\.0\.0\.1:(\d+)", line or "")) is None:
            stop_process(self.process)
            raise BenchError(f"the emulator does not start: {line!r}")
        self.port = int(found[1])

    @property
    def uri(self) -> str:
        """Address of the service."""
        return f"ws://127.0.0.1:{self.port}"

    def kill(self) -> None:
        """End it as a crash would."""
        self.process.kill()
        self.close()

    def close(self) -> None:
        """End it if it still runs."""
        stop_process(self.process)
        if self.process.stdout is not None:
            self.process.stdout.close()


def emulated(*arguments: str, port: int = 0) -> closing[Emulator]:
    """Run the service for as long as the block lasts."""
    return closing(Emulator(*arguments, port=port))


class Trace:
    """What the emulated device did, read as it is written.

    Args:
        path: that the emulator was given.

    Attributes:
        rows: (n, 10) time by the monotonic clock, s; position, force of the actuators and force of
            the hand, m and N, axes of the world.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._read, self._rest = path, 0, ""
        self.rows: Array = np.empty((0, 10))

    def look(self) -> Array:
        """Read what is new, and return all rows."""
        if self._path.exists():
            with self._path.open(encoding="utf-8") as stream:
                stream.seek(self._read)
                text = self._rest + stream.read()
                self._read = stream.tell()
            lines, _, self._rest = text.rpartition("\n")
            new = [line for line in lines.splitlines() if line and not line.startswith("time")]
            if new:
                self.rows = np.vstack((self.rows, np.loadtxt(new, delimiter=",", ndmin=2)))
        return self.rows

    def force_since(self, time: float) -> tuple[Array, Array]:
        """Return times (n,), s, and the norms (n,) of the actuators' force, N, from a time on."""
        rows = self.look()
        rows = rows[rows[:, 0] >= time]
        return rows[:, 0], np.linalg.norm(rows[:, 4:7], axis=1)
