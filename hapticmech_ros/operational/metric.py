"""Metric of the task space: the inertia that says what one unit of each direction is.

The spatial inertia I_ℓ of the grasped link alone, at the operational point and in world axes, makes
μ = eig(I_ℓ^½ X I_ℓ^½) a number between 0 (rigid) and 1 (as free as the link alone) that depends
neither on units nor on axes.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.mechanism.constraint_space import cholesky_of_upper
from hapticmech_ros.mechanism.model import Array, se3
from hapticmech_ros.operational.inverse_inertia import planar_block
from hapticmech_ros.scene.document import OperationalPoint, Scene
from hapticmech_ros.scene.rules import inertia_matrix


class TaskMetric:
    """I_ℓ of one operational point; constant in the point's own axes.

    Attributes:
        mass: reference mass m_ℓ in kg: of the link, or of the point's ``metric``.
    """

    def __init__(self, scene: Scene, point: OperationalPoint) -> None:
        self._body_inertia = _inertia_at_point(scene, point)
        self.mass = float(self._body_inertia[0, 0])

    def inertia(self, rotation: Array) -> Array:
        """Return I_ℓ (6, 6) in world axes for the point's orientation (3, 3); kg, kg m, kg m²."""
        turn = np.zeros((6, 6))
        turn[:3, :3] = turn[3:, 3:] = rotation
        return np.asarray(turn @ self._body_inertia @ turn.T)

    def factor(self, rotation: Array, rows: Array) -> Array:
        """Return lower G (t, t) with I_ℓ = G Gᵀ on the task's rows, world axes."""
        inertia = self.inertia(rotation)
        return cholesky_of_upper(inertia if rows.size == 6 else planar_block(inertia))


def _inertia_at_point(scene: Scene, point: OperationalPoint) -> Array:
    if point.metric is not None:
        mass, length = point.metric.mass, point.metric.length
        return np.diag([mass] * 3 + [mass * length**2] * 3)
    inertial = next(link.inertial for link in scene.links if link.name == point.link)
    body = pin.Inertia(inertial.mass, np.array(inertial.com), inertia_matrix(inertial.inertia))
    return np.asarray(body.se3ActionInverse(se3(point.origin)).matrix())
