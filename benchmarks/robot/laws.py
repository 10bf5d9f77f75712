# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Our law and two that are in use, for the same errors, force and torque limits.

All three ask for the same posture in the null space, and get the same terms of the robot.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product, starmap
from typing import NamedTuple, Protocol

import numpy as np

from benchmarks.robot.tasks import Task
from hapticmech_ros.control.clutch import pose_error
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.numerics import Array
from hapticmech_ros.robot.law import (
    Gains,
    Limited,
    OperationalLaw,
    RobotState,
    Target,
    inertia_ratio,
    limited_torque,
    loop_rates,
)

OURS, IMPEDANCE, DAMPED = "ours", "impedance", "damped inverse"


class Law(Protocol):
    """Joint torques at a state."""

    @property
    def law(self) -> OperationalLaw:
        """What knows the robot, and the parts that all laws share."""

    def torque(self, state: RobotState, target: Target, contact: Array, integral: float) -> Limited:
        """Return torques within limits."""


class Setting(NamedTuple):
    """A law, and the numbers that were chosen for it.

    Attributes:
        name: of the law.
        values: by name.
        make: returns the law for a robot.
        observer: rate of the observer of disturbances beside it, 1/s; 0: none.
    """

    name: str
    values: dict[str, float]
    make: Callable[[Mechanism, str, Array], Law]
    observer: float = 0.0


@dataclass(frozen=True, slots=True)
class Ours:
    """The package's law."""

    law: OperationalLaw

    def torque(self, state: RobotState, target: Target, contact: Array, integral: float) -> Limited:
        """Return its torques."""
        return self.law.command(state, target, contact, integral).limited


@dataclass(frozen=True, slots=True)
class Impedance:
    """Cartesian impedance: springs and dampers at the tool, and weight compensated.

    τ = Jᵀ (K e + C ė) + h + (1 - Jᵀ J⁺ᵀ) τ_0, C = 2 ζ √(K m); along a force that and a damper.
    ``m`` (6,) are the mean masses of the tool, kg and kg m², in the robot's posture.
    """

    law: OperationalLaw
    stiffness: float
    angular_stiffness: float
    damping_ratio: float
    masses: Array

    def torque(self, state: RobotState, target: Target, contact: Array, integral: float) -> Limited:
        """Return its torques."""
        del contact
        stiffness = np.repeat((self.stiffness, self.angular_stiffness), 3)
        damping = 2.0 * self.damping_ratio * np.sqrt(stiffness * self.masses)
        error = pose_error(state.point.pose, target.pose)
        wrench = stiffness * error + damping * (target.twist - state.point.twist)
        if target.force is not None:
            n, twist = target.force.direction, state.point.twist[:3]
            brake = self.law.gains.contact_rate * self.masses[0] * float(n @ twist)
            wrench[:3] += (target.force.force + integral - brake - float(n @ wrench[:3])) * n
        jacobian = state.point.jacobian
        null = np.eye(state.q.size) - jacobian.T @ np.linalg.pinv(jacobian).T
        parts = jacobian.T @ wrench, null @ self.law.posture_torque(state)
        return limited_torque(state.bias_force, *parts, self.law.torque_limits)


@dataclass(frozen=True, slots=True)
class DampedInverse:
    """Operational-space control with the damped inverse Λ_λ = (X + λ² 1)⁻¹.

    τ = Jᵀ Λ_λ (ẍ_c - J̇ v) + h + (1 - Jᵀ Λ_λ J D⁻¹) τ_0, force as in ours.
    """

    law: OperationalLaw
    factor: float

    def torque(self, state: RobotState, target: Target, contact: Array, integral: float) -> Limited:
        """Return its torques."""
        found, jacobian = state.analysis, state.point.jacobian
        inverse = np.linalg.inv(found.inverse_inertia + self.factor**2 * np.eye(6))
        wrench = inverse @ (self.law.asked(state, target) - state.point.drift)
        if target.force is not None:
            wrench += self.law.pushing(target.force, contact, integral)
        posture = self.law.posture_torque(state)
        moving = np.linalg.solve(state.factor.T, np.linalg.solve(state.factor, posture))
        null = posture - jacobian.T @ (inverse @ (jacobian @ moving))
        task = jacobian.T @ wrench
        return limited_torque(state.bias_force, task, null, self.law.torque_limits)


# Of the damped inverse, 1/s.
RATES = (120.0, 80.0, 60.0)
# s, from a sample to the middle of the period of 1 ms in which torques act; kg that a robot is to
# bear unknown.
DELAY, PAYLOAD = 1.5e-3, 1.0
# s_off of our robot's perception; s_on is two fifths of it, as in a scene without its own.
THRESHOLD = 0.2
STIFFNESSES = (10000.0, 3000.0, 1000.0)
ANGULAR_STIFFNESSES = (100.0, 30.0)
DAMPING_RATIOS = (1.0, 0.7)
FACTORS = (0.1, 0.2, 0.3)
# Of the observer of disturbances, 1/s, and what laws are called that have it.
OBSERVER, OBSERVED = 100.0, ", observer"


def ours(
    task: Task, observed: bool = True, beyond: float = 0.0, s_off: float = THRESHOLD
) -> Setting:
    """Return our law, whose rates are not chosen: they follow from delay and payload (R8, R9).

    Args:
        task: of the robot.
        observed: whether it has the observer.
        beyond: m, from the tool along its z axis, where the payload may be.
        s_off: of the robot's perception.
    """
    known = OperationalLaw(Mechanism(task.scene))
    at_start = known.state(task.start, 0.0 * task.start)
    ratio = inertia_ratio(at_start, PAYLOAD, np.array([0.0, 0.0, beyond]))
    found = loop_rates(DELAY, ratio, observed)
    gains = Gains(linear_rate=found.law, angular_rate=found.law)

    def make(mechanism: Mechanism, point: str, limits: Array) -> Law:
        scene = mechanism.scene.with_(f"perception={{s_on: {0.4 * s_off}, s_off: {s_off}}}")
        return Ours(OperationalLaw(Mechanism(scene), point, gains, torque_limits=limits))

    return Setting(OURS, {"rate": found.law, "observer": found.observer}, make, found.observer)


def impedance(stiffness: float, angular: float, ratio: float) -> Setting:
    """Return an impedance, N/m, N m/rad and 1."""

    def make(mechanism: Mechanism, point: str, limits: Array) -> Law:
        law = OperationalLaw(mechanism, point, Gains(), torque_limits=limits)
        mobility = law.state(law.posture, 0.0 * law.posture).analysis.inverse_inertia.diagonal()
        masses = np.repeat((1.0 / mobility[:3].mean(), 1.0 / mobility[3:].mean()), 3)
        return Impedance(law, stiffness, angular, ratio, masses)

    values = {"stiffness": stiffness, "angular stiffness": angular, "damping ratio": ratio}
    return Setting(IMPEDANCE, values, make)


def damped(rate: float, factor: float) -> Setting:
    """Return control with the damped inverse: rate of errors, 1/s, and λ, SI units."""
    gains = Gains(linear_rate=rate, angular_rate=rate)

    def make(mechanism: Mechanism, point: str, limits: Array) -> Law:
        return DampedInverse(OperationalLaw(mechanism, point, gains, torque_limits=limits), factor)

    return Setting(DAMPED, {"rate": rate, "factor": factor}, make)


def others(quick: bool = False) -> dict[str, list[Setting]]:
    """Return all settings of the other laws, from which the best is chosen; one of each if quick.

    Args:
        quick: whether one of each is enough.
    """
    if quick:
        return {IMPEDANCE: [impedance(3000.0, 30.0, 0.7)], DAMPED: [damped(40.0, 0.1)]}
    grid = product(STIFFNESSES, ANGULAR_STIFFNESSES, DAMPING_RATIOS)
    return {
        IMPEDANCE: list(starmap(impedance, grid)),
        DAMPED: list(starmap(damped, product(RATES, FACTORS))),
    }


def settings(task: Task, quick: bool = False) -> dict[str, list[Setting]]:
    """Return all settings of each law: of ours the one that follows from the robot.

    Each law is there as it is, and with the package's observer of disturbances.

    Args:
        task: of the robot.
        quick: whether one of each is enough.
    """
    plain = others(quick)
    observed = {
        name + OBSERVED: [one._replace(observer=OBSERVER) for one in tried]
        for name, tried in plain.items()
    }
    own = [ours(task)]
    return {OURS + OBSERVED: own, **observed, OURS: [ours(task, observed=False)], **plain}
