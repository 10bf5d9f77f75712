"""Chains of any number of links, for what a step costs over size."""

from __future__ import annotations

from typing import Any

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene import Scene, scene_from_document

LARGEST = 200
LENGTH, MASS = 1.0, 1.0


def chain(links: int) -> Scene:
    """Return a chain of uniform rods (1 kg, 1 m) on hinges about z, let go level.

    The point ``tip`` is the last rod's free end; gravity along -y. Rods start a little bent, one to
    the other side of the next, so that all joints move from the start.

    Raises:
        InvalidInputError: ``links`` is not from 1 to 200.
    """
    if not 1 <= links <= LARGEST:
        raise InvalidInputError("links", links, f"must be from 1 to {LARGEST}")
    return scene_from_document(_document(links), source=f"chain({links})")


def _document(links: int) -> dict[str, Any]:
    moments = dict.fromkeys(("ixx", "iyy", "izz"), MASS * LENGTH**2 / 12.0)
    rod = {"mass": MASS, "com": [0.5 * LENGTH, 0.0, 0.0], "inertia": moments}
    return {
        "format": "hapticmech-scene/1",
        "name": f"chain_{links}",
        "description": f"A chain of {links} rods",
        "task_space": "planar",
        "gravity": [0.0, -9.81, 0.0],
        "links": [
            {
                "name": f"rod{k}",
                "parent": f"rod{k - 1}" if k else "world",
                "joint": {
                    "name": f"hinge{k}",
                    "type": "revolute",
                    "origin": {"xyz": [LENGTH if k else 0.0, 0.0, 0.0]},
                },
                "inertial": rod,
            }
            for k in range(links)
        ],
        "operational_points": [
            {"name": "tip", "link": f"rod{links - 1}", "origin": {"xyz": [LENGTH, 0.0, 0.0]}}
        ],
        "initial_state": {"q": {f"hinge{k}": 0.1 * (-1.0) ** k for k in range(links)}},
        "hand": {"kind": "constant_wrench"},
    }
