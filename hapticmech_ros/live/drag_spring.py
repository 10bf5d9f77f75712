# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The spring by which the mouse drags: its stiffness, its damping, and how far it may pull.

It is sampled at every tick, like a controller: stiffness and damping are bounded by the mass that
they move and the period, so that the spring itself is stable at any setting.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InvalidInputError

# Of the sampled spring: at most this angle ω T a period, and this share of the velocity a period.
MOST_ANGLE, MOST_BRAKING = 0.25, 0.25
# A ray this near to the plane (sine of the angle) does not tell where on it somebody points.
_GRAZING = 0.05


@dataclass(frozen=True, slots=True)
class DragSpring:
    """A spring and damper with a limit.

    Attributes:
        stiffness: N/m.
        damping: N s/m.
        limit: N, of the force.
    """

    stiffness: float
    damping: float
    limit: float

    def force(self, place: Array, velocity: Array, goal: Array) -> Array:
        """Return the force (3,) on a grip, N, world axes.

        Args:
            place: (3,) of the grip, m, world axes.
            velocity: (3,) of the grip, m/s, world axes.
            goal: (3,) to where it is pulled, m, world axes.
        """
        wanted = self.stiffness * (goal - place) - self.damping * velocity
        size = float(np.linalg.norm(wanted))
        return np.asarray(wanted if size <= self.limit else wanted * (self.limit / size))


def drag_spring(
    stiffness: float, felt: float, moved: float, period: float, limit: float
) -> DragSpring:
    """Return a critically damped spring, as stiff as it may be.

    Args:
        stiffness: that is wanted, N/m.
        felt: mass (kg) that it is to be critically damped with.
        moved: least mass (kg) that it moves at once, which bounds both.
        period: of the session, s.
        limit: N, of the force.

    Raises:
        InvalidInputError: a number that is not positive and finite.
    """
    given = {"stiffness": stiffness, "felt": felt, "moved": moved, "period": period, "limit": limit}
    for name, value in given.items():
        if not (np.isfinite(value) and value > 0.0):
            raise InvalidInputError(f"{name} of a drag", value, "must be positive and finite")
    bounded = min(stiffness, (MOST_ANGLE / period) ** 2 * moved)
    damping = min(2.0 * float(np.sqrt(bounded * felt)), MOST_BRAKING / period * moved)
    return DragSpring(bounded, damping, limit)


def on_plane(eye: Array, seen: Array, height: float) -> Array:
    """Return where (3,) a ray of sight meets the plane z = ``height``, m, world axes.

    Where the ray grazes the plane, or leads away from it, it is the place seen put on the plane.

    Args:
        eye: (3,) from where somebody looks.
        seen: (3,) on the ray.
        height: of the plane, m.
    """
    ray = seen - eye
    length = float(np.linalg.norm(ray))
    if length > 0.0 and abs(ray[2]) > _GRAZING * length:
        share = (height - eye[2]) / ray[2]
        if share > 0.0:
            return np.asarray(eye + share * ray)
    return np.array((seen[0], seen[1], height))
