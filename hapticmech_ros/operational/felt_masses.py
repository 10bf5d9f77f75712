# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mass felt at an operational point in every direction.

A force f along an eigenvector of the translational block of X = Λ_h⁻¹ accelerates the point along
it by f/m: m is the mass felt, infinite where X has no response.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.operational.results import OperationalAnalysis

# Responses below this share of the largest one are rounding.
RIGID = 1e-9


def felt_masses(analysis: OperationalAnalysis) -> tuple[Array, Array]:
    """Return masses (k,), kg, infinite where rigid, lightest first, and their directions (3, k).

    k is 3, or 2 in the plane; torques are zero, and the point is free to turn.
    """
    rows = analysis.rows[analysis.rows < 3]
    response, vectors = np.linalg.eigh(analysis.inverse_inertia[np.ix_(rows, rows)])
    response, vectors = response[::-1], vectors[:, ::-1]
    masses = np.full(rows.size, np.inf)
    felt = response > RIGID * max(float(response[0]), 0.0)
    masses[felt] = 1.0 / response[felt]
    directions = np.zeros((3, rows.size))
    directions[rows] = vectors
    return masses, directions
