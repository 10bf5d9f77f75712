# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Chooses the joint of a loop to cut: one that a closure can replace."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from hapticmech_ros.formats.model import Joint, LoopJoint, from_z

# Closures for a joint that carries a body a second time.
LOOP_JOINTS = {"revolute": "revolute", "spherical": "spherical", "fixed": "weld"}
# Joints that stay in the tree, if another joint of their loop can be cut.
CARRIED = ("prismatic", "planar")
# m, from the centre of a universal joint to the ends of the rod between its axes.
ARM = 0.1
# In rad: axes of a universal joint are not parallel, and meet within that times the arm.
APART, MEET = 1e-3, 1e-9


def reversed_joint(hinge: Joint) -> Joint:
    """Return the same joint with parent and child exchanged, at the same position."""
    return replace(
        hinge,
        parent=hinge.child,
        child=hinge.parent,
        in_parent=hinge.of_child.inverse(),
        of_child=hinge.in_parent.inverse(),
        axis=-hinge.axis,
    )


def other_cut(
    closing: Joint, carriers: Mapping[str, Joint], cost: Callable[[Joint], tuple[object, ...]]
) -> tuple[Joint, list[Joint]] | None:
    """Return the joint of a loop to cut instead of one that closes it, and the changed joints.

    Args:
        closing: joint that carries a body a second time.
        carriers: joints of the tree by the body that they carry.
        cost: of cutting a joint; infinite in its first part where it cannot be. Of those that cost
            the same it is the one nearest to ``closing``.

    Returns:
        the joint to cut, and others as they have to be, turned around or not; None if there is
        none to cut.
    """
    sides = [_upwards(end, carriers) for end in (closing.child, closing.parent)]
    shared = {one.name for one in sides[0]} & {one.name for one in sides[1]}
    found = []
    for turned, side in zip((False, True), sides, strict=True):
        way = [one for one in side if one.name not in shared]
        for steps, hinge in enumerate(way):
            if hinge.type in LOOP_JOINTS:
                changed = [reversed_joint(one) for one in way[:steps]]
                changed.append(reversed_joint(closing) if turned else closing)
                found.append(((*cost(hinge), steps), hinge, changed))
    found = [one for one in found if one[0][0] != np.inf]
    if not found:
        return None
    _, cut, changed = min(found, key=lambda one: one[0])
    return cut, changed


def _upwards(body: str, carriers: Mapping[str, Joint]) -> list[Joint]:
    """Return the joints from a body to the world."""
    found = []
    while body in carriers:
        found.append(carriers[body])
        body = carriers[body].parent
    return found


def loop_joint_of(hinge: Joint) -> LoopJoint:
    """Return the closure that a joint is, which is one of :data:`LOOP_JOINTS`."""
    level = from_z(hinge.axis) if hinge.type == "revolute" else pin.SE3.Identity()
    a = (hinge.parent, hinge.in_parent * level)
    b = (hinge.child, hinge.of_child.inverse() * level)
    return LoopJoint(hinge.name, LOOP_JOINTS[hinge.type], a, b)


def universal_of(first: Joint, second: Joint) -> Sequence[LoopJoint] | None:
    """Return the closures that two hinges are, with a body without mass between them.

    Their centre stays where it is in both bodies, and a rod from axis to axis keeps the angle
    between these.

    Returns:
        None if it is no universal joint: other joints, or axes that do not meet or are parallel.
    """
    if (first.type, second.type) != ("revolute", "revolute"):
        return None
    between = first.of_child * second.in_parent
    cosine = float(first.axis @ between.rotation @ second.axis)
    if np.linalg.norm(between.translation) > MEET * ARM or 1.0 - abs(cosine) < 0.5 * APART**2:
        return None
    a, b = first.in_parent, second.of_child.inverse()
    ends = (first.parent, _moved(a, first.axis)), (second.child, _moved(b, second.axis))
    length = ARM * float(np.sqrt(2.0 - 2.0 * cosine))
    return (
        LoopJoint(first.name, "spherical", (first.parent, a), (second.child, b)),
        LoopJoint(f"{first.name}_angle", "rod", *ends, length=length),
    )


def _moved(place: pin.SE3, axis: np.ndarray) -> pin.SE3:
    return pin.SE3(place.rotation, place.act(ARM * axis))
