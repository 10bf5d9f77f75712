# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where a sparse factorisation begins to pay: ``python -m benchmarks.speed.crossover``.

Both factorisations of the same mechanism do the same steps in turn; their ends are compared first.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from benchmarks.accuracy.n_four_bar import n_four_bar
from benchmarks.speed.scaling import chain
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.mechanism.kernels.layout import sparse
from hapticmech_ros.scene import Scene
from hapticmech_ros.simulation import Simulator

WINDOWS, RODS = (1, 2, 4, 8, 16, 40), (2, 5, 10, 20, 40, 80)
# Steps of a turn, turns, and how far apart the ends of a turn may be, rad.
STEPS, TURNS, APART = 20, 7, 1e-9


class Crossing(NamedTuple):
    """One mechanism: its name, nv, m, CPU time per step of both (ms), and which is taken."""

    name: str
    nv: int
    m: int
    dense_ms: float
    sparse_ms: float
    taken: str


def compare(name: str, scene: Scene) -> Crossing:
    """Return the medians of both for rk4 steps of 1 ms.

    Raises:
        HapticMechError: the two do not go the same way, or a sparse one is impossible.
    """
    scene = scene.stepped(integrator="rk4", period=1e-3)
    both = Simulator(scene), Simulator(scene)
    active = both[0].mechanism.initially_active
    starts = [simulator.initial_state() for simulator in both]
    mechanism = both[0].mechanism
    usual = mechanism.active_set(active)
    banded = sparse(usual.dense, starts[0].q)
    if banded is None:
        raise HapticMechError(f"{name}: no sparse factorisation where it starts")
    for simulator, active_set in zip(both, (usual.dense, banded), strict=True):
        simulator.mechanism.take(active, active_set)
    times: list[list[float]] = [[], []]
    for _ in range(TURNS):
        ends = []
        for simulator, start, found in zip(both, starts, times, strict=True):
            begun = time.process_time()
            ends.append(simulator.run(start, STEPS).end)
            found.append((time.process_time() - begun) / STEPS * 1e3)
        if np.abs(ends[0].q - ends[1].q).max() > APART:
            raise HapticMechError(f"{name}: the two factorisations do not go the same way")
    dense_ms, sparse_ms = (float(np.median(found)) for found in times)
    taken = "sparse" if usual.is_sparse else "dense"
    return Crossing(name, mechanism.nv, usual.m, dense_ms, sparse_ms, taken)


def crossings() -> Iterator[Crossing]:
    """Yield all mechanisms, small ones first."""
    yield compare("five_bar", load_scene("five_bar"))
    for windows in WINDOWS:
        yield compare(f"A02, N = {windows}", n_four_bar(windows))
    for rods in RODS:
        yield compare(f"chain of {rods}", chain(rods))


if __name__ == "__main__":
    print("| mechanism | nv | m | sparse over dense | taken |")
    print("|---|--:|--:|--:|---|")
    for found in crossings():
        ratio = found.sparse_ms / found.dense_ms
        print(
            f"| {found.name} | {found.nv} | {found.m} | {ratio:.2f} | {found.taken} |", flush=True
        )
