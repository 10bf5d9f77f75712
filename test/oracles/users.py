# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mechanisms that two hands hold, and what each feels of a free body by closed forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

from hapticmech_ros.files import shared
from hapticmech_ros.numerics import Array

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


def five_bar_of_two(folder: Path, *hands: dict[str, object]) -> Path:
    """Return a file with the five-bar, held at link 1 (left) and at link 3 (right).

    Args:
        folder: of the file.
        hands: further keys of the two users, the left one first.
    """
    shipped = shared("config/scenes/five_bar.yaml")
    assert shipped is not None
    document = yaml.safe_load(shipped.read_text(encoding="utf-8"))
    places = {"left": "link1", "right": "link3"}
    document["operational_points"] = [
        {"name": name, "link": link, "origin": {"xyz": [0.045, 0, 0]}}
        for name, link in places.items()
    ]
    own = [*hands, {}, {}][:2]
    document["hands"] = [{"point": name, **one} for name, one in zip(places, own, strict=True)]
    path = folder / "two_users.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


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
