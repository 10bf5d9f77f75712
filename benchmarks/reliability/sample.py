# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the watcher keeps of each control message, in a ring that another process reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

# Of the messages: which topic, when it arrived (ns, monotonic clock), its stamp (ns), the number by
# which its publisher counts it, force (N) and torque (N m) that it tells of; what is not finite, or
# cannot be read, is NaN.
SAMPLE = np.dtype(
    [
        ("topic", "i8"),
        ("arrived_ns", "i8"),
        ("stamp_ns", "i8"),
        ("number", "i8"),
        ("force", "f8"),
        ("torque", "f8"),
    ]
)
DEVICE, COMMAND, MECHANISM, POINT_MODEL = range(4)
# Ten minutes of four topics at 1 kHz; the disk sees what is written.
CAPACITY = 1 << 22
COUNT_BYTES = 8

Samples = npt.NDArray[np.void]


class Ring:
    """Samples in a file: one process writes, another reads what was written since.

    Args:
        path: of the file.
        fresh: make it anew, empty.
    """

    def __init__(self, path: Path, fresh: bool = False) -> None:
        size = COUNT_BYTES + CAPACITY * SAMPLE.itemsize
        if fresh:
            with path.open("wb") as file:
                file.truncate(size)
        raw = np.memmap(path, np.uint8, "r+", shape=(size,))
        self._count = raw[:COUNT_BYTES].view("i8")
        self._samples = raw[COUNT_BYTES:].view(SAMPLE)

    @property
    def count(self) -> int:
        """How many samples were written, ever."""
        return int(self._count[0])

    def put(self, sample: tuple[int, int, int, int, float, float]) -> None:
        """Write a sample, in the order of :data:`SAMPLE`, then count it."""
        count = self._count[0]
        self._samples[count % CAPACITY] = sample
        self._count[0] = count + 1

    def since(self, number: int) -> Samples:
        """Return the samples from a number on, of which the ring may have lost the oldest."""
        count = self.count
        return self._samples[np.arange(max(number, count - CAPACITY), count) % CAPACITY]
