# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reach of the operational point in a loop: the circle on which the links beyond are stretched."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Closure, Link, LinkFrame

_SAME_PLACE = 1e-9


@dataclass(frozen=True, slots=True)
class TautCircle:
    """Centre (2,) in m, in the plane x-y of the world, and radius in m."""

    centre: Array
    radius: float


def taut_circle(scene: Scene, point: str = "") -> TautCircle | None:
    """Return the circle on which the chain from the operational point to a ground pin is stretched.

    It is defined for a planar scene in which a chain of pin-jointed links starts at the operational
    point and ends in a closure with the world; else None.
    """
    if scene.task_space != "planar":
        return None
    held = scene.operational_point(point)
    parents = {link.name: link for link in scene.links}
    for closure in scene.closures:
        ends = _ground_pin(closure)
        if ends is None:
            continue
        tip, ground = ends
        chain = _chain(parents, tip.link, held.link)
        if not chain or any(link.joint.type != "revolute" or link.joint.locked for link in chain):
            continue
        first = np.array(chain[0].joint.origin.xyz) - np.array(held.origin.xyz)
        if np.linalg.norm(first) > _SAME_PLACE:
            continue
        steps = [link.joint.origin.xyz for link in chain[1:]] + [tip.origin.xyz]
        radius = float(sum(np.linalg.norm(step) for step in steps))
        return TautCircle(np.array(ground.origin.xyz[:2]), radius)
    return None


def _ground_pin(closure: Closure) -> tuple[LinkFrame, LinkFrame] | None:
    """Return moving end and ground end of a pin to the world; None for other closures."""
    if closure.kind in ("weld", "rod"):
        return None
    for tip, ground in ((closure.a, closure.b), (closure.b, closure.a)):
        if ground.link == "world" and tip.link != "world":
            return tip, ground
    return None


def _chain(links: dict[str, Link], tip: str, root: str) -> list[Link]:
    """Return the links after ``root`` up to ``tip``; empty if ``tip`` does not descend from it."""
    chain: list[Link] = []
    name = tip
    while name != root:
        if name == "world":
            return []
        chain.append(links[name])
        name = links[name].parent
    return chain[::-1]
