# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Loop closures in NumPy: residual φ, Jacobian W and bias Ẇv, see ``mechanism.closures``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.closures import _POINT_ROWS, WORLD_AXES, LoopClosure


@dataclass(frozen=True)
class ReadableClosure(LoopClosure):
    """A closure that evaluates itself."""

    def residual(self, model: pin.Model, data: pin.Data) -> Array:
        """Return (m,) φ from placements already in ``data``: m, then rad to first order."""
        if self.kind == "coupling":
            joint, leader = (data.joints[k].joint_q.item() for k in self._joints(model))
            return np.array([joint - Polynomial(self.gear)(leader)])
        a, b = data.oMf[self.frame_a], data.oMf[self.frame_b]
        if self.kind == "rod":
            gap, length = a.translation - b.translation, self.rod_length
            return np.array([(gap @ gap - length * length) / (2.0 * length)])
        points: Array = (a.translation - b.translation)[: _POINT_ROWS[self.kind]]
        if self.kind == "weld":
            return np.concatenate((points, _misalignment(a.rotation, b.rotation)))
        if self.kind == "revolute":
            return np.concatenate((points, b.rotation[:, :2].T @ a.rotation[:, 2]))
        return points

    def jacobian(self, model: pin.Model, data: pin.Data) -> Array:
        """Return (m, nv) W = ∂φ/∂q, from ``computeJointJacobians`` and placements in ``data``."""
        if self.kind == "coupling":
            return self._gear_row(model, data)
        # Pinocchio gives a vector instead of a matrix where there is one degree of freedom.
        shape = (6, model.nv)
        jacobian_a = pin.getFrameJacobian(model, data, self.frame_a, WORLD_AXES).reshape(shape)
        jacobian_b = pin.getFrameJacobian(model, data, self.frame_b, WORLD_AXES).reshape(shape)
        if self.kind == "rod":
            gap = data.oMf[self.frame_a].translation - data.oMf[self.frame_b].translation
            row: Array = (gap / self.rod_length) @ (jacobian_a[:3] - jacobian_b[:3])
            return row[None]
        points: Array = (jacobian_a[:3] - jacobian_b[:3])[: _POINT_ROWS[self.kind]]
        if self.rows == len(points):
            return points
        a, b = data.oMf[self.frame_a].rotation, data.oMf[self.frame_b].rotation
        if self.kind == "revolute":
            normals = _revolute_normals(a, b)
            return np.vstack((points, normals @ (jacobian_a[3:] - jacobian_b[3:])))
        turn_a, turn_b = _weld_gains(a, b)
        return np.vstack((points, turn_a @ jacobian_a[3:] + turn_b @ jacobian_b[3:]))

    def bias(self, model: pin.Model, data: pin.Data) -> Array:
        """Return (m,) γ = Ẇv, from ``forwardKinematics(q, v, 0)`` in ``data``; m/s², 1/s²."""
        if self.kind == "coupling":
            return self._gear_bias(model, data)
        motion = pin.getFrameClassicalAcceleration
        accel_a = motion(model, data, self.frame_a, WORLD_AXES)
        accel_b = motion(model, data, self.frame_b, WORLD_AXES)
        if self.kind == "rod":
            return self._rod_bias(model, data, accel_a.linear - accel_b.linear)
        points: Array = (accel_a.linear - accel_b.linear)[: _POINT_ROWS[self.kind]]
        if self.rows == len(points):
            return points
        a, b = data.oMf[self.frame_a].rotation, data.oMf[self.frame_b].rotation
        rate_a = pin.getFrameVelocity(model, data, self.frame_a, WORLD_AXES).angular
        rate_b = pin.getFrameVelocity(model, data, self.frame_b, WORLD_AXES).angular
        # Second derivative of each unit axis at zero joint acceleration: α×a + ω×(ω×a).
        speed_a, speed_b = np.cross(rate_a, a.T), np.cross(rate_b, b.T)
        second_a = np.cross(accel_a.angular, a.T) + np.cross(rate_a, speed_a)
        second_b = np.cross(accel_b.angular, b.T) + np.cross(rate_b, speed_b)
        if self.kind == "revolute":
            turning = (
                second_b[:2] @ a[:, 2] + 2.0 * speed_b[:2] @ speed_a[2] + b[:, :2].T @ second_a[2]
            )
        else:
            turning = 0.5 * (
                np.cross(second_b, a.T) + 2.0 * np.cross(speed_b, speed_a) + np.cross(b.T, second_a)
            ).sum(axis=0)
        return np.concatenate((points, turning))

    def _joints(self, model: pin.Model) -> tuple[int, int]:
        """Return the joints that carry the two frames."""
        a, b = model.frames[self.frame_a], model.frames[self.frame_b]
        return int(a.parentJoint), int(b.parentJoint)

    def _gear_row(self, model: pin.Model, data: pin.Data) -> Array:
        row = np.zeros((1, model.nv))
        joint, leader = self._joints(model)
        row[0, model.idx_vs[joint]] = 1.0
        at = data.joints[leader].joint_q.item()
        row[0, model.idx_vs[leader]] -= Polynomial(self.gear).deriv()(at)
        return row

    def _gear_bias(self, model: pin.Model, data: pin.Data) -> Array:
        """Return (1,) Ẇv = -p'' θ̇² of the leader."""
        _, leader = self._joints(model)
        at, twist = data.joints[leader].joint_q.item(), data.joints[leader].v.vector
        # The joint's axis is of length 1.
        return np.array([-Polynomial(self.gear).deriv(2)(at) * (twist @ twist)])

    def _rod_bias(self, model: pin.Model, data: pin.Data, acceleration: Array) -> Array:
        """Return (1,) Ẇv = (|ḋ|² + d·d̈) / L with d = p_a - p_b and d̈ at v̇ = 0."""
        a, b = self.frame_a, self.frame_b
        gap = data.oMf[a].translation - data.oMf[b].translation
        rate_a = pin.getFrameVelocity(model, data, a, WORLD_AXES).linear
        rate = rate_a - pin.getFrameVelocity(model, data, b, WORLD_AXES).linear
        return np.array([(rate @ rate + gap @ acceleration) / self.rod_length])


def _misalignment(a: Array, b: Array) -> Array:
    """Return 1/2 sum_k b_k x a_k = sin(angle) axis of the rotation from b to a, world axes."""
    skew = a @ b.T
    return 0.5 * np.array(
        [skew[2, 1] - skew[1, 2], skew[0, 2] - skew[2, 0], skew[1, 0] - skew[0, 1]]
    )


def _revolute_normals(a: Array, b: Array) -> Array:
    """Return (2, 3): rows z_a x x_b and z_a x y_b, so that φ̇ = rows (ω_a - ω_b)."""
    return np.cross(a[:, 2], b[:, :2].T)


def _weld_gains(a: Array, b: Array) -> tuple[Array, Array]:
    """Return (3, 3) gains G_a, G_b with φ̇ = G_a ω_a + G_b ω_b for the weld's axes block.

    b×(ω×a) = ((a·b) 1 - a bᵀ) ω, summed over the three axes and halved; likewise for b.
    """
    relative = a @ b.T
    trace = float(np.trace(relative))
    return 0.5 * (trace * np.eye(3) - relative), -0.5 * (trace * np.eye(3) - relative.T)
