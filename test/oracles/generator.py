# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Seeded random mechanisms as scene documents, their closures met at the sampled configuration."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from functools import cache

import numpy as np

from oracles.kinematics import (
    Array,
    Document,
    Pose,
    frame_pose,
    link_poses,
    origin_in,
    place,
    turn,
)

SPATIAL_JOINTS = ("revolute", "prismatic", "spherical", "free", "planar", "revolute")
PLANAR_JOINTS = ("revolute", "prismatic", "planar", "revolute", "revolute")
SPATIAL_KINDS = ("spherical", "revolute", "weld")
PLANAR_KINDS = ("planar_pin", "planar_pin", "spherical", "revolute", "weld")
ROWS = {"spherical": 3, "revolute": 5, "weld": 6, "planar_pin": 2}
# Joints that a rotor may be geared to.
GEARED = ("revolute", "prismatic", "spherical")
RATE_SIZE = {"revolute": 1, "prismatic": 1, "spherical": 3, "free": 6, "planar": 3, "fixed": 0}


@dataclass(frozen=True)
class Sample:
    """A scene document with a configuration at which its closures are met, and any rates."""

    document: Document
    q: Array
    v: Array


def floats(values) -> list[float]:
    """Return plain floats, as a scene file would give them."""
    return [float(value) for value in values]


def unit(rng: np.random.Generator, size: int = 3) -> Array:
    """Return a random unit vector."""
    vector = rng.normal(size=size)
    return vector / np.linalg.norm(vector)


def random_origin(rng: np.random.Generator, planar: bool, reach: float = 0.3) -> Document:
    xyz, rpy = rng.uniform(-reach, reach, 3), rng.uniform(-1.2, 1.2, 3)
    if planar:
        xyz[2] = 0.0
        rpy[:2] = 0.0
    return {"xyz": floats(xyz), "rpy": floats(rpy)}


def random_inertial(rng: np.random.Generator, planar: bool) -> Document:
    """Return the inertia of a cloud of points: always one that a body can have."""
    mass = float(rng.uniform(0.3, 2.0))
    spread = rng.normal(size=(3, 3)) * 0.1
    second = mass * (spread @ spread.T + 1e-3 * np.eye(3))
    i = np.trace(second) * np.eye(3) - second
    com = rng.uniform(-0.1, 0.1, 3)
    if planar:
        com[2] = 0.0
    names = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2)}
    inertia = {name: float(i[at]) for name, at in names.items()} | {"iyz": float(i[1, 2])}
    return {"mass": mass, "com": floats(com), "inertia": inertia}


def random_position(rng: np.random.Generator, kind: str) -> Array:
    if kind == "spherical":
        return unit(rng, 4)
    if kind == "free":
        return np.concatenate((rng.uniform(-0.3, 0.3, 3), unit(rng, 4)))
    if kind == "planar":
        angle = rng.uniform(-np.pi, np.pi)
        return np.array([*rng.uniform(-0.3, 0.3, 2), np.cos(angle), np.sin(angle)])
    return np.array([] if kind == "fixed" else [rng.uniform(-1.0, 1.0)])


def random_axis(rng: np.random.Generator, kind: str, planar: bool) -> Array:
    if not planar:
        return unit(rng)
    return np.array([0.0, 0.0, 1.0]) if kind == "revolute" else np.array([*unit(rng, 2), 0.0])


def closing_frame(rng: np.random.Generator, kind: str, a: Pose, planar: bool) -> Pose:
    """Return a pose of frame b that meets frame a, using what freedom the kind leaves."""
    angle = rng.uniform(-np.pi, np.pi)
    if kind == "weld":
        return a
    if kind == "spherical" and not planar:
        return turn(unit(rng), angle), a[1]
    return a[0] @ turn((0, 0, 1), angle), a[1]


def blank(planar: bool = False, gravity=(0.0, 0.0, 0.0)) -> Document:
    """Return a document without links."""
    return {
        "format": "hapticmech-scene/1",
        "name": "sample",
        "task_space": "planar" if planar else "spatial",
        "gravity": floats(gravity),
        "links": [],
        "closures": [],
        "operational_points": [],
        "hand": {"kind": "constant_wrench"},
    }


@cache
def random_mechanism(
    seed: int, planar: bool = False, closed: bool = True, duplicated: bool = False, links: int = 5
) -> Sample:
    """Return a random tree, closed by as many random closures as leave it two rates or more."""
    rng = np.random.default_rng([seed, planar, links])
    document = blank(planar, (*rng.uniform(-9.0, 9.0, 2), 0.0 if planar else 3.0))
    q, rates = [], 0
    for index in range(links):
        # A chain with a branch now and then; the fourth link is fixed to the third now and then.
        parent = f"link{index - 1 if rng.random() < 0.7 else rng.integers(index)}" if index else ""
        joints = PLANAR_JOINTS if planar else SPATIAL_JOINTS
        kind = "fixed" if index == 3 and seed % 4 == 0 else str(rng.choice(joints))
        joint = {"name": f"joint{index}", "type": kind, "origin": random_origin(rng, planar)}
        joint |= {"axis": floats(random_axis(rng, kind, planar)), "damping": 0.1 * rng.random()}
        if index % 2 and kind in GEARED:
            joint["armature"] = 0.01 * (index + 1)
        q.append(random_position(rng, kind))
        rates += RATE_SIZE[kind]
        document["links"].append(
            {
                "name": f"link{index}",
                "parent": parent or "world",
                "joint": joint,
                "inertial": random_inertial(rng, planar),
            }
        )
    for name, index in (("tip", links - 1), ("middle", links // 2)):
        origin = random_origin(rng, planar)
        point = {"name": name, "link": f"link{index}", "origin": origin}
        document["operational_points"].append(point)
    position, v = np.concatenate(q), rng.normal(size=rates)
    if closed:
        _close(rng, document, position, rates, planar)
    if duplicated:
        # Frames exchanged: other rows, same motions allowed.
        for closure in list(document["closures"]):
            again = closure | {"name": closure["name"] + "_again"}
            document["closures"].append(again | {"a": closure["b"], "b": closure["a"]})
    return Sample(document, position, v)


@cache
def closed_chain(seed: int, kind: str) -> Sample:
    """Return a single chain of 8 rates (planar: 5) pinned to the world by one closure of ``kind``.

    The chain can move its end in all directions, so that the closure's rows are independent.
    """
    planar = kind == "planar_pin"
    rng = np.random.default_rng([seed, ord(kind[0])])
    joints = ("spherical", "revolute", "prismatic", "spherical")
    if planar:
        joints = ("revolute", "planar", "revolute")
    document = copy.deepcopy(random_mechanism(seed, planar, False, links=len(joints)).document)
    for index, joint in enumerate(joints):
        link = document["links"][index]
        link["parent"] = f"link{index - 1}" if index else "world"
        axis = floats(random_axis(rng, joint, planar))
        link["joint"] |= {"type": joint, "axis": axis}
        if joint not in GEARED:
            link["joint"].pop("armature", None)
    q = np.concatenate([random_position(rng, joint) for joint in joints])
    a = {"link": f"link{len(joints) - 1}", "origin": random_origin(rng, planar)}
    poses = link_poses(document, q)
    frame = closing_frame(rng, kind, frame_pose(poses, a), planar)
    b = {"link": "world", "origin": origin_in(poses["world"], frame)}
    document["closures"] = [{"name": "loop", "kind": kind, "a": a, "b": b}]
    return Sample(document, q, rng.normal(size=sum(RATE_SIZE[joint] for joint in joints)))


def _close(
    rng: np.random.Generator, document: Document, q: Array, rates: int, planar: bool
) -> None:
    poses = link_poses(document, q)
    movable = [link["name"] for link in document["links"] if link["joint"]["type"] != "fixed"]
    rows = 0
    for index in range(6):
        kind = str(rng.choice(PLANAR_KINDS if planar else SPATIAL_KINDS))
        needs = min(ROWS[kind], 3) if planar else ROWS[kind]
        if rows + needs > rates - 2:
            continue
        rows += needs
        a, b = (str(name) for name in rng.choice([*movable, "world"], 2, replace=False))
        origin = random_origin(rng, planar)
        frame = closing_frame(rng, kind, place(poses[a], origin), planar)
        document["closures"].append(
            {
                "name": f"loop{index}",
                "kind": kind,
                "a": {"link": a, "origin": origin},
                "b": {"link": b, "origin": origin_in(poses[b], frame)},
            }
        )
