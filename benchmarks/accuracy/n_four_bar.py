# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Benchmark A02 of any size: parallelograms in a row, which fall in line again and again."""

from __future__ import annotations

from math import pi
from typing import Any

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene import Scene, scene_from_document

LARGEST = 200
_ROD = {
    "mass": 1.0,
    "com": [0.5, 0.0, 0.0],
    "inertia": dict.fromkeys(("ixx", "iyy", "izz"), 1.0 / 12.0),
}
_TIP = {"xyz": [1.0, 0.0, 0.0]}


def n_four_bar(windows: int) -> Scene:
    """Return the scene of N = ``windows`` parallelograms; see :func:`document`.

    Raises:
        InvalidInputError: ``windows`` is not from 1 to 200.
    """
    return scene_from_document(document(windows), source=f"n_four_bar({windows})")


def document(windows: int) -> dict[str, Any]:
    """Return the document of N = ``windows`` parallelograms of uniform rods (1 kg, 1 m).

    N + 1 uprights stand on the x axis 1 m apart, each but the last carries a top, and N planar pins
    hold the tops' ends on the next upright: 2 N + 1 freedoms of the tree, 2 N rows, one freedom.
    The first upright's tip, ``b0``, starts at (0, 1) with 1 m/s along x; gravity along -y.

    Raises:
        InvalidInputError: ``windows`` is not from 1 to 200.
    """
    if not 1 <= windows <= LARGEST:
        raise InvalidInputError("windows", windows, f"must be from 1 to {LARGEST}")
    uprights, tops = range(windows + 1), range(windows)
    q = {f"j_upright{k}": pi / 2.0 for k in uprights} | {f"j_top{k}": -pi / 2.0 for k in tops}
    v = {f"j_upright{k}": -1.0 for k in uprights} | {f"j_top{k}": 1.0 for k in tops}
    return {
        "format": "hapticmech-scene/1",
        "name": f"n_four_bar_{windows}",
        "description": f"Benchmark A02: parallelograms in a row, N = {windows}",
        "task_space": "planar",
        "gravity": [0.0, -9.81, 0.0],
        "links": [
            *(_rod(f"upright{k}", "world", {"xyz": [float(k), 0.0, 0.0]}) for k in uprights),
            *(_rod(f"top{k}", f"upright{k}", _TIP) for k in tops),
        ],
        "closures": [_pin(k) for k in tops],
        "operational_points": [{"name": "b0", "link": "upright0", "origin": _TIP}],
        "initial_state": {"q": q, "v": v},
        "simulation": {"period": 0.001, "integrator": "rk4"},
        "hand": {"kind": "constant_wrench"},
    }


def _rod(name: str, parent: str, origin: dict[str, Any]) -> dict[str, Any]:
    joint = {"name": f"j_{name}", "type": "revolute", "axis": [0.0, 0.0, 1.0], "origin": origin}
    return {"name": name, "parent": parent, "joint": joint, "inertial": _ROD}


def _pin(k: int) -> dict[str, Any]:
    a, b = ({"link": link, "origin": _TIP} for link in (f"top{k}", f"upright{k + 1}"))
    return {"name": f"pin{k}", "kind": "planar_pin", "a": a, "b": b}
