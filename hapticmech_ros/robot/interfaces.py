# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What controllers of robots accept: torques, or positions and velocities of a virtual robot.

Most robots take no torques. The same law then drives a virtual robot with the real one's inertia,
on which the measured contact wrench acts as on the real one, and the real robot's own controller
follows it:

    D v̇_c = τ - h + Jᵀ F_c,      v_c ← v_c + T v̇_c,      q_c ← q_c + T v_c                   (R5)

with all terms at (q_c, v_c). What is felt at the operational point is the law's dynamics whatever
the joints' controllers are, if they follow. The virtual robot is on a leash: no joint of it is
farther from the real one than that.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.lapack import dtrsv
from hapticmech_ros.robot.law import Command, OperationalLaw
from hapticmech_ros.robot.mujoco_robot import MujocoRobot
from hapticmech_ros.robot.target import Target

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
    """What a controller of joints is given.

    Attributes:
        position: (nv,) q_c, rad or m.
        velocity: (nv,) v_c, with a correction towards q_c, rad/s or m/s.
        acceleration: (nv,) v̇_c, rad/s² or m/s².
        leashed: whether the virtual robot was held back.
        command: of the law, at the virtual robot.
    """

    position: Array
    velocity: Array
    acceleration: Array
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
        given = {"period": period, "leash": leash, "correction": correction}
        for name, value in given.items():
            if not (np.isfinite(value) and value > 0.0):
                raise InvalidInputError(name, value, "must be a positive number")
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
        """Return setpoints for the coming period, and the state at its end.

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
        setpoint = Setpoint(q, velocity, acceleration, leashed, command)
        return setpoint, VirtualState(q, v, integral)


# Rate of a joint's error, 1/s, critically damped: that of an industrial robot's servo.
RATE = 100.0


def servo_torque(robot: MujocoRobot, position: Array | None, velocity: Array | None) -> Array:
    """Return torques (nv,) that make joints go where they are told, by the robot's own terms.

    v̇ = ω² (q_c - q) + 2 ω (v_c - v) with position and velocity; with one of them, its part alone
    and rest for the other.

    Args:
        robot: in MuJoCo.
        position: (nv,) q_c, rad or m; None: no position is told.
        velocity: (nv,) v_c, rad/s or m/s; None: rest.
    """
    inertia, bias, _ = robot.terms()
    wanted = np.zeros(robot.nv) if velocity is None else velocity
    asked = 2.0 * RATE * (wanted - robot.v)
    if position is not None:
        asked = asked + RATE**2 * (position - robot.q)
    return np.asarray(inertia @ asked + bias)
