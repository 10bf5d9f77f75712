# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Part ``soak``: the graph renders for an hour; nothing of its processes grows."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.reliability.figure import Figure
from benchmarks.reliability.rig import Rig, pushing
from benchmarks.reliability.trial import GOAL_PEAK
from benchmarks.reliability.usage import Usage, grown, usage
from hapticmech_ros.nodes.entry import NODES

PART = "soak"
SOAK_S, QUICK_SOAK_S = 3600.0, 60.0
SAMPLES = 600
MEBI = float(1 << 20)
# 256 pages, of what may take an hour: 8 bytes leaked in each tick at 1 kHz are 29 MB.
MOST_MEBI = 1.0
# The watcher's ring holds a quarter of an hour.
LOOK_S = 60.0


def run(quick: bool, out: Path, told: Callable[[str], None] = print) -> list[Figure]:
    """Let the graph render for an hour (quick: a minute)."""
    return soak(QUICK_SOAK_S if quick else SOAK_S, out, told)


def soak(seconds: float, out: Path, told: Callable[[str], None] = print) -> list[Figure]:
    """Let the graph render for so long, and return what its processes hold, and the force.

    Raises:
        BenchError: a node ended.
    """
    times: list[float] = []
    held: dict[str, list[Usage]] = {node: [] for node in NODES}
    largest, breaks = 0.0, 0
    with Rig(out, PART) as rig:
        seen = rig.ready()
        begun = looked = time.monotonic()
        while (passed := time.monotonic() - begun) < seconds:
            rig.check()
            times.append(passed)
            for node in NODES:
                held[node].append(usage(rig.pid(node)))
            time.sleep(seconds / SAMPLES)
            if time.monotonic() - looked > min(LOOK_S, seconds / 2):
                looked = time.monotonic()
                peak, more, seen = _look(rig, seen)
                largest, breaks = max(largest, peak), breaks + more
                told(f"soak: {passed:.0f} of {seconds:.0f} s, {breaks} breaks")
        peak, more, _ = _look(rig, seen)
        largest, breaks = max(largest, peak), breaks + more
        figures = [
            Figure(PART, "watched for", passed, "s", trials=1),
            Figure(PART, "largest force, of a clean run's", largest / rig.clean_max, "", GOAL_PEAK),
            Figure(PART, "rendering broke off", float(breaks), "times"),
        ]
    for node, found in held.items():
        figures += _figures(node, times, found)
    return figures


def _look(rig: Rig, seen: int) -> tuple[float, int, int]:
    """Return the largest force since a number of the ring, how often it ended, and the number."""
    count = rig.ring.count
    found = rig.samples(seen)
    if not len(found):
        return 0.0, 0, count
    peak = float(np.nan_to_num(found["force"], nan=np.inf).max())
    return peak, int((np.diff(pushing(found).astype(int)) < 0).sum()), count


def _figures(node: str, times: list[float], found: list[Usage]) -> list[Figure]:
    columns = list(zip(*found, strict=True))
    number = len(times)

    def figure(index: int, what: str, scale: float, unit: str, most: float) -> Figure:
        note = f"{columns[index][-1] / scale:.4g} {unit} at the end".replace("  ", " ")
        value = grown(times, columns[index]) / scale
        return Figure(PART, f"{node}: growth of {what}", value, unit, most, None, number, note)

    return [
        figure(0, "resident memory", MEBI, "MiB", MOST_MEBI),
        figure(1, "proportional memory", MEBI, "MiB", MOST_MEBI),
        figure(2, "descriptors", 1.0, "", 0.0),
        figure(3, "threads", 1.0, "", 0.0),
    ]
