# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A push over a short way, by which what is felt of a mechanism is compared with the mechanism."""

from __future__ import annotations

import numpy as np

from benchmarks.children import BenchError
from hapticmech_ros import Simulator, load_scene
from hapticmech_ros.numerics import Array

# m, and s that a mechanism may take for it.
WAY, LONGEST_S = 0.01, 5.0


def time_alone(name: str, push: Array, way: float = WAY) -> float:
    """Return how long a mechanism alone takes for the way along a push, s.

    A constant force F moves an inertia m over a way in a time t with m ∝ F t²: the square of the
    ratio of two times is that of the inertias, while these hardly change over the way.

    Args:
        name: of a shipped scene, pushed at its first operational point from its start.
        push: (6,) N and N m, world axes.
        way: m.

    Raises:
        BenchError: it does not move by the way.
    """
    simulator = Simulator(load_scene(name))
    mechanism, period = simulator.mechanism, simulator.scene.simulation.period
    point = simulator.scene.operational_points[0].name
    along = push[:3] / np.linalg.norm(push[:3])
    state = simulator.initial_state()
    start = mechanism.frame_pose(state.q, point).translation.copy()
    for tick in range(round(LONGEST_S / period)):
        if (mechanism.frame_pose(state.q, point).translation - start) @ along >= way:
            return tick * period
        state = simulator.step(state, push[None, :])
    raise BenchError(f"{name} does not move by {way:g} m")
