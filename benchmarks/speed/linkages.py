# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Linkages that are raced: a walking machine's leg of eight bars, and a spatial four-bar."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hapticmech_ros.loading.loader import scene_as_written
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene

# Theo Jansen's lengths, in thousandths of a metre here: the crank, the fixed pivot beside and below
# its axis, and the bars by his letters.
CRANK, PIVOT = 0.015, (-0.038, -0.0078)
BARS = dict(
    zip(
        "bcdefghijk",
        (0.0415, 0.0393, 0.0401, 0.0558, 0.0394, 0.0367, 0.0657, 0.049, 0.05, 0.0619),
        strict=True,
    )
)
# kg/m of all bars of the leg, and rad of its crank at the start.
DENSITY, CRANK_ANGLE = 1.0, 0.6


def jansen_leg() -> Scene:
    """Return the leg: seven moving bars, ten pins, three loops, one degree of freedom.

    It hangs from its frame, and falls from where its crank is held.
    """
    points = _leg_points(CRANK_ANGLE)
    bars = {
        "crank": ("O", "A"),
        "upper_rod": ("A", "C"),
        "upper": ("B", "C", "D"),
        "lower_rod": ("A", "E"),
        "rocker": ("B", "E"),
        "side_rod": ("D", "F"),
        "lower": ("E", "F", "P"),
    }
    document = _document("jansen_leg", points, ("O", "B"), "P", "planar")
    document["linkage"]["bars"] = [
        {"name": name, "points": list(ends), "density": DENSITY} for name, ends in bars.items()
    ]
    document["gravity"] = [0.0, -9.81, 0.0]
    return scene_as_written(document, Path("jansen_leg"))


def spatial_four_bar() -> Scene:
    """Return crank and rocker on hinges whose axes are square to each other, and a rod on balls.

    The rod turns about itself as well, so that there are two degrees of freedom.
    """
    points = {
        "A": np.array((0.0, 0.0, 0.0)),
        "B": np.array((0.0, 0.05, 0.0)),
        "C": np.array((0.2, 0.1, 0.12)),
        "D": np.array((0.2, 0.1, 0.0)),
    }
    document = _document("spatial_four_bar", points, ("A", "D"), "C", "spatial")
    document["linkage"] |= {
        "hinges": {"A": [0.0, 0.0, 1.0], "D": [0.0, 1.0, 0.0]},
        "bars": [
            {"name": "crank", "points": ["A", "B"], "mass": 0.1},
            {"name": "rod", "points": ["B", "C"], "mass": 0.1},
            {"name": "rocker", "points": ["D", "C"], "mass": 0.1},
        ],
    }
    document["operational_points"][0]["link"] = "rocker"
    document["gravity"] = [0.0, 0.0, -9.81]
    document["initial_state"] = {"v": {"crank_at_A": [2.0]}}
    return scene_as_written(document, Path("spatial_four_bar"))


def _document(
    name: str, points: dict[str, Array], ground: tuple[str, ...], held: str, space: str
) -> dict[str, Any]:
    return {
        "format": "hapticmech-scene/1",
        "name": name,
        "task_space": space,
        "linkage": {
            "points": {point: place.tolist() for point, place in points.items()},
            "ground": list(ground),
        },
        "operational_points": [{"name": "foot", "point": held}],
        "hand": {"kind": "constant_wrench"},
    }


def _leg_points(angle: float) -> dict[str, Array]:
    """Return where the leg's points are, m."""
    o, b = np.zeros(2), np.array(PIVOT)
    a = CRANK * np.array((np.cos(angle), np.sin(angle)))
    c = _corner(a, b, BARS["j"], BARS["b"])
    e = _corner(b, a, BARS["c"], BARS["k"])
    d = _corner(c, b, BARS["e"], BARS["d"])
    f = _corner(d, e, BARS["f"], BARS["g"])
    p = _corner(f, e, BARS["h"], BARS["i"])
    return {"O": o, "A": a, "B": b, "C": c, "D": d, "E": e, "F": f, "P": p}


def _corner(first: Array, second: Array, from_first: float, from_second: float) -> Array:
    """Return the third corner of a triangle, to the right of the way from first to second."""
    way = second - first
    base = float(np.hypot(*way))
    along = (base**2 + from_first**2 - from_second**2) / (2.0 * base)
    height = float(np.sqrt(from_first**2 - along**2))
    unit = way / base
    return np.asarray(first + along * unit + height * np.array((unit[1], -unit[0])))
