# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mechanism as lines, for pictures: links between their joints, at a configuration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.model import TreeModel, build_tree, se3
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Origin

# Frames nearer than this (m) to a link's own are at its joint: no line.
_SAME_PLACE = 1e-9


@dataclass(frozen=True, slots=True)
class Skeleton:
    """Lines and joints of a mechanism at one configuration.

    Attributes:
        links: per line, link name and (2, 3) its ends in the world, m.
        joints: (k, 3) where links are joined to each other, m.
        ground: (g, 3) where they are joined to the world, m.
        bars: (2, 3) ends of every rod that is closed at the start, and of every slide from where
            it is at zero, m.
    """

    links: tuple[tuple[str, Array], ...]
    joints: Array
    ground: Array
    bars: tuple[Array, ...] = ()


def skeleton(scene: Scene, q: Array) -> Skeleton:
    """Return the lines of ``scene`` at configuration q (nq,).

    A link is drawn from its own joint to every frame that something else is attached to.

    Args:
        scene: whose.
        q: (nq,) configuration.
    """
    tree = build_tree(scene)
    data = tree.pinocchio.createData()
    pin.forwardKinematics(tree.pinocchio, data, np.asarray(q, dtype=float))
    lines: list[tuple[str, Array]] = []
    joints: list[Array] = []
    ground = [
        _place(tree, data, "world", link.joint.origin)
        for link in scene.links
        if link.parent == "world" and link.joint.type not in ("free", "planar")
    ]
    for name, origin, is_joint in attachments(scene):
        end = _place(tree, data, name, origin)
        if name == "world":
            ground.append(end)
            continue
        if is_joint:
            joints.append(end)
        start = _place(tree, data, name, Origin())
        if np.linalg.norm(end - start) > _SAME_PLACE:
            lines.append((name, np.array((start, end))))
    pairs = [
        ((rod.a.link, rod.a.origin), (rod.b.link, rod.b.origin))
        for rod in scene.closures
        if rod.kind == "rod" and rod.active
    ]
    pairs += [
        ((link.parent, link.joint.origin), (link.name, Origin()))
        for link in scene.links
        if link.joint.type == "prismatic"
    ]
    bars = [np.array([_place(tree, data, *end) for end in pair]) for pair in pairs]
    long = tuple(bar for bar in bars if np.linalg.norm(bar[1] - bar[0]) > _SAME_PLACE)
    return Skeleton(tuple(lines), _rows(joints), _rows(ground), long)


def attachments(scene: Scene) -> list[tuple[str, Origin, bool]]:
    """Return link, frame in it, and whether it is a joint, for everything attached to a link.

    Joints of other links, closures (whether closed or not; their frames may be in ``world``) and
    operational points.
    """
    found = [
        (link.parent, link.joint.origin, True) for link in scene.links if link.parent != "world"
    ]
    for closure in scene.closures:
        found += [(end.link, end.origin, True) for end in (closure.a, closure.b)]
    found += [(point.link, point.origin, False) for point in scene.operational_points]
    return found


def _place(tree: TreeModel, data: pin.Data, link: str, origin: Origin) -> Array:
    joint, placement = tree.link_joint[link]
    return np.array((data.oMi[joint] * placement * se3(origin)).translation)


def _rows(points: list[Array]) -> Array:
    return np.array(points).reshape(-1, 3)
