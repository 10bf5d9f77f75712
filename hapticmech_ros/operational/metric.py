# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Metric of the task space: the inertia that makes directions of different units comparable.

The spatial inertia I_ℓ of the grasped link alone, at the operational point and in world axes, makes
μ = eig(I_ℓ^½ X I_ℓ^½) a number between 0 (rigid) and 1 (as free as the link alone) that depends
neither on units nor on axes. A link that moves in a plane is held in it: the rows and columns of
I_ℓ in the plane remain. A link that is held by a ball joint turns about it: ((I_ℓ⁻¹)_tt)⁻¹ remains,
with t the rows of positions.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.model import se3
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import OperationalPoint
from hapticmech_ros.scene.rules import inertia_matrix


class TaskMetric:
    """I_ℓ of one operational point; constant in the axes of the link, so factored once.

    Attributes:
        rows: (t,) rows of a six-vector that the task space has.
        mass: reference mass m_ℓ in kg: of the link, or of the point's ``metric``.
        factor, dual_factor: (t, t) G and G⁻ᵀ in the axes of the link; √kg and √kg m, and their
            inverses.
        point_to_link: (3, 3) maps components in the link's axes to those in the point's.
    """

    def __init__(self, scene: Scene, point: OperationalPoint) -> None:
        inertia = _inertia_at_point(scene, point)
        self.mass = float(inertia[0, 0])
        self.rows = np.array(scene.task_rows)
        moving = scene.moving_rows
        inertia = inertia[np.ix_(moving, moving)]
        if self.rows.size < len(moving):
            held = np.isin(moving, self.rows)
            inertia = np.linalg.inv(np.linalg.inv(inertia)[np.ix_(held, held)])
        self.factor = np.linalg.cholesky(inertia)
        self.dual_factor = np.linalg.inv(self.factor).T
        self.point_to_link = se3(point.origin).rotation.T


def _inertia_at_point(scene: Scene, point: OperationalPoint) -> Array:
    """Return I_ℓ (6, 6) at the point, in the axes of its link."""
    if point.metric is not None:
        mass, length = point.metric.mass, point.metric.length
        return np.diag([mass] * 3 + [mass * length**2] * 3)
    inertial = next(link.inertial for link in scene.links if link.name == point.link)
    body = pin.Inertia(inertial.mass, np.array(inertial.com), inertia_matrix(inertial.inertia))
    at_point = pin.SE3(np.eye(3), np.array(point.origin.xyz))
    return np.asarray(body.se3ActionInverse(at_point).matrix())
