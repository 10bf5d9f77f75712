# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mass felt at an operational point, in every direction: an ellipsoid.

The half axes are the masses of :func:`~hapticmech_ros.operational.results.felt_masses`; where X
has no response, m is infinite and the half axis ends at the longest one that is drawn.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.operational.results import felt_masses
from hapticmech_ros.view.shapes import Shape
from hapticmech_ros.view.user_look import PLAIN, Look

MASS = "mass"
# Of a planar scene the ellipsoid is a disc, this thick as a share of its longest half axis.
_THIN = 0.02


def mass_ellipsoid(
    analysis: OperationalAnalysis,
    place: Array,
    metres_per_kg: float,
    longest: float,
    look: Look = PLAIN,
) -> list[Shape]:
    """Return the ellipsoid of the mass felt, a disc in a planar scene.

    Args:
        analysis: of the point.
        place: (3,) of the point, m, world axes.
        metres_per_kg: how long a half axis is drawn.
        longest: half axis that is drawn, m.
        look: of the user who feels it.
    """
    masses, directions = felt_masses(analysis)
    halves = np.minimum(metres_per_kg * masses, longest)
    axes = np.eye(3)
    axes[:, : masses.size] = directions
    sizes = np.full(3, _THIN * longest)
    sizes[: masses.size] = halves
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    x, y, z = (2.0 * sizes).tolist()
    pose = pin.SE3(axes, np.asarray(place))
    return [Shape(look.namespace(MASS), 0, "sphere", pose, (x, y, z), look.colour(MASS))]
