# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Operational-space control of a serial robot by Λ_h⁻¹: joint torques that make a point obey.

A robot with D v̇ + h = τ + Jᵀ F_c and the torques

    ẍ_c = ẍ_d + 2 ζ ω (ẋ_d - ẋ) + ω² e,      e = log(x⁻¹ x_d)
    F   = Λ⁺ (ẍ_c - J̇ v)                                                                     (R3)
    τ   = Jᵀ F + h + L Σ y_i u_i + Nᵀ τ_0

accelerates its operational point by ẍ_c + X F_c in poses that are not singular, and elsewhere along
all directions that are not rigid, with Λ⁺ and Nᵀ as below (R1, R2). Along rigid directions a
limited rate leads the joints, with y_i of R7. In between, with weights w_i between 0 and 1, an
error commands no more than that rate either: of ω n_iᵀ e / (2 ζ), the share √w_i of the excess over
s_i joint_rate / |L⁻ᵀ u_i| is left out. Where all directions are free this is O. Khatib's
operational-space formulation (A unified approach for motion and force control of robot
manipulators, IEEE J. Robotics and Automation 3(1), 1987); derived in docs/robots.md.

Along a controlled force n a decay replaces the motion's command, and the force is fed forward, with
an integral of its error:

    nᵀ ẍ_c = -κ nᵀ ẋ,      F += n (f_d + ∫ ρ (f_d + nᵀ F_c) dt) - c F_t                       (R4)

with F_t the contact wrench without its part along n. Against a wall, nᵀ ẍ = 0, all other terms of
R3 give no acceleration along n, so the wall's force is -n (f_d + ∫): it depends neither on the
motion along the wall, nor, with c = 1, on the wall's friction, which X couples to n. F_t is
balanced up to f_d, its torques over the metric's lever included: otherwise the robot would push a
caught tool ever harder.

τ_0 = D (a_p - r v) returns joints to a posture, with a_p = ω_p² (q_p ⊖ q) limited per joint. Forces
of springs, dampers and stops that the scene has in joints are not compensated.

The inverse of Λ_h⁻¹ leaves out rigid directions: X = Λ_h⁻¹ = Σ μ_i d_i d_iᵀ with the pairs n_i, d_i
= I_ℓ⁻¹ n_i of the spectrum, n_iᵀ d_j = δ_ij, so its inverse is Σ n_i n_iᵀ / μ_i. With the weights
w_i = w(s_i) by which joints count as rigid,

    Λ⁺ = Σ (1 - w_i) / μ_i n_i n_iᵀ                                                          (R1)

is that inverse, to rounding, where all s_i ≥ s_off; directions with s_i ≤ s_on have no part in it.
In between w falls smoothly, so Λ⁺ is as smooth as s. Its torques are bounded in any pose: L⁻¹ Jᵀ
n_i has the length s_i, and s_i (1 - w_i) / μ_i ≤ 1 / s_on.

With the unit vectors of the mass metric u_i = L⁻¹ J_hᵀ n_i / s_i, D = L Lᵀ, torques of the null
space pass

    Nᵀ = L (1 - Σ (1 - k_i) u_i u_iᵀ) L⁻¹,      0 ≤ k_i ≤ w_i                                 (R2)

and accelerate the point by X-consistent parts only: n_iᵀ J D⁻¹ Nᵀ τ = k_i n_iᵀ J D⁻¹ τ, nothing
along directions that the law controls. Where all w_i = 0 it is 1 - Jᵀ Λ J D⁻¹. Derivation:
docs/robots.md.

Joint motion along directions in which the point is rigid: a limited rate, and coasting.

Along u_i = L⁻¹ Jᵀ n_i / s_i, a unit vector of the mass metric, joints move with the rate
u̇_i = u_iᵀ Lᵀ v, and the point with n_iᵀ ẋ = s_i u̇_i. Where s_i is small joints cannot make the
point's commanded acceleration. They get a feasible rate:

    p   = ẋ_d + ω e / 2                                     the twist commanded to the point
    u_i' = σ(s_i n_iᵀ p / (s_i² + ε_i²)),      ε_i² = |n_iᵀ e · n_iᵀ J̇(w_i) w_i|              (R7)
    y_i = w_i (ω b_i (u_i' - u̇_i) + σ_a(s_i n_iᵀ (ẍ_d - J̇ v) / (s_i² + ε_i² + λ²)))
    b_i = (s_i² + ε_i²) / (s_i² + ε_i² + λ²),       λ = s_on / 10

With the joint motion w_i = L⁻ᵀ u_i, n_iᵀ x changes by s_i u + n_iᵀ J̇(w_i) w_i u² / 2 over a
displacement u, and s_i² ± ε_i² is the second derivative of (n_iᵀ e)² / 2: u_i' is a step of
Newton's method with the sign that lets it go downhill. It is exact for a feasible motion at any
s_i, and pulls less at the end of the point's reach. Errors along other directions do not affect
u_i, and do not damp it. The smooth saturations σ keep it within a rate of the joints, and σ_a
within the acceleration to that rate in 1/ω. Next to the singular pose itself, s_i < λ, where a
reached target does not determine u̇_i, joints coast: they are neither driven nor braked.
Derivation: docs/robots.md.

Torques are kept within the motors' limits: the parts given up, in their order, are reported.

Gains of a robot that follows, with the rate of its observer, change linearly to others. A robot
that has oscillated about its target (:mod:`.follower`) gets slower ones: each time the law has 1/√2
of its rates, and the observer 1/16 of its own at the first time; from the second on its estimate
stays constant.

Rates of the law and of its observer follow from a loop's delay and from the largest unmodelled
payload.

Along a direction in which the robot has ρ times the modelled inertia, its loop with the observer of
R6 is, without its delay θ,

    L(s) = ((2 ω + κ) s² + (ω² + 2 ω κ) s + ω² κ) / (ρ s³)

At high frequencies it is (2 ω + κ) / (ρ s). The fastest rate with good margins of such a loop with
a delay θ is half of 1 / θ (S. Skogestad: Simple analytic rules for model reduction and PID
controller tuning, J. Process Control 13, 2003), which a payload, ρ > 1, only makes slower:

    2 ω + κ = 1 / (2 θ)                                                                      (R8)

Without an observer this is his rule for 1 / s² with a delay. With one the loop has three
integrators and is stable up to Routh's limit of inertia, ρ < (2 + x)(1 + 2 x) / x with x = κ / ω.
With a gain margin of 3/2 at the largest ratio R, of which the delay takes a part, and x = 1 at
most, where ω² κ is largest,

    (2 + x)(1 + 2 x) / x = 3 R / 2                                                           (R9)

For a payload m at a place with the Jacobian J_p, R = 1 + m λ_max(J_p D⁻¹ J_pᵀ).

A robot's task at its operational point is a motion, and along one direction a force.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.control.clutch import pose_error
from hapticmech_ros.errors import InvalidInputError, check_not_negative, check_positive, listed
from hapticmech_ros.mechanism import Mechanism, PointKinematics
from hapticmech_ros.mechanism.inertia import dtrsm, dtrsv
from hapticmech_ros.mechanism.model import authored_state
from hapticmech_ros.numerics import Array
from hapticmech_ros.operational import Analyser, OperationalAnalysis
from hapticmech_ros.operational.results import RANK_TOLERANCE

# Beyond this a rate, 1/s, is no gain that a loop in discrete time can have.
_LARGEST = 1e4


@dataclass(frozen=True, slots=True)
class Gains:
    """Gains of the law, checked when they are made.

    An error of position e obeys ë + 2 ζ ω ė + ω² e = 0 where the law decouples; so does the posture
    in the null space.

    Attributes:
        linear_rate: ω of the point's position, 1/s.
        angular_rate: ω of its orientation, 1/s.
        damping_ratio: ζ of both, and of the posture.
        posture_rate: ω with which joints return to their posture in the null space, 1/s.
        posture_acceleration: largest one towards the posture, of each joint, rad/s² or m/s².
        joint_rate: with which joints are led at most along a direction in which they have an error,
            or which is rigid, rad/s or m/s.
        rest_rate: rate at which motion of the null space decays, 1/s.
        force_rate: rate at which the integral of a force's error grows, 1/s.
        contact_rate: rate at which motion along a controlled force decays, 1/s.
        contact_share: c of R4, 0 to 1: share of the measured contact wrench beside a controlled
            force that is balanced; with 1 friction disturbs neither the force nor the motion.

    Raises:
        InvalidInputError: one is negative, not finite or above 1e4, or a share above 1.
    """

    linear_rate: float = 30.0
    angular_rate: float = 30.0
    damping_ratio: float = 1.0
    posture_rate: float = 5.0
    posture_acceleration: float = 5.0
    joint_rate: float = 3.0
    rest_rate: float = 30.0
    force_rate: float = 5.0
    contact_rate: float = 60.0
    contact_share: float = 1.0

    def __post_init__(self) -> None:
        for gain in fields(self):
            value = getattr(self, gain.name)
            if not (math.isfinite(value) and 0.0 <= value <= _LARGEST):
                rule = f"must be a number between 0 and {_LARGEST:g}"
                raise InvalidInputError(gain.name, value, rule)
        check_positive(joint_rate=self.joint_rate)
        if self.contact_share > 1.0:
            raise InvalidInputError("contact_share", self.contact_share, "must be at most 1")

    @property
    def rates(self) -> Array:
        """(6,) ω of the point's position along three axes and of its orientation, 1/s."""
        return np.repeat((self.linear_rate, self.angular_rate), 3)


# Tolerance of a direction's length of 1: the rounding of six digits.
_UNIT = 1e-5


@dataclass(frozen=True, slots=True)
class ForceTask:
    """A force that is controlled along one direction, in place of the motion along it.

    Attributes:
        direction: (3,) unit vector n, world axes, along which the robot is to push.
        force: f_d that the robot is to exert along n, N.

    Raises:
        InvalidInputError: a direction that is no unit vector, or a force that is not finite.
    """

    direction: Array
    force: float

    def __post_init__(self) -> None:
        length = float(np.linalg.norm(self.direction))
        if np.shape(self.direction) != (3,) or not abs(length - 1.0) <= _UNIT:
            raise InvalidInputError("direction", self.direction, "must be a unit vector (3,)")
        if not np.isfinite(self.force):
            raise InvalidInputError("force", self.force, "must be finite")

    def without(self, six: Array) -> Array:
        """Return a vector (6,), linear before angular, without its part along n.

        Args:
            six: (6,) in world axes.
        """
        left = np.array(six, dtype=float)
        left[:3] -= float(self.direction @ left[:3]) * self.direction
        return left


@dataclass(frozen=True, slots=True)
class Target:
    """Where the operational point is to be, and how it is to move.

    Attributes:
        pose: x_d, in the world of the robot's scene.
        twist: (6,) ẋ_d, m/s and rad/s, world axes, at the point.
        acceleration: (6,) ẍ_d, m/s² and rad/s², likewise.
        force: controlled instead of motion along one direction; None: none.
    """

    pose: pin.SE3
    twist: Array = field(default_factory=partial(np.zeros, 6))
    acceleration: Array = field(default_factory=partial(np.zeros, 6))
    force: ForceTask | None = None


@dataclass(frozen=True, slots=True)
class Tuning:
    """Gains and the observer's rate.

    Attributes:
        gains: of the law.
        observer_rate: κ, of the observer of disturbances, 1/s; 0: none.
    """

    gains: Gains
    observer_rate: float = 0.0

    def towards(self, other: Tuning, share: float) -> Tuning:
        """Return an interpolation between this one and another.

        Args:
            other: at share 1.
            share: 0 to 1.
        """

        def between(before: float, after: float) -> float:
            return before + share * (after - before)

        values = {
            field.name: between(getattr(self.gains, field.name), getattr(other.gains, field.name))
            for field in fields(Gains)
        }
        return Tuning(Gains(**values), between(self.observer_rate, other.observer_rate))

    def slowed(self, swings: int) -> Tuning:
        """Return the slower tuning of a robot that has oscillated.

        Args:
            swings: how often.
        """
        if swings == 0:
            return self
        slower = 0.5 ** (0.5 * swings)
        gains = replace(
            self.gains,
            linear_rate=slower * self.gains.linear_rate,
            angular_rate=slower * self.gains.angular_rate,
        )
        return Tuning(gains, self.observer_rate / 16.0 if swings == 1 else 0.0)


class TuningRamp(NamedTuple):
    """From one tuning to another.

    Attributes:
        start: s.
        duration: s.
        old, new: before and after.
    """

    start: float
    duration: float
    old: Tuning
    new: Tuning

    def at(self, time: float) -> Tuning:
        """Return the tuning of a time, s."""
        if self.duration <= 0.0 or time >= self.start + self.duration:
            return self.new
        share = max((time - self.start) / self.duration, 0.0)
        return self.old.towards(self.new, share)


# Of the loop at the largest payload.
GAIN_MARGIN = 1.5


class LoopRates(NamedTuple):
    """Rates of a loop.

    Attributes:
        law: ω, 1/s.
        observer: κ, 1/s; 0 without an observer.
    """

    law: float
    observer: float


def loop_rates(delay: float, inertia_ratio: float = 1.0, observed: bool = True) -> LoopRates:
    """Return ω and κ (R8, R9).

    Args:
        delay: θ, s, from a sample of the joints to the middle of the period in which its torques
            act: one and a half periods where they act a period later.
        inertia_ratio: R, 1 or more.
        observed: whether there is an observer; without one every payload is borne.

    Raises:
        InvalidInputError: a delay that is not positive, or a ratio below 1.
    """
    check_positive(delay=delay)
    if not (math.isfinite(inertia_ratio) and inertia_ratio >= 1.0):
        raise InvalidInputError("inertia_ratio", inertia_ratio, "must be a number of 1 or more")
    gain = 0.5 / delay
    if not observed:
        return LoopRates(0.5 * gain, 0.0)
    # 2 x + 2 / x = c has real roots from 4 on, where both are 1.
    c = max(GAIN_MARGIN * inertia_ratio - 5.0, 4.0)
    share = 0.25 * (c - math.sqrt(c**2 - 16.0))
    rate = gain / (2.0 + share)
    return LoopRates(rate, share * rate)


def longest_delay(tuning: Tuning) -> float:
    """Return the longest delay θ with which a loop of torques is used, s.

    min(1 / (2 ζ ω + κ), ζ / ω), twice the delay of R8 with ζ = 1: below the delay margin of the
    loop without payload, by a fifth with ζ = 1.

    Args:
        tuning: of the loop.
    """
    gains = tuning.gains
    rate, zeta = max(gains.linear_rate, gains.angular_rate), gains.damping_ratio
    gain = 2.0 * zeta * rate + tuning.observer_rate
    return min(1.0 / gain if gain else math.inf, zeta / rate if rate else math.inf)


def inertia_ratio(state: RobotState, payload: float, place: Array) -> float:
    """Return R, the most by which a payload multiplies the inertia of any motion at a state.

    Args:
        state: of the robot.
        payload: m, kg.
        place: (3,) where it is, m, from the operational point in its axes.

    Raises:
        InvalidInputError: a payload that is negative or not finite.
    """
    check_not_negative(payload=payload)
    jacobian, turn = state.point.jacobian, state.point.pose.rotation
    there = jacobian[:3] - pin.skew(turn @ place) @ jacobian[3:]
    moved = dtrsm(1.0, state.factor, there.T, lower=1)
    return 1.0 + payload * float(np.linalg.eigvalsh(moved.T @ moved)[-1])


class ShapedInertia(NamedTuple):
    """Λ⁺ and the directions of Nᵀ, at a state; world axes at the operational point.

    Attributes:
        inverse: (6, 6) Λ⁺, kg, kg m and kg m²; zero in rows that the task does not have.
        units: (nv, t) columns u_i, in the spectrum's order; zero where s_i is rounding alone.
        free: (t,) 1 - w_i, likewise: 1 where the law decouples.
        joints: (nv, t) columns L⁻ᵀ u_i: joint rates of u̇_i = 1.
    """

    inverse: Array
    units: Array
    free: Array
    joints: Array

    def rates(self, most: float) -> Array:
        """Return the largest u̇_i (t,), √kg m/s, with joint rates |L⁻ᵀ u_i u̇_i| up to a limit.

        Args:
            most: rad/s or m/s.
        """
        moved = np.linalg.norm(self.joints, axis=0)
        # An unknown direction moves nothing at any rate.
        return np.asarray(most / np.where(moved > 0.0, moved, 1.0))

    def null(self, motion: Array, passed: Array) -> Array:
        """Return L⁻¹ Nᵀ L m (nv,): a motion of joints in the mass metric, projected by R2.

        Args:
            motion: (nv,) m = L⁻¹ τ.
            passed: (t,) k_i.
        """
        return np.asarray(motion - self.units @ ((1.0 - passed) * (self.units.T @ motion)))


def shaped_inertia(analysis: OperationalAnalysis, jacobian: Array, factor: Array) -> ShapedInertia:
    """Return Λ⁺ (R1) and the directions of R2 of a tree without closures.

    Args:
        analysis: of the operational point at the state.
        jacobian: (6, nv) J_h there, m and 1.
        factor: (nv, nv) lower Cholesky factor L of D there.
    """
    rows, found = analysis.rows, analysis.spectrum
    # The weights' polynomial may exceed 1 by rounding just above s_on.
    free = np.maximum(1.0 - analysis.weights, 0.0)
    # s may be 0 in directions with w = 1; these have no part in the quotient.
    safe = np.where(free > 0.0, found.s, 1.0)
    inverse = np.zeros((6, 6))
    inverse[np.ix_(rows, rows)] = (found.wrenches * (free / safe**2)) @ found.wrenches.T
    # L⁻¹ Jᵀ n_i = s_i u_i: (nv, t).
    long = dtrsm(1.0, factor, jacobian[rows].T @ found.wrenches, lower=1)
    known = found.s > RANK_TOLERANCE
    units = np.where(known, long / np.where(known, found.s, 1.0), 0.0)
    joints = dtrsm(1.0, factor, units, lower=1, trans_a=1)
    return ShapedInertia(inverse, units, free, joints)


# λ / s_on.
COASTING = 0.1


class Limited(NamedTuple):
    """Torques within limits.

    Attributes:
        torque: (nv,) N m or N.
        task: share of the task's torques that is left, 0 to 1.
        null: share of the null space's, 0 to 1.
        overloaded: whether the bias alone exceeds a limit.
    """

    torque: Array
    task: float
    null: float
    overloaded: bool

    @property
    def saturated(self) -> bool:
        """Whether anything was given up."""
        return self.overloaded or self.task < 1.0 or self.null < 1.0


def checked_limits(limits: Array, nv: int) -> Array:
    """Return limits (nv,), infinite ones where none is given.

    Args:
        limits: (nv,) N m or N; empty: no limits.
        nv: number of joint rates.

    Raises:
        InvalidInputError: another number of them, or one that is not positive.
    """
    given = np.asarray(limits, dtype=float)
    if given.size == 0:
        return np.full(nv, np.inf)
    if given.shape != (nv,) or not (given > 0.0).all():
        raise InvalidInputError("torque limits", limits, f"must be {nv} positive numbers")
    return given


def limited_torque(bias: Array, task: Array, null: Array, limits: Array) -> Limited:
    """Return bias + α task + β null within limits, with the largest α, then the largest β ≤ 1.

    The task's torques keep their ratios, and so a force its direction; weight has priority.

    Args:
        bias: (nv,) compensating weight and velocity terms, N m or N.
        task: (nv,) moving the operational point.
        null: (nv,) moving joints in its null space.
        limits: (nv,) largest torques.
    """
    held = np.clip(bias, -limits, limits)
    alpha = _share(held, task, limits)
    torque = held + alpha * task
    beta = _share(torque, null, limits)
    overloaded = bool((held != bias).any())
    return Limited(torque + beta * null, alpha, beta, overloaded)


def _share(start: Array, part: Array, limits: Array) -> float:
    """Return the largest share up to 1 of a part that keeps start + share part within limits."""
    room = np.where(part >= 0.0, limits - start, limits + start)
    tight = np.abs(part) > room
    if not tight.any():
        return 1.0
    return float(np.min(np.maximum(room[tight], 0.0) / np.abs(part[tight])))


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
    """The law's command at a state.

    Attributes:
        torque: (nv,) τ within limits, N m or N.
        acceleration: (nv,) v̇ that it gives the robot without contact, rad/s² or m/s².
        wrench: (6,) F, N and N m, world axes at the point, before limits.
        asked: (6,) ẍ_c, m/s² and rad/s².
        error: (6,) e, m and rad.
        limited: shares of the torques within the limits.
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
            raise InvalidInputError("robot", others, f"must have joints of {listed(_DRIVEN)} only")
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
        """Lever, m, with which the metric weighs angles against displacements; 0 without angles."""
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
        """Return a controlled force's part of F (R4), (6,), N and N m, world axes at the point.

        Args:
            force: that is controlled.
            contact: (6,) F_c, by the environment on the robot, N and N m, world axes at the point.
            integral: of the force's error, N; see :meth:`next_integral`.
        """
        beside, lever = force.without(contact), self.lever
        # A point without angles has no lever, and no torques.
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
        twist = target.twist + 0.5 * self.gains.rates * error
        ahead = target.acceleration - state.point.drift
        if target.force is not None:
            error, twist, ahead = (target.force.without(one) for one in (error, twist, ahead))
        led, passed = self.led(state, error, twist, ahead)
        posture = dtrsv(state.factor, self.posture_torque(state), lower=1)
        return np.asarray(state.factor @ (led + state.shaped.null(posture, passed)))

    def led(
        self, state: RobotState, error: Array, twist: Array, ahead: Array
    ) -> tuple[Array, Array]:
        """Return the joints' motion along rigid directions (R7).

        Args:
            state: of the robot.
            error: (6,) e, m and rad.
            twist: (6,) p, m/s and rad/s, world axes at the point.
            ahead: (6,) ẍ_d - J̇ v, m/s² and rad/s², likewise.

        Returns:
            Σ y_i u_i (nv,), by the factor Lᵀ times joint accelerations; and the shares (t,)
            w_i ε_i² / (s_i² + ε_i² + λ²) of torques of the null space that pass along u_i.
        """
        rows, found, shaped = state.analysis.rows, state.analysis.spectrum, state.shaped
        n, s, rigid = found.wrenches.T, found.s, 1.0 - shaped.free
        rates = np.sum(found.wrenches * found.duals * self.gains.rates[rows, None], axis=0)
        rates = np.maximum(rates, 0.0)
        most, tiny = shaped.rates(self.gains.joint_rate), np.finfo(float).tiny
        bent = np.zeros_like(s)
        for at in np.flatnonzero(rigid):
            drift = self._bend(state.q, shaped.joints[:, at])[rows]
            bent[at] = abs(float(n[at] @ error[rows]) * float(n[at] @ drift))
        undamped = s**2 + bent
        damped = undamped + (COASTING * self.mechanism.scene.perception.s_on) ** 2
        wanted = s * (n @ twist[rows])
        # As σ(wanted / undamped), which may be 0 / 0 in the singular pose.
        limited = most * wanted / np.maximum(np.hypot(most * undamped, wanted), tiny)
        driven = s * (n @ ahead[rows]) / damped
        driven = driven / np.hypot(1.0, driven / np.maximum(most * rates, tiny))
        speed = shaped.units.T @ (state.factor.T @ state.v)
        towards = rates * (undamped / damped) * (limited - speed)
        return np.asarray(shaped.units @ (rigid * (towards + driven))), rigid * bent / damped

    def _too_fast(self, state: RobotState, target: Target, error: Array) -> Array:
        """Return the part of ẍ_c (6,) by errors beyond the joints' rate (R3)."""
        if target.force is not None:
            error = target.force.without(error)
        gains, rows, found = self.gains, state.analysis.rows, state.analysis.spectrum
        rates = gains.rates
        damped = 2.0 * gains.damping_ratio * rates
        # Without a damper an error commands no rate.
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

        It stays within the commanded force, which prevents windup without a wall.

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
        gains, rates = self.gains, self.gains.rates
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
