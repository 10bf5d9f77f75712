# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Joint-constraint controller: limited stiffness in the null space of Λ_h⁻¹.

    u_jc = -(k P_c e + b P_c ė), limited in force and torque as a whole

P_c is smooth (see operational/results.py), so u_jc has no step when a constraint comes or goes.
Its spring does store 1/2 k eᵀ P_c e, so switching a direction on with an error there adds energy,
which :mod:`~hapticmech_ros.control.account_kernels` accounts for.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.scene.controller import JointConstraintGains


def joint_constraint_wrench(
    gains: JointConstraintGains, projector: Array, error: Array, error_rate: Array
) -> Array:
    """Return u_jc (6,): on the hand, by the device, at the point held, world axes, N and N m.

    Args:
        gains: stiffness and damping per unit of the metric's mass, and limits.
        projector: (6, 6) P_c.
        error: (6,) e, twist that takes the operational point to the device, m and rad.
        error_rate: (6,) ė, device twist less the point's.
    """
    pull = -(projector @ (gains.stiffness * error + gains.damping * error_rate))
    return scaled_within(pull, gains.force_limit, gains.torque_limit)


def scaled_within(wrench: Array, force_limit: float, torque_limit: float) -> Array:
    """Return ``wrench`` shortened as a whole until force and torque are within their limits.

    Force and torque keep their ratio, so a wrench that a joint can carry stays one: it does no work
    on what the mechanism leaves free.
    """
    force = float(np.sqrt(wrench[:3] @ wrench[:3]))
    torque = float(np.sqrt(wrench[3:] @ wrench[3:]))
    excess = max(force / force_limit, torque / torque_limit)
    return wrench / excess if excess > 1.0 else wrench
