# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is too stiff for an explicit step: springs, stops, dampers and friction, and what they move.

With the inertia m that an element moves, 1 / (r D⁻¹ rᵀ) for a row r of rates, loops cut open, an
explicit rule is unstable where k T² / m or c T / m exceeds a number of its own: 8 and 2.8 for rk4.
Below that the check of each step's energy divides steps of rk4 until they are accurate; an implicit
rule is stable at any ratio, and damps what is faster than its step.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.elements import PointSpring
from hapticmech_ros.mechanism.model import TreeModel, authored_state
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import IntegratorName

# Half and three quarters of what rk4 bears: the inertia depends on the posture.
STIFF, DAMPED = 4.0, 2.0


class StiffElement(NamedTuple):
    """An element that is too stiff for an explicit step.

    Attributes:
        name: which.
        kind: of the ratio.
        ratio: k T² / m or c T / m, as the scene starts.
        limit: that it exceeds.
    """

    name: str
    kind: str
    ratio: float
    limit: float

    def __str__(self) -> str:
        return f"{self.name}: {self.kind} = {self.ratio:.3g} is above {self.limit:g}"


def stiff_elements(
    scene: Scene, tree: TreeModel, springs: Sequence[PointSpring]
) -> Iterator[StiffElement]:
    """Yield elements that are too stiff for an explicit rule at the scene's step.

    Args:
        scene: whose step.
        tree: its joints.
        springs: its springs between points.
    """
    joints = [_of_joint(tree, index) for index in range(len(tree.joints))]
    if not (springs or any(stiffness or damping for stiffness, damping in joints)):
        return
    model, data = tree.pinocchio, tree.pinocchio.createData()
    q, _ = authored_state(scene, tree)
    upper = np.triu(pin.crba(model, data, q).reshape(model.nv, model.nv))
    try:
        mobility = np.linalg.inv(upper + np.triu(upper, 1).T)
    except np.linalg.LinAlgError:
        return
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    found = [
        (f"joint {joint.name}", *of_joint, mobility.diagonal()[tree.velocity_slice(index)].max())
        for index, (joint, of_joint) in enumerate(zip(tree.joints, joints, strict=True))
        if any(of_joint)
    ]
    for one in springs:
        row = _row(one, model, data)
        found.append((f"spring {one.name}", one.stiffness, one.damping, row @ mobility @ row))
    step = scene.simulation.period / scene.simulation.substeps
    for name, stiffness, damping, moved in found:
        for kind, ratio, limit in (
            ("k T² / m", stiffness * step**2 * moved, STIFF),
            ("c T / m", damping * step * moved, DAMPED),
        ):
            if ratio > limit:
                yield StiffElement(name, kind, ratio, limit)


def chosen_integrator(
    scene: Scene, tree: TreeModel, springs: Sequence[PointSpring]
) -> IntegratorName:
    """Return the integrator that ``auto`` stands for: rk4, or the implicit one for stiff elements.

    Args:
        scene: whose step.
        tree: its joints.
        springs: its springs between points.
    """
    stiff = next(stiff_elements(scene, tree, springs), None)
    return "rk4" if stiff is None else "linearly_implicit"


def _of_joint(tree: TreeModel, index: int) -> tuple[float, float]:
    """Return a joint's largest stiffness and damping."""
    joint, part = tree.joints[index], tree.velocity_slice(index)
    stiffness, damping = joint.stiffness, float(tree.damping[part].max(initial=0.0))
    if joint.friction:
        damping += joint.friction / joint.friction_speed
    if joint.limits is not None:
        stiffness = max(stiffness, joint.limits.stiffness)
        damping = max(damping, joint.limits.damping)
    return stiffness, damping


def _row(spring: PointSpring, model: pin.Model, data: pin.Data) -> Array:
    """Return (nv,) how a spring's length changes with the rates; zero where it has none."""
    gap = spring.gap(data)
    length = float(np.linalg.norm(gap))
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    ends = [
        pin.getFrameJacobian(model, data, frame, axes).reshape(6, model.nv)[:3]
        for frame in (spring.frame_a, spring.frame_b)
    ]
    direction = gap / length if length > 0.0 else np.zeros(3)
    return np.asarray(direction @ (ends[0] - ends[1]))
