# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot in MuJoCo that follows an operational point, as its nodes drive it."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.quaternions import turned
from hapticmech_ros.robot.follower import Follower, FollowerSettings, Order
from hapticmech_ros.robot.interfaces import Interface, servo_torque
from hapticmech_ros.robot.law import OperationalLaw
from hapticmech_ros.robot.linear_environment import LinearEnvironment
from hapticmech_ros.robot.mujoco_robot import MujocoRobot

# Of MuJoCo in a period.
STEPS = 4


class DrivenRobot:
    """A robot and its follower, from the law's posture at rest.

    Args:
        robot: in steps of a ``STEPS``-th of the period.
        law: that drives it.
        interface: what its controller takes.
        with_rates: whether positions come with their rates.
        period: s.

    Attributes:
        robot, follower: of it.
    """

    def __init__(
        self,
        robot: MujocoRobot,
        law: OperationalLaw,
        interface: Interface,
        with_rates: bool,
        period: float,
    ) -> None:
        self.robot, self._interface, self._with_rates = robot, interface, with_rates
        robot.put(law.posture, 0.0 * law.posture)
        self._rest = law.resting(law.posture)
        self.follower = Follower(law, FollowerSettings(interface, period, has_sensor=True))
        self._order: Order | None = None

    def move(self, time: float, sensed: Array, fixed_to: LinearEnvironment | None = None) -> Array:
        """Move for a period under the last order, and take a new one.

        Args:
            time: s, of its start.
            sensed: (6,) on the tool, N and N m, world axes.
            fixed_to: environment that the tool is fixed to; None: none.

        Returns:
            (6,) F_c at the start, N and N m, world axes.

        Raises:
            HapticMechError: the robot is lost.
        """
        robot = self.robot
        self.follower.update_joints(robot.q, robot.v, time)
        self.follower.update_wrench(turned(sensed, robot.pose.rotation.T), time)
        order = self.follower.order(time)
        robot.advance(self._torque(), STEPS, fixed_to)
        self._order = order
        return np.zeros(6) if order is None else order.contact

    def _torque(self) -> Array:
        order = self._order
        if order is None:
            return self._rest
        if self._interface == "effort":
            return order.values
        if self._interface == "velocity":
            return servo_torque(self.robot, None, order.values)
        return servo_torque(self.robot, order.values, order.rates if self._with_rates else None)
