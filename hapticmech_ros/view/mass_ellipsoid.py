# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mass felt at an operational point, in every direction: an ellipsoid.

A force f along an eigenvector of the translational block of X = Λ_h⁻¹ accelerates the point along
it by f/m. The half axes are these masses m; where X has no response, m is infinite and the half
axis ends at the longest one that is drawn.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.view import palette
from hapticmech_ros.view.shapes import Shape

MASS = "mass"
# Of a planar scene the ellipsoid is a disc, this thick as a share of its longest half axis.
_THIN = 0.02
# Responses below this share of the largest one are rounding.
_RIGID = 1e-9


def felt_masses(analysis: OperationalAnalysis) -> tuple[Array, Array]:
    """Return masses (k,), kg, infinite where rigid, lightest first, and their directions (3, k).

    k is 3, or 2 in the plane; torques are zero, and the point is free to turn.
    """
    rows = analysis.rows[analysis.rows < 3]
    response, vectors = np.linalg.eigh(analysis.inverse_inertia[np.ix_(rows, rows)])
    response, vectors = response[::-1], vectors[:, ::-1]
    masses = np.full(rows.size, np.inf)
    felt = response > _RIGID * max(float(response[0]), 0.0)
    masses[felt] = 1.0 / response[felt]
    directions = np.zeros((3, rows.size))
    directions[rows] = vectors
    return masses, directions


def mass_ellipsoid(
    analysis: OperationalAnalysis, place: Array, metres_per_kg: float, longest: float
) -> list[Shape]:
    """Return the ellipsoid of the mass felt, a disc in a planar scene.

    Args:
        analysis: of the point.
        place: (3,) of the point, m, world axes.
        metres_per_kg: how long a half axis is drawn.
        longest: half axis that is drawn, m.
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
    return [Shape(MASS, 0, "sphere", pose, (x, y, z), palette.MASS)]
