# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How much a process keeps of each message that it hears: memory against messages."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from benchmarks.reliability.figure import Figure
from benchmarks.reliability.usage import LEAST_SAMPLES, WARM_UP_SHARE, grown

MEBI = float(1 << 20)
# What is kept of a message takes 16 bytes at least: the smallest that malloc and Python give. What
# fills up by itself, such as caches and arenas, may take 2 MiB in a run of any length.
MOST_BYTES, LEAST_LIMIT_MEBI = 16.0, 2.0
# Samples of a run, evenly over its messages.
SAMPLES = 60


@dataclass(slots=True)
class MemoryGrowth:
    """Samples of a process's memory over the messages that were sent.

    Attributes:
        sent: messages until then, rising.
        resident: bytes in memory then.
    """

    sent: list[int] = field(default_factory=list)
    resident: list[float] = field(default_factory=list)

    def due(self, sent: int, count: int) -> bool:
        """Return whether it is time for a sample, of so many of ``count`` messages."""
        return not self.sent or sent - self.sent[-1] >= max(1, count // SAMPLES)

    def add(self, sent: int, resident: float) -> None:
        """Take a sample."""
        self.sent.append(sent)
        self.resident.append(resident)

    @property
    def mebi(self) -> float:
        """Growth after the first quarter, MiB; NaN of too few samples, or of the dead."""
        enough = len(self.sent) * (1.0 - WARM_UP_SHARE) >= LEAST_SAMPLES + 1
        known = enough and np.isfinite(self.resident).all()
        return grown(self.sent, self.resident) / MEBI if known else math.nan

    @property
    def limit_mebi(self) -> float:
        """How much it may grow, MiB."""
        messages = (1.0 - WARM_UP_SHARE) * (self.sent[-1] - self.sent[0]) if self.sent else 0.0
        return max(LEAST_LIMIT_MEBI, MOST_BYTES * messages / MEBI)


def worst_growth(where: str, found: Sequence[MemoryGrowth], trials: int) -> Figure:
    """Return the growth that is most above what it may be; not measured if one of them was not.

    Args:
        where: the messages were sent.
        found: of each process, or of each run in one.
        trials: messages.
    """
    unknown = any(math.isnan(one.mebi) for one in found)
    worst = max(found, key=lambda one: one.mebi / one.limit_mebi, default=None)
    value = math.nan if unknown or worst is None else worst.mebi
    limit = LEAST_LIMIT_MEBI if worst is None else worst.limit_mebi
    return Figure(f"{where}: memory's growth", value, "MiB", limit, None, trials)
