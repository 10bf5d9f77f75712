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

Rates follow from ȧ = ω_a × a, so that no logarithm has to be differentiated. Kernels
compute all this (``closure_kernels``); here closures are bound to the frames they act between.

A ``coupling`` is one row between two joints, ``θ - p(θ_leader)`` with a polynomial p of degree 4 at
most: W has 1 and -p', Ẇv is -p'' θ̇_leader².
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.model import TreeModel
from hapticmech_ros.scene.mechanism import Closure, Coupling, LoopKind, Origin

# Which closures are closed, in the order of the scene.
Active = tuple[bool, ...]

WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
ROWS: dict[LoopKind, int] = {
    "spherical": 3,
    "weld": 6,
    "revolute": 5,
    "planar_pin": 2,
    "rod": 1,
    "coupling": 1,
}
_POINT_ROWS: dict[LoopKind, int] = {
    "spherical": 3,
    "weld": 3,
    "revolute": 3,
    "planar_pin": 2,
    "rod": 1,
    "coupling": 0,
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
        return ROWS[self.kind]

    @property
    def has_axes(self) -> bool:
        """Whether there are rows of axes, and with them a root of φ that is a branch of its own."""
        return self.kind in ("revolute", "weld")

    @property
    def point_rows(self) -> int:
        """Number of rows in m, the first ones; the others are of axes, or of angles."""
        return self.rows if self.linear else _POINT_ROWS[self.kind]

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
