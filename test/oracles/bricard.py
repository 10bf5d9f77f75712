# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bricard's mechanism (IFToMM benchmark A04): five rods, cut at the sixth hinge.

Rods of 1 kg, 1 m and 0.1 m square section. The cut asks the last point to stay and the last hinge
line to keep its direction: five rows of rank 4, one freedom. With W v' = -b the acceleration is a
particular solution of least size plus one along the freedom.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from oracles.kinematics import turn
from oracles.odes import solve

Array = np.ndarray

POINTS = np.array(
    [[0, 0, 0], [1, 0, 0], [1, -1, 0], [1, -1, 1], [0, -1, 1], [0, 0, 1]], dtype=float
)
AXES = np.eye(3)[[1, 2, 0, 1, 2]]
LAST_AXIS = np.array([1.0, 0.0, 0.0])
GRAVITY = np.array([0.0, -9.81, 0.0])
RODS, RANK = 5, 4
ALONG, ACROSS = 0.1**2 / 6.0, (1.0 + 0.1**2) / 12.0


class Pose:
    """Rods at (q, v): points, centres, turning Jacobians, and accelerations at v' = 0."""

    def __init__(self, q: Array, v: Array) -> None:
        self.rotation, self.axes = [np.eye(3)], []
        self.points = [POINTS[0]]
        spin, spin_rate, speed_rate = np.zeros(3), np.zeros(3), np.zeros(3)
        self.spins, self.spin_rates, self.centre_rates, self.centres = [], [], [], []
        for i in range(RODS):
            axis = self.rotation[-1] @ AXES[i]
            self.axes.append(axis)
            self.rotation.append(self.rotation[-1] @ turn(AXES[i], q[i]))
            spin_rate = spin_rate + np.cross(spin, axis) * v[i]
            spin = spin + axis * v[i]
            rod = self.rotation[-1] @ (POINTS[i + 1] - POINTS[i])
            towards = np.cross(spin_rate, rod) + np.cross(spin, np.cross(spin, rod))
            self.centres.append(self.points[-1] + rod / 2.0)
            self.points.append(self.points[-1] + rod)
            self.centre_rates.append(speed_rate + towards / 2.0)
            self.spins.append(spin)
            self.spin_rates.append(spin_rate)
            speed_rate = speed_rate + towards
        self.end_rate = speed_rate

    def turning(self, rod: int) -> Array:
        """Return (3, 5) Jacobian of the rod's spin."""
        columns = [self.axes[k] if k <= rod else np.zeros(3) for k in range(RODS)]
        return np.stack(columns, axis=1)

    def moving(self, rod: int, point: Array) -> Array:
        """Return (3, 5) Jacobian of a point of the rod."""
        arms = [np.cross(self.axes[k], point - self.points[k]) for k in range(RODS)]
        columns = [arms[k] if k <= rod else np.zeros(3) for k in range(RODS)]
        return np.stack(columns, axis=1)


def _dynamics(pose: Pose) -> tuple[Array, Array]:
    """Return M (5, 5) and f (5,) of M v' = f."""
    inertia, force = np.zeros((RODS, RODS)), np.zeros(RODS)
    for i in range(RODS):
        along = pose.rotation[i + 1] @ (POINTS[i + 1] - POINTS[i])
        moments = ACROSS * np.eye(3) + (ALONG - ACROSS) * np.outer(along, along)
        move, spin = pose.moving(i, pose.centres[i]), pose.turning(i)
        gyroscopic = np.cross(pose.spins[i], moments @ pose.spins[i])
        inertia += move.T @ move + spin.T @ moments @ spin
        force += move.T @ (GRAVITY - pose.centre_rates[i])
        force -= spin.T @ (moments @ pose.spin_rates[i] + gyroscopic)
    return inertia, force


def closing(pose: Pose) -> tuple[Array, Array]:
    """Return W (5, 5) and b (5,) of the cut: W v' = -b."""
    last = RODS - 1
    axis, spin = pose.rotation[-1] @ LAST_AXIS, pose.spins[last]
    axis_rate = np.cross(pose.spin_rates[last], axis) + np.cross(spin, np.cross(spin, axis))
    axis_rows = -np.cross(axis, pose.turning(last), axisb=0, axisc=0)
    rows = np.vstack((pose.moving(last, pose.points[-1]), axis_rows[1:]))
    return rows, np.append(pose.end_rate, axis_rate[1:])


def acceleration(q: Array, v: Array) -> Array:
    """Return v' (5,)."""
    pose = Pose(q, v)
    inertia, force = _dynamics(pose)
    rows, bias = closing(pose)
    left, sizes, right = np.linalg.svd(rows)
    kept, free = right[:RANK], right[RANK]
    particular = -kept.T @ ((left.T @ bias)[:RANK] / sizes[:RANK])
    along = free @ (force - inertia @ particular) / (free @ inertia @ free)
    return particular + along * free


def corner(times: Sequence[float]) -> Array:
    """Return the positions (times, 3) of the corner that starts at (1, -1, 0), m."""
    start = np.zeros(2 * RODS)
    n = RODS
    states = solve(lambda _, x: np.append(x[n:], acceleration(x[:n], x[n:])), start, times)
    return np.array([Pose(state[:n], state[n:]).points[2] for state in states])
