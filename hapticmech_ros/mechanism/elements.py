# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Springs, dampers, friction, stops and efforts: what they are, and their elastic energy.

In a joint with coordinate q and rate v (docs/notation.md):

* spring k (rest - q), damper -c v, friction -f tanh(v / v_f), and a constant effort;
* a stop entered by d >= 0 pushes out with max(k d + b min(d / depth, 1) ḋ, 0): it never pulls.

Between the origins of two frames, l apart: tension k (l - rest) + c l̇, which acts along the line.
None of them makes energy: T8 of docs/derivations.md. Kernels compute the forces
(``element_kernels``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.model import TreeModel
from hapticmech_ros.scene.mechanism import Joint, Spring

# Below this fraction of the mechanism's length the line between two points has no direction.
SHORTEST = 1e-9


@dataclass(frozen=True)
class JointElement:
    """What acts in one joint besides its damping: spring, friction, stops.

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
        damping: (nv,) of the joints, N m s/rad or N s/m.
        effort: (nv,) constant forces of the joints, N m or N.
        joints: joints with a spring, friction or stops.
        springs: between points.
        shortest: m, length at and below which a spring has no direction and no force.
    """

    def __init__(self, tree: TreeModel, springs: tuple[PointSpring, ...], length: float) -> None:
        self.damping = tree.damping
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
