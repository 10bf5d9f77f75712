# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Commands to controllers of robots: torques, or a virtual robot's positions and velocities.

Most robots take no torques. The same law then drives a virtual robot with the real one's inertia,
on which the measured contact wrench acts as on the real one, and the real robot's own controller
follows it:

    D v̇_c = τ - h + Jᵀ F_c,      v_c ← v_c + T v̇_c,      q_c ← q_c + T v_c                   (R5)

with all terms at (q_c, v_c). The operational point then has the law's dynamics with any joint
controllers that follow. A leash limits the distance between joints of the virtual and the real
robot.

A wrench sensor at a robot's tool also measures its offset, and the tool:

    measured = F_c + offset + (m Rᵀ g, c × m Rᵀ g)

in the sensor's axes R, with the mass m beyond the sensor and its centre of mass c. The tool's
acceleration is not modelled.

Time-domain passivity of a robot's contact wrench on the mechanism that leads it:

    W = Σ T F · (v + v') / 2      energy that the contact has given to the mechanism, net of what
                                  it took; v and v' at the ends of the period in which F acts

A passive environment, felt without delay, never makes W positive: it only returns the mechanism's
energy. Delays and joints' servos do. As in the account of the mechanism's own port
(:mod:`~hapticmech_ros.control.account_kernels`), an allowance limits W: a wrench that would give
more in the coming period is changed by the least damper -λ M v that gives no more, with M of 1 kg
and a lever of 0.1 m. At rest there is no power, and nothing is changed.

A wrench acts from the mechanism's next sample on. The energy it gives is known two samples later,
with its own effect on v; until then T F · v of the last sample is used.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from hapticmech_ros.errors import (
    HapticMechError,
    InvalidInputError,
    check_not_negative,
    check_positive,
)
from hapticmech_ros.mechanism.inertia import dtrsv
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.saturation import limited
from hapticmech_ros.robot.law import (
    Command,
    OperationalLaw,
    Target,
)
from hapticmech_ros.robot.mujoco_robot import MujocoRobot

_METRIC = np.array([1.0, 1.0, 1.0, 0.01, 0.01, 0.01])


@dataclass(frozen=True, slots=True)
class FeedbackSettings:
    """Share and limits of a contact on the mechanism.

    Attributes:
        period: T, s, for which a wrench is given.
        share: of the contact, 0 to 1.
        force: the largest, N.
        torque: the largest, N m.
        passive: whether the allowance limits W.
        allowance: J that the contact may give beyond what it took.

    Raises:
        InvalidInputError: one is negative or not finite, a share above 1, or no period.
    """

    period: float
    share: float = 1.0
    force: float = 20.0
    torque: float = 2.0
    passive: bool = True
    allowance: float = 5e-4

    def __post_init__(self) -> None:
        check_positive(period=self.period)
        check_not_negative(
            share=self.share, force=self.force, torque=self.torque, allowance=self.allowance
        )
        if self.share > 1.0:
            raise InvalidInputError("share", self.share, "must be at most 1")


class FeedbackPort:
    """Turns contacts of a robot into wrenches on the mechanism that give it no energy of their own.

    Args:
        settings: of it.

    Attributes:
        settings: as above; may be replaced at any time.
        given: W, J.
        dissipated: J that the damper has taken.
        changed: periods in which a wrench was changed.
    """

    def __init__(self, settings: FeedbackSettings) -> None:
        self.settings = settings
        self.dissipated, self.changed = 0.0, 0
        self.begin()

    def begin(self) -> None:
        """Begin a new account."""
        self.given = 0.0
        self._acted, self._acting, self._twist = np.zeros(6), np.zeros(6), np.zeros(6)

    def wrench(self, contact: Array, twist: Array) -> Array:
        """Return the wrench (6,) on the mechanism from its next sample on, N and N m, world axes.

        Args:
            contact: (6,) by the environment on the robot, N and N m, world axes at its point.
            twist: (6,) of the mechanism's operational point now, m/s and rad/s, world axes.
        """
        settings = self.settings
        self.given += 0.5 * settings.period * float(self._acted @ (self._twist + twist))
        found = limited(settings.share * contact, settings.force, settings.torque)
        if settings.passive:
            found = self._held(found, twist)
        self._acted, self._acting, self._twist = self._acting, found, np.array(twist)
        return found

    def _held(self, wrench: Array, twist: Array) -> Array:
        """Return a wrench that keeps W within the allowance, if the twist stays."""
        period = self.settings.period
        power = float(wrench @ twist)
        # The acting wrench is not counted yet.
        under_way = max(float(self._acting @ twist), 0.0)
        most = (self.settings.allowance - self.given) / period - under_way
        if power <= max(most, 0.0):
            return wrench
        momentum = _METRIC * twist
        excess = power - max(most, 0.0)
        self.changed += 1
        self.dissipated += period * excess
        return np.asarray(wrench - excess / float(momentum @ twist) * momentum)


EARTH = np.array([0.0, 0.0, -9.81])
# Samples that a tare averages over, at most and at least; rates of joints at rest, rad/s or m/s.
MOST, LEAST, REST = 100, 10, 0.02


class WrenchSensor:
    """Corrects a sensor's samples, and finds its offset while nothing touches the tool.

    Args:
        mass: of the tool beyond the sensor, kg.
        centre: (3,) its centre of mass, m, from the operational point in its axes.
        offset: (6,) measured without load and tool, N and N m, in its axes.
        gravity: (3,) m/s², world axes.

    Attributes:
        offset: as above; :meth:`tare` replaces it.

    Raises:
        InvalidInputError: a mass that is negative, or numbers that are not finite or too few.
    """

    def __init__(
        self,
        mass: float = 0.0,
        centre: Array = np.zeros(3),  # noqa: B008
        offset: Array = np.zeros(6),  # noqa: B008
        gravity: Array = EARTH,
    ) -> None:
        check_not_negative(tool_mass=mass)
        for name, values, size in (("tool_centre", centre, 3), ("sensor_offset", offset, 6)):
            if np.shape(values) != (size,) or not np.isfinite(values).all():
                raise InvalidInputError(name, values, f"must be {size} finite numbers")
        self._mass, self._centre = mass, np.array(centre, dtype=float)
        self._gravity = np.array(gravity, dtype=float)
        self.offset = np.array(offset, dtype=float)
        self._recent: deque[Array] = deque(maxlen=MOST)

    def weight(self, rotation: Array) -> Array:
        """Return the tool's weight (6,), N and N m, in the sensor's axes.

        Args:
            rotation: (3, 3) R, from the sensor's axes to the world's.
        """
        force = self._mass * (rotation.T @ self._gravity)
        return np.concatenate((force, np.cross(self._centre, force)))

    def contact(self, measured: Array, rotation: Array) -> Array:
        """Return F_c (6,), N and N m, in the sensor's axes.

        Args:
            measured: (6,) by the sensor, N and N m, in its axes.
            rotation: (3, 3) R.
        """
        return np.asarray(measured - self.offset - self.weight(rotation))

    def record(self, measured: Array) -> None:
        """Take a sample for the next tare.

        Args:
            measured: (6,) by the sensor, N and N m, in its axes.
        """
        self._recent.append(np.array(measured, dtype=float))

    def tare(self, rotation: Array, rates: Array) -> None:
        """Take the mean of the last samples as those of a tool that touches nothing.

        Args:
            rotation: (3, 3) R.
            rates: (nv,) of the joints, rad/s or m/s.

        Raises:
            HapticMechError: too few samples, or a robot that moves.
        """
        if len(self._recent) < LEAST:
            raise HapticMechError(f"{len(self._recent)} samples of the sensor; {LEAST} are needed")
        fastest = float(np.abs(rates).max())
        if fastest > REST:
            raise HapticMechError(f"the robot moves: {fastest:.3g}, must be at most {REST:g} rad/s")
        self.offset = np.mean(self._recent, axis=0) - self.weight(rotation)


# 1/s: rate with which velocities pull the real robot to the virtual one.
CORRECTION = 20.0
Interface = Literal["effort", "velocity", "position"]


class VirtualState(NamedTuple):
    """State of the virtual robot.

    Attributes:
        q: (nv,) joint positions, rad or m.
        v: (nv,) joint rates, rad/s or m/s.
        integral: of a controlled force's error, N.
    """

    q: Array
    v: Array
    integral: float = 0.0


class Setpoint(NamedTuple):
    """Inputs of a controller of joints besides q_c.

    Attributes:
        velocity: (nv,) v_c, with a correction towards q_c, rad/s or m/s.
        leashed: whether the virtual robot was held back.
        command: of the law, at the virtual robot.
    """

    velocity: Array
    leashed: bool
    command: Command


class VirtualRobot:
    """Moves a virtual robot by the law, a period at a time.

    Args:
        law: of the robot.
        period: T, s.
        leash: largest distance of a joint from the real one's, rad or m.
        correction: rate, 1/s, with which velocities pull the real robot to the virtual one.

    Attributes:
        law, period, leash, correction: as above.

    Raises:
        InvalidInputError: a period, leash or correction that is not positive.
    """

    def __init__(
        self, law: OperationalLaw, period: float, leash: float = 0.1, correction: float = CORRECTION
    ) -> None:
        check_positive(period=period, leash=leash, correction=correction)
        self.law = law
        self.period, self.leash, self.correction = period, leash, correction

    def at_rest(self, q: Array) -> VirtualState:
        """Return the state in which the virtual robot is where the real one is, at rest.

        Args:
            q: (nv,) measured joint positions, rad or m.
        """
        q = np.array(q, dtype=float)
        return VirtualState(q, np.zeros_like(q))

    def next(
        self, state: VirtualState, measured: Array, target: Target, contact: Array
    ) -> tuple[Setpoint, VirtualState]:
        """Return setpoints for the coming period, and the state at its end, whose q is q_c.

        Args:
            state: of the virtual robot.
            measured: (nv,) the real robot's joint positions, rad or m.
            target: of the operational point.
            contact: (6,) F_c, by the environment on the robot, N and N m, world axes at the point.

        Raises:
            InvalidInputError: wrong size, NaN or infinity.
        """
        law, period = self.law, self.period
        measured, _ = law.mechanism.check_state(measured, state.v)
        far = np.abs(state.q - measured) > self.leash
        nearest = measured + np.clip(state.q - measured, -self.leash, self.leash)
        held, leashed = np.where(far, nearest, state.q), bool(far.any())
        there = law.state(held, state.v)
        command = law.command(there, target, contact, state.integral)
        pushed = dtrsv(there.factor, there.point.jacobian.T @ contact, lower=1)
        acceleration = command.acceleration + dtrsv(there.factor, pushed, lower=1, trans=1)
        v = state.v + period * acceleration
        q = held + period * v
        integral = law.next_integral(state.integral, target.force, contact, period)
        velocity = v + self.correction * (held - measured)
        return Setpoint(velocity, leashed, command), VirtualState(q, v, integral)


# Rate of a joint's error, 1/s, critically damped: that of an industrial robot's servo.
RATE = 100.0


def servo_torque(robot: MujocoRobot, position: Array | None, velocity: Array | None) -> Array:
    """Return torques (nv,) of a joint servo, by the robot's own terms.

    v̇ = ω² (q_c - q) + 2 ω (v_c - v) with position and velocity; with one of them, its part alone
    and rest for the other.

    Args:
        robot: in MuJoCo.
        position: (nv,) q_c, rad or m; None: no commanded position.
        velocity: (nv,) v_c, rad/s or m/s; None: rest.
    """
    inertia, bias, _ = robot.terms()
    wanted = np.zeros(robot.nv) if velocity is None else velocity
    asked = 2.0 * RATE * (wanted - robot.v)
    if position is not None:
        asked = asked + RATE**2 * (position - robot.q)
    return np.asarray(inertia @ asked + bias)
