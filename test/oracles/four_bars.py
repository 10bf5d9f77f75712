# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Four-bar linkages next to a parallelogram: next to a singular position twice in each turn."""

from __future__ import annotations

import numpy as np

from oracles.generator import blank, floats
from oracles.kinematics import Document

HINGE = {"type": "revolute", "axis": [0.0, 0.0, 1.0]}


def four_bar(
    crank: float, coupler: float, follower: float, ground: float, angle: float, speed: float
) -> Document:
    """Return uniform rods of 1 kg/m in the open assembly, no losses.

    Args:
        crank: m, as the other lengths.
        coupler: likewise.
        follower: likewise.
        ground: likewise.
        angle: of the crank, rad.
        speed: of the crank, rad/s.
    """
    tip, pivot = crank * np.exp(1j * angle), complex(ground)
    apart = pivot - tip
    # Triangle of coupler, follower and the diagonal; of its two forms the one that is not crossed.
    cosine = (follower**2 + abs(apart) ** 2 - coupler**2) / (2.0 * follower * abs(apart))
    bends = [np.angle(-apart) + side * np.arccos(np.clip(cosine, -1.0, 1.0)) for side in (1, -1)]
    follows = min(bends, key=lambda bend: abs(np.exp(1j * bend) - np.exp(1j * angle)))
    end = pivot + follower * np.exp(1j * follows)
    along = np.angle(end - tip)
    # Rates from the velocity of the coupler's end, whose two rods give it in two directions.
    units = 1j * np.array([coupler * np.exp(1j * along), -follower * np.exp(1j * follows)])
    matrix = np.array([units.real, units.imag])
    known = -speed * 1j * tip
    turns, follower_speed = np.linalg.solve(matrix, [known.real, known.imag])
    document = blank(planar=True)
    lengths = {"crank": crank, "coupler": coupler, "follower": follower}
    places = {"crank": 0.0, "coupler": crank, "follower": ground}
    for name, length in lengths.items():
        moments = dict.fromkeys(("ixx", "iyy", "izz"), length**3 / 12.0)
        document["links"].append(
            {
                "name": name,
                "parent": "crank" if name == "coupler" else "world",
                "joint": HINGE | {"name": name, "origin": {"xyz": [places[name], 0.0, 0.0]}},
                "inertial": {"mass": length, "com": [0.5 * length, 0.0, 0.0], "inertia": moments},
            }
        )
    document["closures"] = [
        {
            "name": "pin",
            "kind": "planar_pin",
            "a": {"link": "coupler", "origin": {"xyz": [coupler, 0.0, 0.0]}},
            "b": {"link": "follower", "origin": {"xyz": [follower, 0.0, 0.0]}},
        }
    ]
    document["operational_points"] = [{"name": "tip", "link": "crank"}]
    names = ("crank", "coupler", "follower")
    start = {
        "q": dict(zip(names, floats((angle, along - angle, follows)), strict=True)),
        "v": dict(zip(names, floats((speed, turns - speed, follower_speed)), strict=True)),
    }
    return document | {"initial_state": start}
