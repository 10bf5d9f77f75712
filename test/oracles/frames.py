# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The same scene elsewhere, in other axes and in other units."""

from __future__ import annotations

import copy
import json

import numpy as np

from oracles.generator import floats
from oracles.kinematics import Array, Document, Pose, place, rpy_of_rotation


def placed(document: Document, base: Pose) -> Document:
    """Return a document with everything in the world moved by ``base`` (R, p)."""
    document = copy.deepcopy(document)

    def moved(part: Document) -> Document:
        rotation, position = place(base, part.get("origin", {}))
        return part | {"origin": {"xyz": floats(position), "rpy": rpy_of_rotation(rotation)}}

    document["gravity"] = floats(base[0] @ document["gravity"])
    for link in document["links"]:
        if link["parent"] == "world":
            link["joint"] = moved(link["joint"])
    for closure in document["closures"]:
        for end in ("a", "b"):
            if closure[end]["link"] == "world":
                closure[end] = moved(closure[end])
    return document


def rotated(document: Document, rotation: Array) -> Document:
    """Return the whole scene, ground and gravity included, turned in the world."""
    return placed(document, (rotation, np.zeros(3)))


def in_units(document: Document, length: float, mass: float) -> Document:
    """Return a document as written where 1 m is ``length`` units of it, and 1 kg ``mass``."""
    # By way of text: no two parts of it are the same object.
    document = json.loads(json.dumps(document))
    sliding = {"prismatic": mass, "revolute": mass * length**2, "spherical": mass * length**2}
    # Positions along: of their coordinates these many are lengths, before angles or quaternions.
    along = {"prismatic": 1, "planar": 2, "free": 3}

    def origin(part: Document) -> None:
        if "origin" in part:
            part["origin"]["xyz"] = floats(length * np.array(part["origin"]["xyz"]))

    document["gravity"] = floats(length * np.array(document["gravity"]))
    start = document.get("initial_state", {}).get("q", {})
    for link in document["links"]:
        joint, inertial = link["joint"], link["inertial"]
        origin(joint)
        if "armature" in joint:
            joint["armature"] *= sliding[joint["type"]]
        if (count := along.get(joint["type"])) and joint["name"] in start:
            q = np.atleast_1d(np.array(start[joint["name"]]))
            q[:count] *= length
            start[joint["name"]] = floats(q) if q.size > 1 else float(q[0])
        inertial["mass"] *= mass
        inertial["com"] = floats(length * np.array(inertial["com"]))
        for name in inertial["inertia"]:
            inertial["inertia"][name] *= mass * length**2
    for frame in [closure[end] for closure in document["closures"] for end in ("a", "b")]:
        origin(frame)
    for point in document["operational_points"]:
        origin(point)
    return document
