# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A body that two hands hold, and what each feels by closed forms."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array

MASS, INERTIA, REACH = 0.8, (1.1e-3, 0.9e-3, 1.4e-3), 0.06


def two_points(**changes: object) -> dict[str, object]:
    """Return a free body without weight, held at its ends a and b by hands that do nothing."""
    i = dict(zip(("ixx", "iyy", "izz"), INERTIA, strict=True))
    return {
        "format": "hapticmech-scene/1",
        "name": "two_points",
        "links": [
            {
                "name": "body",
                "joint": {"name": "flight", "type": "free"},
                "inertial": {"mass": MASS, "inertia": i},
            }
        ],
        "operational_points": [
            {"name": name, "link": "body", "origin": {"xyz": [x, 0.0, 0.0]}}
            for name, x in (("a", REACH), ("b", -REACH))
        ],
        "hand": {"kind": "constant_wrench"},
        **changes,
    }


def inverse_inertia(one: Array, other: Array) -> Array:
    """Return X_ij (6, 6) = T_i D⁻¹ T_jᵀ of the body, whose axes are the world's.

    Args:
        one, other: (3,) m, the points from the centre of mass.
    """
    inverse = np.diag(1.0 / np.array([MASS] * 3 + list(INERTIA)))
    return _moved(one) @ inverse @ _moved(other).T


def _moved(point: Array) -> Array:
    """Return T (6, 6): twist at a point from that at the centre of mass, v + ω × r."""
    x, y, z = point
    moved = np.eye(6)
    moved[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return moved
