# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Operational-space control of a serial robot by Λ_h⁻¹: joint torques that make a point obey.

A robot with D v̇ + h = τ + Jᵀ F_c and the torques

    ẍ_c = ẍ_d + 2 ζ ω (ẋ_d - ẋ) + ω² e,      e = log(x⁻¹ x_d)
    F   = Λ⁺ (ẍ_c - J̇ v)                                                                     (R3)
    τ   = Jᵀ F + h + L Σ y_i u_i + Nᵀ τ_0

accelerates its operational point by ẍ_c + X F_c in poses that are not singular, and elsewhere along
all directions that are not rigid, with Λ⁺ and Nᵀ of :mod:`.shaped_inertia`. Along directions that
are joints are led by a limited rate, with y_i of :mod:`.shaped_inertia`. On the way there, with
weights w_i between 0 and 1, an error asks for no more than that rate either: of ω n_iᵀ e / (2 ζ)
what is beyond s_i joint_rate / |L⁻ᵀ u_i| is left out, by the share √w_i.
Where all directions are free this is O. Khatib's operational-space formulation (A unified approach
for motion and force control of robot manipulators, IEEE J. Robotics and Automation 3(1), 1987);
derived in docs/robots.md.

Along a controlled force n the motion's command is replaced by its own decay, and the force is
commanded ahead, with an integral of its error:

    nᵀ ẍ_c = -κ nᵀ ẋ,      F += n (f_d + ∫ ρ (f_d + nᵀ F_c) dt) - c F_t                       (R4)

with F_t the contact wrench without its part along n. Against a wall, nᵀ ẍ = 0, all other terms of
R3 give no acceleration along n, so the wall's force is -n (f_d + ∫): it depends neither on the
motion along the wall, nor, with c = 1, on the wall's friction, which X couples to n. F_t is
balanced up to f_d, its torques over the metric's lever included: a tool that is caught on something
would be pushed harder and harder otherwise.

τ_0 = D (a_p - r v) returns joints to a posture, with a_p = ω_p² (q_p ⊖ q) limited per joint. Forces
of springs, dampers and stops that the scene has in joints are not compensated.
"""

from __future__ import annotations

from copy import copy
from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.clutch import pose_error
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism import Mechanism, PointKinematics
from hapticmech_ros.mechanism.lapack import dtrsv
from hapticmech_ros.mechanism.model import authored_state
from hapticmech_ros.operational import Analyser, OperationalAnalysis
from hapticmech_ros.robot.gains import Gains
from hapticmech_ros.robot.shaped_inertia import RigidDirections, ShapedInertia, shaped_inertia
from hapticmech_ros.robot.target import ForceTask, Target
from hapticmech_ros.robot.torque_limits import Limited, checked_limits, limited_torque

# Joints that a motor turns or pushes.
_DRIVEN = ("revolute", "prismatic")
NO_LIMITS = np.empty(0)
_NO_CONTACT = np.zeros(6)


class RobotState(NamedTuple):
    """A robot's terms of Eq. 1 at a state, and the analysis of its operational point.

    Attributes:
        q: (nv,) joint positions, rad or m.
        v: (nv,) joint rates, rad/s or m/s.
        bias_force: (nv,) h, N m or N.
        factor: (nv, nv) lower Cholesky factor L of D.
        point: kinematics of the operational point, world axes.
        analysis: of the operational point.
        shaped: Λ⁺ and the directions of Nᵀ.
    """

    q: Array
    v: Array
    bias_force: Array
    factor: Array
    point: PointKinematics
    analysis: OperationalAnalysis
    shaped: ShapedInertia


class Command(NamedTuple):
    """What the law asks for at a state.

    Attributes:
        torque: (nv,) τ within limits, N m or N.
        acceleration: (nv,) v̇ that it gives the robot without contact, rad/s² or m/s².
        wrench: (6,) F, N and N m, world axes at the point, before limits.
        asked: (6,) ẍ_c, m/s² and rad/s².
        error: (6,) e, m and rad.
        limited: what the limits left of the torques.
    """

    torque: Array
    acceleration: Array
    wrench: Array
    asked: Array
    error: Array
    limited: Limited


class OperationalLaw:
    """The law for one robot and one operational point; a function of state and target.

    Args:
        mechanism: of the robot, a tree of revolute and prismatic joints without closures.
        point: name of the operational point; the first one if empty.
        gains: of the law.
        posture: (nv,) q_p, rad or m; the scene's initial state if empty.
        torque_limits: (nv,) N m or N; empty: none.

    Attributes:
        mechanism: as above.
        gains: as above.
        posture: (nv,) q_p.
        torque_limits: (nv,) N m or N, infinite for none.

    Raises:
        InvalidInputError: a robot with closures or other joints, an unknown point, a posture or
            limits of another size.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        point: str = "",
        gains: Gains | None = None,
        posture: Array = NO_LIMITS,
        torque_limits: Array = NO_LIMITS,
    ) -> None:
        others = sorted(set(mechanism.tree.joint_types) - set(_DRIVEN))
        if others:
            raise InvalidInputError("robot", others, f"must have joints of {list(_DRIVEN)} only")
        if mechanism.closures:
            names = [closure.name for closure in mechanism.closures]
            raise InvalidInputError("robot", names, "must have no closures: a serial robot")
        self.mechanism = mechanism
        self.gains = Gains() if gains is None else gains
        self._analyser = Analyser(mechanism, point)
        self._active = mechanism.initially_active
        self.torque_limits = checked_limits(torque_limits, mechanism.nv)
        if np.size(posture) == 0:
            posture, _ = authored_state(mechanism.scene, mechanism.tree)
        self.posture, _ = mechanism.check_state(posture, np.zeros(mechanism.nv))

    @property
    def point(self) -> str:
        """Name of the operational point."""
        return self._analyser.point.name

    @property
    def lever(self) -> float:
        """Lever, m, with which the metric weighs angles against ways; 0 without angles."""
        metric = self._analyser.metric
        angular = metric.rows >= 3
        if not angular.any():
            return 0.0
        inertia = np.diag(metric.factor @ metric.factor.T)[angular].mean()
        return float(np.sqrt(inertia / metric.mass))

    def state(self, q: Array, v: Array) -> RobotState:
        """Return the robot's terms at a state.

        Args:
            q: (nv,) joint positions, rad or m.
            v: (nv,) joint rates, rad/s or m/s.

        Raises:
            InvalidInputError: wrong size, NaN or infinity.
            HapticMechError: D is not positive definite, or an SVD did not converge.
        """
        q, v = self.mechanism.check_state(q, v)
        terms = self.mechanism.evaluate(q, v, self._active)
        analysis = self._analyser.analyse(terms)
        point, factor = terms.points[self._analyser.index], terms.space.factor
        shaped = shaped_inertia(analysis, point.jacobian, factor)
        return RobotState(q, v, terms.bias_force, factor, point, analysis, shaped)

    def command(
        self,
        state: RobotState,
        target: Target,
        contact: Array = _NO_CONTACT,
        integral: float = 0.0,
    ) -> Command:
        """Return torques (R3, R4) at a state.

        Args:
            state: of the robot.
            target: of the operational point.
            contact: (6,) F_c, by the environment on the robot, N and N m, world axes at the point.
            integral: of the force's error, N; see :meth:`next_integral`.
        """
        error = pose_error(state.point.pose, target.pose)
        asked = self.asked(state, target) - self._too_fast(state, target, error)
        wrench = state.shaped.inverse @ (asked - state.point.drift)
        if target.force is not None:
            wrench += self.pushing(target.force, contact, integral)
        task = state.point.jacobian.T @ wrench
        null = self.null_torque(state, target, error)
        limited = limited_torque(state.bias_force, task, null, self.torque_limits)
        moving = dtrsv(state.factor, limited.torque - state.bias_force, lower=1)
        acceleration = dtrsv(state.factor, moving, lower=1, trans=1)
        return Command(limited.torque, acceleration, wrench, asked, error, limited)

    def pushing(self, force: ForceTask, contact: Array, integral: float) -> Array:
        """Return what a controlled force adds to F (R4), (6,), N and N m, world axes at the point.

        Args:
            force: that is controlled.
            contact: (6,) F_c, by the environment on the robot, N and N m, world axes at the point.
            integral: of the force's error, N; see :meth:`next_integral`.
        """
        beside, lever = force.without(contact), self.lever
        # A point without angles has no lever: its torques are nobody's.
        beside[3:] *= lever > 0.0
        size = float(np.linalg.norm(np.r_[beside[:3], beside[3:] / (lever or 1.0)]))
        most = abs(force.force)
        share = self.gains.contact_share * (most / size if size > most else 1.0)
        added = -share * beside
        added[:3] += (force.force + integral) * force.direction
        return added

    def null_torque(self, state: RobotState, target: Target, error: Array) -> Array:
        """Return L Σ y_i u_i + Nᵀ τ_0 (nv,) of R3, N m or N.

        Args:
            state: of the robot.
            target: of the operational point.
            error: (6,) e, m and rad.
        """
        gains = self.gains
        rates = np.repeat((gains.linear_rate, gains.angular_rate), 3)
        twist = target.twist + 0.5 * rates * error
        ahead = target.acceleration - state.point.drift
        if target.force is not None:
            error, twist, ahead = (target.force.without(one) for one in (error, twist, ahead))
        directions = RigidDirections(
            state.analysis,
            state.shaped,
            gains,
            self.mechanism.scene.perception.s_on,
            error,
            lambda rates: self._bend(state.q, rates),
        )
        led = directions.acceleration(state.factor.T @ state.v, twist, ahead)
        posture = dtrsv(state.factor, self.posture_torque(state), lower=1)
        left = state.shaped.null(posture, directions.passed)
        return np.asarray(state.factor @ (led + left))

    def _too_fast(self, state: RobotState, target: Target, error: Array) -> Array:
        """Return what of ẍ_c (6,) is due to errors that ask for more than joints may do (R3)."""
        if target.force is not None:
            error = target.force.without(error)
        gains, rows, found = self.gains, state.analysis.rows, state.analysis.spectrum
        rates = np.repeat((gains.linear_rate, gains.angular_rate), 3)
        damped = 2.0 * gains.damping_ratio * rates
        # Without a damper there is no rate that an error asks for.
        pull = rates**2 * error / np.where(damped > 0.0, damped, np.inf)
        along = found.wrenches.T @ pull[rows]
        most = found.s * state.shaped.rates(gains.joint_rate)
        over = np.zeros(6)
        rigid = np.sqrt(1.0 - state.shaped.free)
        over[rows] = found.duals @ (rigid * (along - np.clip(along, -most, most)))
        left = damped * over
        return np.asarray(left) if target.force is None else target.force.without(left)

    def _bend(self, q: Array, rates: Array) -> Array:
        """Return J̇ v (6,) at joint rates (nv,), m/s² and rad/s², world axes at the point."""
        terms = self.mechanism.evaluate(q, rates, self._active)
        return terms.points[self._analyser.index].drift

    def with_gains(self, gains: Gains) -> OperationalLaw:
        """Return the same law with other gains.

        Args:
            gains: of it.
        """
        other = copy(self)
        other.gains = gains
        return other

    def next_integral(
        self, integral: float, force: ForceTask | None, contact: Array, period: float
    ) -> float:
        """Return the integral of a force's error a period later, N; 0 without a force.

        It stays within the commanded force, so that a wall that is not there winds up no more.

        Args:
            integral: so far, N.
            force: that is controlled.
            contact: (6,) F_c, by the environment on the robot, N and N m.
            period: s.
        """
        if force is None:
            return 0.0
        missing = force.force + float(force.direction @ contact[:3])
        most = abs(force.force)
        return float(np.clip(integral + self.gains.force_rate * period * missing, -most, most))

    def resting(self, q: Array) -> Array:
        """Return torques (nv,) that carry the weight at q and do nothing else, within limits.

        Args:
            q: (nv,) joint positions, rad or m.

        Raises:
            InvalidInputError: wrong size, NaN or infinity.
        """
        q, v = self.mechanism.check_state(q, np.zeros(self.mechanism.nv))
        weight = self.mechanism.evaluate(q, v, self._active).bias_force
        return np.asarray(np.clip(weight, -self.torque_limits, self.torque_limits))

    def braking(self, state: RobotState) -> Array:
        """Return torques (nv,), N m or N, that carry the weight and bring all joints to rest.

        Args:
            state: of the robot.
        """
        brake = -self.gains.rest_rate * (state.factor @ (state.factor.T @ state.v))
        none = np.zeros_like(brake)
        return limited_torque(state.bias_force, brake, none, self.torque_limits).torque

    def asked(self, state: RobotState, target: Target) -> Array:
        """Return ẍ_c (6,), m/s² and rad/s², world axes at the point.

        Args:
            state: of the robot.
            target: of the operational point.
        """
        gains = self.gains
        rates = np.repeat((gains.linear_rate, gains.angular_rate), 3)
        asked = (
            target.acceleration
            + 2.0 * gains.damping_ratio * rates * (target.twist - state.point.twist)
            + rates**2 * pose_error(state.point.pose, target.pose)
        )
        if target.force is not None:
            along = target.force.direction
            speed = float(along @ state.point.twist[:3])
            asked[:3] -= (float(along @ asked[:3]) + gains.contact_rate * speed) * along
        return np.asarray(asked)

    def posture_torque(self, state: RobotState) -> Array:
        """Return τ_0 (nv,), N m or N, before Nᵀ.

        Args:
            state: of the robot.
        """
        gains = self.gains
        pull = gains.posture_rate**2 * self.mechanism.difference(state.q, self.posture)
        pull = np.clip(pull, -gains.posture_acceleration, gains.posture_acceleration)
        motion = state.factor.T @ (pull - gains.rest_rate * state.v)
        return np.asarray(state.factor @ motion)
