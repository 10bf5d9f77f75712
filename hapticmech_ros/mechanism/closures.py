# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Loop closures: residual φ, Jacobian W and bias Ẇv of each kind (docs/notation.md).

Each residual is built from two blocks that are exact on the whole configuration manifold:

* point: ``p_a - p_b`` in world axes, 3 rows (x and y only for ``planar_pin``), metres; of a
  ``rod`` of length L one row, ``(|p_a - p_b|² - L²) / (2 L)``, the error of the length to first
  order, smooth everywhere;
* axes: products of unit axes of the two frames, dimensionless, radians to first order.
  ``revolute`` has ``[x_b . z_a, y_b . z_a]``; ``weld`` has ``1/2 sum_k b_k x a_k``, which is
  sin(angle) times the rotation axis.

Rates follow from ȧ = ω_a × a, without differentiating a logarithm. Kernels compute all this
(``closure_kernels``); here closures are bound to the frames they act between.

A ``coupling`` is one row between two joints, ``θ - p(θ_leader)`` with a polynomial p of degree 4 at
most: W has 1 and -p', Ẇv is -p'' θ̇_leader².

Operational points that are set while a mechanism runs: any link, any offset.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import InvalidInputError, check_one_of
from hapticmech_ros.mechanism.model import TreeModel, se3
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Closure, Coupling, LoopKind, OperationalPoint, Origin
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
    check_one_of(_WHAT, frame, [*links, *points])
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
    """Return the frame of ``"frame"``, ``"frame x y z"`` or ``"frame x y z roll pitch yaw"``.

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
    return grasped(scene, name, frame, origin_of(pose))


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
    return origin_of(se3(outer) * se3(inner))


def origin_of(pose: pin.SE3) -> Origin:
    """Return a pose in a frame as a scene's origin; the inverse of :func:`.model.se3`."""
    return _origin(pose.translation, pin.rpy.matrixToRpy(pose.rotation))


def _origin(xyz: Array | list[float], rpy: Array | list[float] | tuple[float, ...]) -> Origin:
    x, y, z = map(float, xyz)
    roll, pitch, yaw = map(float, rpy)
    return Origin.model_construct(xyz=(x, y, z), rpy=(roll, pitch, yaw))


# Which closures are closed, in the order of the scene.
Active = tuple[bool, ...]

# Rows of a closure's points: along the world's axes, or the distance.
_POINT = ("x", "y", "z", "length")
# Names of each kind's rows, those of points first; then the tilt of b's x and y axis out of the
# hinge's plane, or turns about the world's axes.
ROW_NAMES: dict[LoopKind, tuple[str, ...]] = {
    "spherical": ("x", "y", "z"),
    "revolute": ("x", "y", "z", "tilt_x", "tilt_y"),
    "weld": ("x", "y", "z", "turn_x", "turn_y", "turn_z"),
    "planar_pin": ("x", "y"),
    "rod": ("length",),
    "coupling": ("gear",),
}


@dataclass(frozen=True)
class LoopClosure:
    """One closure bound to its two frames in the Pinocchio model.

    Attributes:
        frame_a, frame_b: frames in it; of a coupling any frames that its two joints carry.
        latch_distance: |φ|, m or rad, within which it may latch; None if it does not.
        rod_length: m, of a rod.
        gear: coefficients of a coupling's p, the constant first.
        linear: whether a coupling's joint slides.
    """

    name: str
    kind: LoopKind
    frame_a: int
    frame_b: int
    latch_distance: float | None
    rod_length: float = 0.0
    gear: tuple[float, ...] = ()
    linear: bool = False

    @property
    def rows(self) -> int:
        """Number m of scalar constraints."""
        return len(ROW_NAMES[self.kind])

    @property
    def point_rows(self) -> int:
        """Number of rows in m, the first ones; the others are of axes, or of angles."""
        return self.rows if self.linear else sum(n in _POINT for n in ROW_NAMES[self.kind])

    def row_lengths(self, length: float) -> Array:
        """Return (m,) the unit of each row: ``length`` (m) for points, 1 for axes."""
        points = self.point_rows
        return np.array([length] * points + [1.0] * (self.rows - points))

    def on_wrong_branch(self, data: pin.Data) -> bool:
        """Return whether the axes are more than 90° apart, where φ no longer measures the angle."""
        a, b = data.oMf[self.frame_a].rotation, data.oMf[self.frame_b].rotation
        if self.kind == "weld":
            return bool(np.trace(b.T @ a) <= 1.0)
        if self.kind == "revolute":
            return bool(b[:, 2] @ a[:, 2] <= 0.0)
        return False


def bind_closure(closure: Closure, tree: TreeModel) -> LoopClosure:
    """Add the closure's frames to the model and return it bound to them."""
    frame_a = tree.add_frame(f"{closure.name}/a", closure.a.link, closure.a.origin)
    frame_b = tree.add_frame(f"{closure.name}/b", closure.b.link, closure.b.origin)
    latch, length = closure.latch_distance, closure.length or 0.0
    return LoopClosure(closure.name, closure.kind, frame_a, frame_b, latch, length)


def bind_coupling(coupling: Coupling, tree: TreeModel) -> LoopClosure:
    """Add a frame of each joint to the model and return the coupling bound to them."""
    at = [tree.joint_names.index(name) for name in (coupling.joint, coupling.leader)]
    a, b = (
        tree.add_frame(f"{coupling.name}/{side}", tree.links[index], Origin())
        for side, index in zip("ab", at, strict=True)
    )
    linear = tree.joint_types[at[0]] == "prismatic"
    return LoopClosure(coupling.name, "coupling", a, b, None, gear=coupling.curve, linear=linear)
