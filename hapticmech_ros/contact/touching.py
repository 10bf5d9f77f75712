# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What touches, and how: the points of contact of a mechanism at one time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.arrays import Array


@dataclass(frozen=True, slots=True)
class Touching:
    """Points of contact in the step that led to a state; n of them, in order of their pairs.

    Attributes:
        pairs: (n,) index of each point's pair among the scene's contacts.
        points: (n, 3) position at the step's start, midway between both surfaces, m, world.
        normals: (n, 3) unit normals from b to a, world axes.
        depths: (n,) m, how far the shapes overlap there; below 0 for a gap.
        forces: (n, 3) on a by b, held over the step, N, world axes.
        origins: (n, 3) of the frames of shapes a, m, world, at the step's start.
        joint_force: (nv,) mean of Σ J_cᵀ λ over the period, each at its step's start, N m or N.
        sweeps: that the solver did; none where Newton's rule was enough.
        residual: m/s, by which the points' rates are off what the law says.
        divided: into how many parts the last step was divided for an impact; points and forces are
            those of the last part.
    """

    pairs: Array
    points: Array
    normals: Array
    depths: Array
    forces: Array
    origins: Array
    joint_force: Array
    sweeps: int = 0
    residual: float = 0.0
    divided: int = 1

    def wrench(self, pair: int, origin: Array | None = None) -> Array:
        """Return (6,) the wrench of a pair: by b, on a, at a point, N and N m, world axes.

        Args:
            pair: index among the scene's contacts.
            origin: (3,) the point, m; the origin of shape a's frame if left out.
        """
        mine = self.pairs == pair
        force = self.forces[mine]
        about = self.origins[mine] if origin is None else origin
        torque = np.cross(self.points[mine] - about, force).sum(axis=0)
        return np.concatenate((force.sum(axis=0), torque))


def nothing_touching(nv: int) -> Touching:
    """Return what there is of a mechanism with so many rates where nothing touches."""
    none = np.zeros((0, 3))
    return Touching(np.zeros(0, dtype=np.int64), none, none, np.zeros(0), none, none, np.zeros(nv))
