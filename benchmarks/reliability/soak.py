# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Part ``soak``: a session ticks, and the graph renders, for an hour; nothing of them grows."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.reliability.figure import Figure, figures_of
from benchmarks.reliability.memory_growth import MEBI
from benchmarks.reliability.rig import SCENE, Rig, pushing
from benchmarks.reliability.trial import GOAL_PEAK
from benchmarks.reliability.usage import Usage, grown, usage
from hapticmech_ros.loading import load_scene
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.session import Session

SOAK_S, QUICK_SOAK_S = 3600.0, 60.0
LOOKS = 600
# 256 pages, of what may take an hour: 8 bytes leaked in each tick at 1 kHz are 29 MB.
MOST_MEBI = 1.0
# What is held, in the order of ``Usage``: one of its units, that unit, and by how much it may grow.
KINDS = {
    "resident memory": (MEBI, "MiB", MOST_MEBI),
    "proportional memory": (MEBI, "MiB", MOST_MEBI),
    "descriptors": (1.0, "", 0.0),
    "threads": (1.0, "", 0.0),
}
# s between lines that tell how far it is.
TELL_S = 60.0


@dataclass(frozen=True, slots=True)
class Rendered:
    """What a graph did for a while.

    Attributes:
        times: (n,) s, of looks at what its processes hold.
        held: of each node, at these times.
        seconds: s, how long it was watched.
        peak: largest force, N.
        breaks: how often force ended.
        samples: of the device.
        pushed: of these, how many have force.
    """

    times: Sequence[float]
    held: Mapping[str, Sequence[Usage]]
    seconds: float
    peak: float
    breaks: int
    samples: int
    pushed: int


def render(rig: Rig, seconds: float, looks: int) -> Rendered:
    """Let a graph render for so long, and look at it meanwhile.

    Raises:
        BenchError: it does not begin to, or a node ended.
    """
    times: list[float] = []
    held: dict[str, list[Usage]] = {node: [] for node in NODES}
    peak, breaks, samples, pushed, rendering = 0.0, 0, 0, 0, False
    before, begun, said = rig.settle(), time.monotonic(), TELL_S
    while (passed := time.monotonic() - begun) < seconds:
        rig.check()
        times.append(passed)
        for node in NODES:
            held[node].append(usage(rig.pid(node)))
        time.sleep(seconds / looks)
        before, found = rig.ring.count, rig.samples(before)
        if len(found):
            on = np.concatenate(([rendering], pushing(found)))
            rendering = bool(on[-1])
            breaks += int((on[:-1] & ~on[1:]).sum())
            peak = max(peak, float(np.nan_to_num(found["force"], nan=np.inf).max()))
            samples, pushed = samples + len(found), pushed + int(on[1:].sum())
        if passed > said:
            said += TELL_S
            print(f"{passed:.0f} of {seconds:.0f} s, {breaks} breaks")
    return Rendered(times, held, passed, peak, breaks, samples, pushed)


def run(quick: bool, out: Path) -> list[Figure]:
    """Let a session tick, and the graph render, for an hour (quick: a minute).

    Raises:
        BenchError: a node ended.
    """
    seconds = QUICK_SOAK_S if quick else SOAK_S
    figures = [*growth("session", *session_held(seconds))]
    with Rig(out, "soak") as rig:
        rig.ready()
        found = render(rig, seconds, LOOKS)
        figures += [
            Figure("watched for", found.seconds, "s", trials=1),
            Figure("largest force, of a clean run's", found.peak / rig.clean_max, "", GOAL_PEAK),
            Figure("rendering broke off", float(found.breaks), "times"),
        ]
    for node, held in found.held.items():
        figures += growth(node, found.times, held)
    return figures


def session_held(seconds: float, looks: int = LOOKS) -> tuple[list[float], list[Usage]]:
    """Return what this process holds while a session simulates so long: times, s, and usages."""
    session, times, held = Session(load_scene(SCENE)), [], []
    for look in range(1, looks + 1):
        while session.time < seconds * look / looks:
            session.tick()
        times.append(session.time)
        held.append(usage(os.getpid()))
    return times, held


def growth(
    process: str, times: Sequence[float], held: Sequence[Usage], what: str = ""
) -> Iterator[Figure]:
    """Yield by how much what a process holds has grown.

    Args:
        process: its name.
        times: (n,) s, of looks.
        held: at these times.
        what: one kind alone; all if empty.
    """
    figure = figures_of(process, len(times))
    for (kind, (scale, unit, most)), values in zip(
        KINDS.items(), zip(*held, strict=True), strict=True
    ):
        if what in ("", kind):
            note = f"{values[-1] / scale:.4g} {unit} at the end".replace("  ", " ")
            name, grew = f"growth of {kind}", grown(times, values) / scale
            yield figure(name, grew, unit, most=most, note=note)
