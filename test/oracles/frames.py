# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The same scene in other axes and in other units."""

from __future__ import annotations

import copy

import numpy as np

from oracles.generator import floats
from oracles.kinematics import Array, Document, rotation_of_rpy, rpy_of_rotation


def _turned(origin: Document, rotation: Array) -> Document:
    xyz = rotation @ np.asarray(origin.get("xyz", (0, 0, 0)), dtype=float)
    own = rotation_of_rpy(origin.get("rpy", (0, 0, 0)))
    return {"xyz": floats(xyz), "rpy": rpy_of_rotation(rotation @ own)}


def rotated(document: Document, rotation: Array) -> Document:
    """Return the whole scene, ground and gravity included, turned in the world."""
    turned = copy.deepcopy(document)
    turned["gravity"] = floats(rotation @ np.asarray(document["gravity"]))
    for link in turned["links"]:
        if link["parent"] == "world":
            link["joint"]["origin"] = _turned(link["joint"].get("origin", {}), rotation)
    for closure in turned["closures"]:
        for side in ("a", "b"):
            if closure[side]["link"] == "world":
                closure[side]["origin"] = _turned(closure[side].get("origin", {}), rotation)
    return turned


def rescaled(document: Document, q: Array, length: float, mass: float) -> tuple[Document, Array]:
    """Return scene and configuration with ``length`` new units per metre, ``mass`` per kilogram."""
    scaled, position, start = copy.deepcopy(document), q.copy(), 0
    scaled["gravity"] = floats(length * np.asarray(document["gravity"]))
    linear = {"prismatic": (0,), "free": (0, 1, 2), "planar": (0, 1)}
    sizes = {"revolute": 1, "prismatic": 1, "spherical": 4, "free": 7, "planar": 4, "fixed": 0}

    def scale_origin(part: Document) -> None:
        if "origin" in part and "xyz" in part["origin"]:
            part["origin"]["xyz"] = floats(length * np.asarray(part["origin"]["xyz"]))

    for link in scaled["links"]:
        kind = link["joint"]["type"]
        for k in linear.get(kind, ()):
            position[start + k] *= length
        start += sizes[kind]
        scale_origin(link["joint"])
        if "armature" in link["joint"]:
            link["joint"]["armature"] *= mass * (1.0 if kind == "prismatic" else length**2)
        inertial = link["inertial"]
        inertial["mass"] *= mass
        inertial["com"] = floats(length * np.asarray(inertial["com"]))
        inertial["inertia"] = {k: mass * length**2 * i for k, i in inertial["inertia"].items()}
    for closure in scaled["closures"]:
        scale_origin(closure["a"])
        scale_origin(closure["b"])
    for point in scaled["operational_points"]:
        scale_origin(point)
    return scaled, position
