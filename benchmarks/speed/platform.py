# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A platform on sprung legs, as a passive isolator: on six, Stewart and Gough's."""

from __future__ import annotations

from math import cos, radians, sin
from typing import Any

import numpy as np

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene, scene_from_document

# Of a tabletop hexapod: joints on circles (m), in pairs this far to both sides of 0°, 120°, 240°;
# with more legs there are more such directions, and pairs are as much closer.
BASE_RADIUS, BASE_HALF_ANGLE = 0.25, 12.0
TOP_RADIUS, TOP_HALF_ANGLE = 0.15, 48.0
HEIGHT = 0.35
LEGS, MOST_LEGS = 6, 200
# Each leg: a lower part (kg) on a universal joint, an upper part that slides in it on a spring
# (N/m, N s/m), which carries its share of the weight where the platform is level.
LOWER_MASS, UPPER_MASS, PLATFORM_MASS = 0.8, 0.4, 5.0
STIFFNESS, DAMPING = 4000.0, 5.0
PART_LENGTH, ROD_RADIUS = 0.25, 0.012
START_SPEED = {"platform": [0.3, -0.2, 0.1, 0.8, 0.5, -1.5]}


def stewart_platform(legs: int = LEGS) -> Scene:
    """Return the scene: a free platform and its legs, closed by a spherical closure each.

    With six legs 24 freedoms of the tree, 18 rows, six freedoms; each one more brings three and
    three. It starts level with a push that moves it some centimetres and degrees.

    Raises:
        InvalidInputError: ``legs`` is not an even number from 6 to 200.
    """
    if legs % 2 or not LEGS <= legs <= MOST_LEGS:
        raise InvalidInputError("legs", legs, f"must be an even number from {LEGS} to {MOST_LEGS}")
    name = "stewart_platform" if legs == LEGS else f"platform_{legs}"
    return scene_from_document(_document(name, legs), source=name)


def _document(name: str, legs: int) -> dict[str, Any]:
    feet = _ring(legs, BASE_RADIUS, BASE_HALF_ANGLE, 0.0)
    heads = _ring(legs, TOP_RADIUS, TOP_HALF_ANGLE, HEIGHT)
    disc = 0.25 * PLATFORM_MASS * TOP_RADIUS**2
    links: list[dict[str, Any]] = [
        {
            "name": "platform",
            "joint": {"name": "platform", "type": "free"},
            "inertial": {
                "mass": PLATFORM_MASS,
                "com": [0.0, 0.0, 0.02],
                "inertia": {"ixx": disc, "iyy": disc, "izz": 2.0 * disc},
            },
        }
    ]
    closures, q = [], {"platform": [0.0, 0.0, HEIGHT, 0.0, 0.0, 0.0, 1.0]}
    for leg, (foot, head) in enumerate(zip(feet, heads, strict=True)):
        along = head - foot
        length = float(np.linalg.norm(along))
        # z of the leg is R_x(tilt) R_y(swing) e_z = (sin s, -sin t cos s, cos t cos s).
        swing = float(np.arcsin(along[0] / length))
        tilt = float(np.arctan2(-along[1], along[2]))
        links += _leg(leg, foot, length, 1.0 / legs)
        on_platform = {"xyz": [head[0], head[1], 0.0]}
        closures.append(
            {
                "name": f"ball{leg}",
                "kind": "spherical",
                "a": {"link": f"upper{leg}"},
                "b": {"link": "platform", "origin": on_platform},
            }
        )
        q |= {f"tilt{leg}": [tilt], f"swing{leg}": [swing], f"slide{leg}": [length]}
    return {
        "format": "hapticmech-scene/1",
        "name": name,
        "description": f"A platform on {legs} sprung legs",
        "gravity": [0.0, 0.0, -9.81],
        "links": links,
        "closures": closures,
        "operational_points": [
            {"name": "rim", "link": "platform", "origin": {"xyz": [TOP_RADIUS, 0.0, 0.02]}}
        ],
        "initial_state": {
            "q": {name: at if name == "platform" else at[0] for name, at in q.items()},
            "v": START_SPEED,
        },
        "hand": {"kind": "constant_wrench"},
    }


def _ring(legs: int, radius: float, half_angle: float, height: float) -> list[Array]:
    """Return as many points as there are legs, foot k below head k."""
    apart, closer = 720.0 / legs, LEGS / legs
    angles = [a * apart + s * half_angle * closer for a in range(legs // 2) for s in (-1.0, 1.0)]
    turns = [radians(angle) for angle in angles]
    return [np.array([radius * cos(t), radius * sin(t), height]) for t in turns]


def _leg(leg: int, foot: Array, length: float, share: float) -> list[dict[str, Any]]:
    # The yoke of the universal joint is light, not massless: all simulators take it.
    yoke = {"mass": 0.05, "inertia": dict.fromkeys(("ixx", "iyy", "izz"), 1e-5)}
    weight = 9.81 * (PLATFORM_MASS * share + UPPER_MASS) * HEIGHT / length
    return [
        {
            "name": f"yoke{leg}",
            "joint": {
                "name": f"tilt{leg}",
                "type": "revolute",
                "axis": [1.0, 0.0, 0.0],
                "origin": {"xyz": foot.tolist()},
            },
            "inertial": yoke,
        },
        {
            "name": f"lower{leg}",
            "parent": f"yoke{leg}",
            "joint": {"name": f"swing{leg}", "type": "revolute", "axis": [0.0, 1.0, 0.0]},
            "inertial": _rod(LOWER_MASS, 0.5 * PART_LENGTH),
        },
        {
            "name": f"upper{leg}",
            "parent": f"lower{leg}",
            "joint": {
                "name": f"slide{leg}",
                "type": "prismatic",
                "axis": [0.0, 0.0, 1.0],
                "stiffness": STIFFNESS,
                "damping": DAMPING,
                "rest": length + weight / STIFFNESS,
            },
            "inertial": _rod(UPPER_MASS, -0.5 * PART_LENGTH),
        },
    ]


def _rod(mass: float, centre: float) -> dict[str, Any]:
    across = mass * (PART_LENGTH**2 / 12.0 + ROD_RADIUS**2 / 4.0)
    moments = {"ixx": across, "iyy": across, "izz": 0.5 * mass * ROD_RADIUS**2}
    return {"mass": mass, "com": [0.0, 0.0, centre], "inertia": moments}
