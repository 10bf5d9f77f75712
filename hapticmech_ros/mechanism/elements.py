# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Springs, dampers, friction, stops and efforts: their energy, and what is too stiff for a step.

In a joint with coordinate q and rate v (docs/notation.md):

* spring k (rest - q), damper -c v, friction -f tanh(v / v_f), and a constant effort;
* a stop entered by d >= 0 pushes out with max(k d + b min(d / depth, 1) ḋ, 0): it never pulls.

Between the origins of two frames, l apart: tension k (l - rest) + c l̇, which acts along the line.
None of them makes energy: T8 of docs/derivations.md. Kernels compute the forces
(``element_kernels``).

With the inertia m that an element moves, 1 / (r D⁻¹ rᵀ) for a row r of rates, loops cut open, an
explicit rule is unstable where k T² / m or c T / m exceeds the rule's limits: 8 and 2.8 for rk4.
Below that the check of each step's energy divides steps of rk4 until they are accurate; an implicit
rule is stable at any ratio, and damps motions that are faster than its step.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.mechanism.model import TreeModel, authored_state
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import IntegratorName, Joint, Spring

# Below this fraction of the mechanism's length the line between two points has no direction.
SHORTEST = 1e-9


@dataclass(frozen=True)
class JointElement:
    """A joint's spring, friction and stops, without its damping.

    Attributes:
        rate: index of the joint in v.
        position: index of the joint in q.
        joint: its values.
    """

    rate: int
    position: int
    joint: Joint

    def energy(self, q: float) -> float:
        """Return the elastic energy, J, of spring and stops at q, rad or m."""
        energy = 0.5 * self.joint.stiffness * (q - self.joint.rest) ** 2
        stops = self.joint.limits
        if stops is not None:
            energy += 0.5 * stops.stiffness * max(stops.lower - q, q - stops.upper, 0.0) ** 2
        return energy


@dataclass(frozen=True)
class PointSpring:
    """A spring and damper between the origins of two frames of the Pinocchio model.

    Attributes:
        frame_a, frame_b: their indices.
        stiffness: k, N/m.
        damping: c, N s/m.
        rest_length: m.
    """

    name: str
    frame_a: int
    frame_b: int
    stiffness: float
    damping: float
    rest_length: float

    def gap(self, data: pin.Data) -> Array:
        """Return (3,) p_a - p_b, m, world axes, from placements in ``data.oMf``."""
        a, b = data.oMf[self.frame_a], data.oMf[self.frame_b]
        return np.asarray(a.translation - b.translation)

    def energy(self, data: pin.Data) -> float:
        """Return the elastic energy, J."""
        length = float(np.linalg.norm(self.gap(data)))
        return 0.5 * self.stiffness * (length - self.rest_length) ** 2


class Elements:
    """All elements of a mechanism.

    Attributes:
        effort: (nv,) constant forces of the joints, N m or N.
        joints: joints with a spring, friction or stops.
        springs: between points.
        shortest: m, length at and below which a spring has no direction and no force.
    """

    def __init__(self, tree: TreeModel, springs: tuple[PointSpring, ...], length: float) -> None:
        self.effort = np.zeros(tree.damping.size)
        self.springs = springs
        self.shortest = SHORTEST * length
        joints = []
        for index, joint in enumerate(tree.joints):
            rate, position = tree.velocity_slice(index).start, tree.position_slice(index).start
            if joint.effort:
                self.effort[rate] = joint.effort
            if joint.stiffness or joint.friction or joint.limits is not None:
                joints.append(JointElement(rate, position, joint))
        self.joints = tuple(joints)
        # Handed out by every evaluation.
        self.effort.flags.writeable = False

    def energy(self, data: pin.Data, q: Array) -> float:
        """Return the elastic energy, J, of all springs and stops.

        Args:
            data: with frames' placements at q.
            q: (nq,) configuration.
        """
        energy = sum(element.energy(float(q[element.position])) for element in self.joints)
        return float(energy + sum(spring.energy(data) for spring in self.springs))


def bind_spring(spring: Spring, tree: TreeModel) -> PointSpring:
    """Add the spring's frames to the model and return it bound to them."""
    frame_a = tree.add_frame(f"{spring.name}/spring_a", spring.a.link, spring.a.origin)
    frame_b = tree.add_frame(f"{spring.name}/spring_b", spring.b.link, spring.b.origin)
    return PointSpring(
        spring.name, frame_a, frame_b, spring.stiffness, spring.damping, spring.rest_length
    )


# Half and three quarters of rk4's limits: the inertia depends on the posture.
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
    """Return the integrator that ``auto`` selects: rk4, or the implicit one for stiff elements.

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
    ends = [
        pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED).reshape(6, model.nv)[:3]
        for frame in (spring.frame_a, spring.frame_b)
    ]
    direction = gap / length if length > 0.0 else np.zeros(3)
    return np.asarray(direction @ (ends[0] - ends[1]))
