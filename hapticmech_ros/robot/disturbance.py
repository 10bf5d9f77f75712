# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What moves a robot's joints that its model does not know: friction, a payload, wrong masses.

With the momentum p = D v, ṗ = τ + Cᵀ v - g + Jᵀ F_c + d, and d is what is left over. Its estimate
follows it at a rate κ, and needs no accelerations:

    r = κ (p - ∫ (τ + Cᵀ v - g + Jᵀ F_c + r) dt),      ṙ = κ (d - r)                         (R6)

(A. De Luca, R. Mattone: Actuator failure detection and isolation using generalized momenta, IEEE
ICRA 2003). h - r in place of h in R3 then balances friction and payload as well. Contacts that are
measured are no disturbance; those that are not are balanced like one, so that a robot without a
wrench sensor pushes harder and harder against what it touches: it needs a rate of 0.
"""

from __future__ import annotations

from copy import copy
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.robot.law import RobotState


class Observed(NamedTuple):
    """State of the observer.

    Attributes:
        disturbance: (nv,) r, N m or N.
        momentum: (nv,) the integral in R6, N m s or N s.
    """

    disturbance: Array
    momentum: Array


class DisturbanceObserver:
    """Estimates the disturbance of joints, a period at a time.

    Args:
        mechanism: of the robot.
        rate: κ, 1/s; 0: an estimate stays what it is.
        period: s.

    Raises:
        InvalidInputError: a rate that is negative, or that the period does not allow.
    """

    def __init__(self, mechanism: Mechanism, rate: float, period: float) -> None:
        self._rate, self._period = checked_rate(rate, period), period
        self._tree = mechanism.tree
        self._model, self._data = mechanism.model, mechanism.model.createData()

    def with_rate(self, rate: float) -> DisturbanceObserver:
        """Return the same observer with another rate, which begins anew.

        Args:
            rate: κ, 1/s.

        Raises:
            InvalidInputError: a rate that is negative, or that the period does not allow.
        """
        other = copy(self)
        other._rate = checked_rate(rate, self._period)
        return other

    def begin(self, state: RobotState, disturbance: Array | None = None) -> Observed:
        """Return an estimate to begin with.

        Args:
            state: of the robot.
            disturbance: (nv,) r, N m or N; None: nothing.
        """
        held = np.zeros_like(state.v) if disturbance is None else disturbance
        if self._rate == 0.0:
            return Observed(held, _momentum(state))
        return Observed(held, _momentum(state) - held / self._rate)

    def next(
        self, known: Observed, before: RobotState, torque: Array, contact: Array, now: RobotState
    ) -> Observed:
        """Return the estimate at the end of a period.

        Args:
            known: the estimate at its start.
            before: state of the robot then.
            torque: (nv,) that the joints had over the period, N m or N.
            contact: (6,) F_c then, by the environment on the robot, N and N m, world axes.
            now: state of the robot at the end.
        """
        if self._rate == 0.0:
            return known
        model, data = self._model, self._data
        coriolis = pin.computeCoriolisMatrix(model, data, before.q, before.v)
        weight = pin.computeGeneralizedGravity(model, data, before.q)
        if self._tree.carried.any():
            pin.computeJointJacobians(model, data, before.q)
            weight = weight - self._tree.carried_force(data)
        pushed = before.point.jacobian.T @ contact
        rate = torque + coriolis.T @ before.v - weight + pushed + known.disturbance
        momentum = known.momentum + self._period * rate
        return Observed(self._rate * (_momentum(now) - momentum), momentum)


def checked_rate(rate: float, period: float) -> float:
    """Return an observer's rate, 1/s.

    Args:
        rate: κ, 1/s.
        period: s.

    Raises:
        InvalidInputError: a rate that is negative, or that the period does not allow.
    """
    if not 0.0 <= rate * period < 1.0:
        rule = f"must be 0 or more and below {1.0 / period:g} 1/s"
        raise InvalidInputError("observer_rate", rate, rule)
    return rate


def balanced(state: RobotState, observed: Observed) -> RobotState:
    """Return the state with h - r in place of h, so that the law balances what was observed.

    Args:
        state: of the robot.
        observed: of its joints.
    """
    return state._replace(bias_force=state.bias_force - observed.disturbance)


def _momentum(state: RobotState) -> Array:
    """Return p (nv,)."""
    return np.asarray(state.factor @ (state.factor.T @ state.v))
