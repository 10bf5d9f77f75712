# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What goes into the controllers of Fig. 3 and what comes out, in one control period."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.operational.delay_compensation import CompensatedResponse


@dataclass(frozen=True, slots=True)
class DeviceMeasurement:
    """What the device reports, world axes: pose, twist (6,), hand wrench F_h (6,) on the device."""

    pose: pin.SE3
    twist: Array
    hand_wrench: Array


@dataclass(frozen=True, slots=True)
class PointMeasurement:
    """What the mechanism reports of its operational point, world axes.

    ``contact_wrench`` (6,) F_c is by the environment on the mechanism, at the point.
    """

    pose: pin.SE3
    twist: Array
    contact_wrench: Array


@dataclass(frozen=True, slots=True)
class OperationalModel:
    """What the analysis reports: X, P_c, Π (6, 6 each) and a_0 (6,), world axes at the point."""

    inverse_inertia: Array
    constraint_projector: Array
    wrench_projector: Array
    free_acceleration: Array


@dataclass(frozen=True, slots=True)
class ControlOutput:
    """Wrenches of one control period, world axes, N and N m.

    Attributes:
        device: (6,) servo_cf of the device: on the hand, by the device.
        mechanism: (6,) servo_cf of the operational point: on the mechanism, by the hand.
        impedance, joint_constraint, four_channel: (6,) the three parts of ``device``.
        error: (6,) pose error e, m and rad.
    """

    device: Array
    mechanism: Array
    impedance: Array
    joint_constraint: Array
    four_channel: Array
    error: Array

    def rows(self) -> Array:
        """Return all of it (6, 6), one row each, in this order; N and N m, then m and rad."""
        return np.array(
            (
                self.device,
                self.mechanism,
                self.impedance,
                self.joint_constraint,
                self.four_channel,
                self.error,
            )
        )


def operational_model_of(
    analysis: OperationalAnalysis, compensated: CompensatedResponse | None = None
) -> OperationalModel:
    """Return the part of an analysis that the controllers use, with X and a_0 of a late loop."""
    if compensated is None:
        compensated = CompensatedResponse(analysis.inverse_inertia, analysis.free_acceleration)
    return OperationalModel(
        compensated.inverse_inertia,
        analysis.constraint_projector,
        analysis.wrench_projector,
        compensated.free_acceleration,
    )
