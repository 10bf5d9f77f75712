# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Operational points that are set while a mechanism runs: any link, any offset."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.model import se3
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import OperationalPoint, Origin
from hapticmech_ros.scene.rules import has_own_metric

GRASP_SIZE = 7
# An offset beyond this (m) is a slip of the pen, and its lever arm would lose all digits.
FARTHEST = 1000.0
_WHAT = "grasp"


def grasped(scene: Scene, name: str, frame: str, origin: Origin | None = None) -> OperationalPoint:
    """Return an operational point that is put elsewhere.

    Args:
        scene: as it stands.
        name: of the operational point that goes elsewhere; the first one if empty.
        frame: a link, or an operational point of the scene: it is held where that one is. The
            metric stays its own.
        origin: in that frame; at its own origin if None.

    Raises:
        InvalidInputError: unknown point, link or frame; an offset beyond 1 km or not finite; or a
            link without full inertia of its own, where the point has no metric.
    """
    held = scene.operational_point(name)
    links = {link.name: link for link in scene.links}
    points = {point.name: point for point in scene.operational_points}
    if frame not in links and frame not in points:
        raise InvalidInputError(_WHAT, frame, f"must be one of {[*links, *points]}")
    own = origin or Origin()
    if not math.hypot(*own.xyz) <= FARTHEST or not all(map(math.isfinite, own.rpy)):
        rule = f"offset must be within {FARTHEST:g} m, angles finite"
        raise InvalidInputError(_WHAT, (*own.xyz, *own.rpy), rule)
    if frame in points:
        there = points[frame]
        frame, own = there.link, _joined(there.origin, own)
    if held.metric is None and not has_own_metric(links[frame]):
        rule = f"link has no full inertia of its own: give point {held.name} a metric in the scene"
        raise InvalidInputError(_WHAT, frame, rule)
    return held.model_copy(update={"link": frame, "origin": own})


def grasp_written(scene: Scene, name: str, text: str) -> OperationalPoint:
    """Return what ``"frame"``, ``"frame x y z"`` or ``"frame x y z roll pitch yaw"`` stands for.

    Raises:
        InvalidInputError: another number of words, a word that is no number; and as
            :func:`grasped`.
    """
    frame, *offset = text.split() or [""]
    if not offset:
        return grasped(scene, name, frame)
    try:
        numbers = [float(word) for word in offset]
    except ValueError:
        numbers = []
    if len(numbers) not in (3, 6):
        rule = "must be a link or point, then x y z (m), then roll pitch yaw (rad), or less"
        raise InvalidInputError(_WHAT, text, rule)
    return grasped(scene, name, frame, _origin(numbers[:3], numbers[3:] or (0.0, 0.0, 0.0)))


def grasp_posed(scene: Scene, name: str, frame: str, pose: pin.SE3) -> OperationalPoint:
    """Return an operational point put at a pose in a link's, or another point's, frame.

    Raises:
        InvalidInputError: as :func:`grasped`.
    """
    return grasped(
        scene, name, frame, _origin(pose.translation, pin.rpy.matrixToRpy(pose.rotation))
    )


def flat_grasp(scene: Scene, point: OperationalPoint) -> Array:
    """Return where a point is held (7,): index of the link, xyz (m) and rpy (rad) in its frame."""
    place = [link.name for link in scene.links].index(point.link)
    return np.array((place, *point.origin.xyz, *point.origin.rpy))


def flat_grasps(scene: Scene) -> Array:
    """Return where every operational point is held (points, 7); see :func:`flat_grasp`."""
    return np.array([flat_grasp(scene, point) for point in scene.operational_points])


def grasp_of(scene: Scene, name: str, numbers: Array) -> OperationalPoint:
    """Return the point that numbers (7,) put elsewhere; see :func:`flat_grasp`.

    Args:
        scene: whose.
        name: of the point.
        numbers: (7,) see :func:`flat_grasp`.

    Raises:
        InvalidInputError: no such link; and as :func:`grasped`.
    """
    place, *offset = numbers.tolist()
    if place not in range(len(scene.links)):
        rule = f"must be a whole number from 0 to {len(scene.links) - 1}"
        raise InvalidInputError("link of a grasp", place, rule)
    frame = scene.links[int(place)].name
    return grasped(scene, name, frame, _origin(offset[:3], offset[3:]))


def _joined(outer: Origin, inner: Origin) -> Origin:
    if inner == Origin():
        return outer
    pose = se3(outer) * se3(inner)
    return _origin(pose.translation, pin.rpy.matrixToRpy(pose.rotation))


def _origin(xyz: Array | list[float], rpy: Array | list[float] | tuple[float, ...]) -> Origin:
    x, y, z = map(float, xyz)
    roll, pitch, yaw = map(float, rpy)
    return Origin.model_construct(xyz=(x, y, z), rpy=(roll, pitch, yaw))
