# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Planar chains and the five-bar of the paper; closed positions from triangles, not solvers."""

from __future__ import annotations

import numpy as np

from oracles.generator import blank, floats
from oracles.kinematics import Array, Document

# The paper's five-bar: lengths m, masses kg, inertia about the centre of mass kg m^2, pivot m.
LENGTHS = np.array([0.045, 0.045, 0.045, 0.060])
MASSES = np.array([1.0, 1.0, 1.0, 0.5])
INERTIAS = np.array([0.0021, 0.0021, 0.0021, 0.00105])
PIVOT = np.array([0.09, 0.0])


def chain(
    lengths: Array, masses: Array, inertias: Array, gravity_y: float = 0.0, damping: float = 0.0
) -> Document:
    """Return a chain of uniform bars on revolute joints, an operational point at each bar's end."""
    document = blank(True, (0.0, gravity_y, 0.0))
    for i, (length, mass, inertia) in enumerate(zip(lengths, masses, inertias, strict=True)):
        offset = floats((lengths[i - 1], 0, 0)) if i else [0.0, 0.0, 0.0]
        joint = {"name": f"joint{i + 1}", "type": "revolute", "origin": {"xyz": offset}}
        moment = float(inertia)
        document["links"].append(
            {
                "name": f"link{i + 1}",
                "parent": f"link{i}" if i else "world",
                "joint": joint | {"damping": float(damping)},
                "inertial": {
                    "mass": float(mass),
                    "com": floats((length / 2, 0, 0)),
                    "inertia": {"ixx": moment, "iyy": moment, "izz": moment},
                },
            }
        )
        end = {"name": f"end{i + 1}", "link": f"link{i + 1}"}
        middle = {"name": f"middle{i + 1}", "link": f"link{i + 1}"}
        end["origin"] = {"xyz": floats((length, 0, 0))}
        middle["origin"] = {"xyz": floats((0.4 * length, 0, 0))}
        document["operational_points"] += [end, middle]
    return document


def pin_end(document: Document, pivot: Array, **options: object) -> Document:
    """Return the chain with the end of its last bar pinned at ``pivot`` (m)."""
    last = document["operational_points"][-2]
    closure = {
        "name": "pin",
        "kind": "planar_pin",
        "a": {"link": last["link"], "origin": last["origin"]},
        "b": {"link": "world", "origin": {"xyz": floats((*pivot, 0.0))}},
    }
    return document | {"closures": [closure | options]}


def five_bar(gravity_y: float = 0.0, damping: float = 0.0, closed: bool = True) -> Document:
    """Return the paper's five-bar, closed or as a serial chain of four."""
    document = chain(LENGTHS, MASSES, INERTIAS, gravity_y, damping)
    return pin_end(document, PIVOT) if closed else document


def bar(gravity_y: float = 0.0, damping: float = 0.0) -> Document:
    """Return the first bar of the paper's five-bar, alone."""
    return chain(LENGTHS[:1], MASSES[:1], INERTIAS[:1], gravity_y, damping)


def elbow(
    base: Array, first: float, second: float, target: Array, side: int
) -> tuple[float, float]:
    """Return absolute angles of two bars from ``base`` to ``target``; ``side`` is +1 or -1."""
    gap = target - base
    distance = float(np.hypot(*gap))
    cosine = (first**2 + distance**2 - second**2) / (2.0 * first * distance)
    angle = np.arctan2(gap[1], gap[0]) + side * np.arccos(cosine)
    joint = base + first * np.array([np.cos(angle), np.sin(angle)])
    rest = target - joint
    return float(angle), float(np.arctan2(rest[1], rest[0]))


def relative_angles(absolute: Array) -> Array:
    """Return joint angles of absolute ones, within half a turn."""
    q = np.diff(np.concatenate(([0.0], absolute)))
    return np.arctan2(np.sin(q), np.cos(q))


def five_bar_bent(first: float, bend: float, side: int = 1) -> Array:
    """Return the closed configuration with joint 1 at ``first`` and joint 4 at ``bend`` (rad).

    The five-bar's joint 4 at zero is links 3 and 4 in line, the taut pair.
    """
    p1 = LENGTHS[0] * np.array([np.cos(first), np.sin(first)])
    l3, l4 = LENGTHS[2:]
    taut = np.sqrt(l3**2 + l4**2 + 2.0 * l3 * l4 * np.cos(bend))
    second, line = elbow(p1, LENGTHS[1], taut, PIVOT, side)
    third = line - np.arctan2(l4 * np.sin(bend), l3 + l4 * np.cos(bend))
    return np.array([first, second - first, third - second, bend])
