# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Forces of springs, dampers, friction and stops in NumPy, and their slopes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.closures import WORLD_AXES
from hapticmech_ros.mechanism.elements import Elements, JointElement, PointSpring
from hapticmech_ros.mechanism.model import TreeModel
from hapticmech_ros.scene.mechanism import JointLimits


class Contact(NamedTuple):
    """A stop at a state: +1 (lower) or -1 (upper), how far it is entered (rad, m), and ḋ."""

    outwards: float
    depth: float
    speed: float


@dataclass(frozen=True)
class ReadableJoint(JointElement):
    """What acts in one joint, evaluated."""

    def forces(self, q: float, v: float) -> tuple[float, float]:
        """Return elastic and dissipative force, N m or N, at coordinate q and rate v."""
        joint = self.joint
        elastic = joint.stiffness * (joint.rest - q)
        lossy = -joint.friction * math.tanh(v / joint.friction_speed)
        for limits, contact in self._contacts(q, v):
            if contact.depth > 0.0:
                spring = limits.stiffness * contact.depth
                soft = min(contact.depth / limits.depth, 1.0)
                push = max(spring + limits.damping * soft * contact.speed, 0.0)
                elastic += contact.outwards * spring
                lossy += contact.outwards * (push - spring)
        return elastic, lossy

    def slopes(self, q: float, v: float, horizon: float) -> tuple[float, float]:
        """Return stiffness and damping; a stop counts if it is met within ``horizon`` (s)."""
        joint = self.joint
        # The secant: friction already there, over the speed. Its largest slope would hold a joint
        # that slides as if it stuck.
        relative = abs(v) / joint.friction_speed
        share = math.tanh(relative) / relative if relative > 1e-6 else 1.0
        stiffness, damping = joint.stiffness, share * joint.friction / joint.friction_speed
        for limits, contact in self._contacts(q, v):
            deepest = contact.depth + horizon * max(contact.speed, 0.0)
            if deepest > 0.0:
                stiffness += limits.stiffness
                damping += limits.damping * min(deepest / limits.depth, 1.0)
        return stiffness, damping

    def tangents(self, q: float, v: float) -> tuple[float, float]:
        """Return -∂/∂q of the elastic and -∂/∂v of the whole force; of stops where they push."""
        joint = self.joint
        steep = 1.0 - math.tanh(v / joint.friction_speed) ** 2
        stiffness, damping = joint.stiffness, steep * joint.friction / joint.friction_speed
        for limits, contact in self._contacts(q, v):
            soft = limits.damping * min(contact.depth / limits.depth, 1.0)
            external = limits.stiffness * contact.depth + soft * contact.speed > 0.0
            if contact.depth > 0.0 and external:
                stiffness += limits.stiffness
                damping += soft
        return stiffness, damping

    def _contacts(self, q: float, v: float) -> Iterator[tuple[JointLimits, Contact]]:
        limits = self.joint.limits
        if limits is not None:
            yield limits, Contact(1.0, limits.lower - q, -v)
            yield limits, Contact(-1.0, q - limits.upper, v)


class ReadableElements(Elements):
    """All elements of a mechanism, evaluated."""

    def __init__(self, tree: TreeModel, springs: tuple[PointSpring, ...], length: float) -> None:
        super().__init__(tree, springs, length)
        self.joints = tuple(ReadableJoint(e.rate, e.position, e.joint) for e in self.joints)

    def forces(self, model: pin.Model, data: pin.Data, q: Array, v: Array) -> tuple[Array, Array]:
        """Return all forces but efforts, and their dissipative part; each (nv,), N m or N.

        ``data`` has joint Jacobians and frames' placements at q.
        """
        dissipative = -self.damping * v
        passive = dissipative.copy()
        for element in self.joints:
            at = element.rate
            elastic, lossy = element.forces(float(q[element.position]), float(v[at]))
            dissipative[at] += lossy
            passive[at] += elastic + lossy
        for spring in self.springs:
            length, gradient = self.stretch(model, data, spring)
            loss = spring.damping * float(gradient @ v)
            dissipative -= loss * gradient
            passive -= (spring.stiffness * (length - spring.rest_length) + loss) * gradient
        return passive, dissipative

    def slopes(
        self, model: pin.Model, data: pin.Data, q: Array, v: Array, horizon: float
    ) -> tuple[Array, Array]:
        """Return stiffness and damping, each (nv, nv); see ``ReadableMechanism.slopes``."""
        joints = (
            element.slopes(float(q[element.position]), float(v[element.rate]), horizon)
            for element in self.joints
        )
        return self._summed(model, data, joints)

    def tangents(self, model: pin.Model, data: pin.Data, q: Array, v: Array) -> tuple[Array, Array]:
        """Return K and C (nv, nv): what all forces lose per change of position, and of rate.

        As :meth:`slopes`, but of what pushes now, and with friction's own slope instead of its
        secant. Lines of springs are taken as fixed. ``data`` as in :meth:`forces`.
        """
        joints = (
            element.tangents(float(q[element.position]), float(v[element.rate]))
            for element in self.joints
        )
        return self._summed(model, data, joints)

    def _summed(
        self, model: pin.Model, data: pin.Data, joints: Iterable[tuple[float, float]]
    ) -> tuple[Array, Array]:
        """Return stiffness and damping of joints, given in order, dampers and springs."""
        stiffness, damping = np.zeros((model.nv, model.nv)), np.diag(self.damping)
        for element, slopes in zip(self.joints, joints, strict=True):
            stiffness[element.rate, element.rate] += slopes[0]
            damping[element.rate, element.rate] += slopes[1]
        for spring in self.springs:
            _, gradient = self.stretch(model, data, spring)
            square = np.outer(gradient, gradient)
            stiffness += spring.stiffness * square
            damping += spring.damping * square
        return stiffness, damping

    def stretch(self, model: pin.Model, data: pin.Data, spring: PointSpring) -> tuple[float, Array]:
        """Return l (m) and g = ∂l/∂q (nv,); g = 0 where the line has no direction."""
        gap = spring.gap(data)
        length = float(np.linalg.norm(gap))
        if length <= self.shortest:
            return length, np.zeros(model.nv)
        shape = (6, model.nv)
        jacobian_a = pin.getFrameJacobian(model, data, spring.frame_a, WORLD_AXES).reshape(shape)
        jacobian_b = pin.getFrameJacobian(model, data, spring.frame_b, WORLD_AXES).reshape(shape)
        return length, (gap / length) @ (jacobian_a[:3] - jacobian_b[:3])
