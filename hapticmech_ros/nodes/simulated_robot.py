# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot in MuJoCo behind the topics of ros2_control, for robot_follower without a real one."""

from __future__ import annotations

import math

import numpy as np
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.model import authored_state, build_tree
from hapticmech_ros.nodes.actor import ClockedActor, Host, LastValidState
from hapticmech_ros.nodes.inputs import Latest, numbers_in
from hapticmech_ros.nodes.messages import (
    CONTROL_SUBSCRIBER,
    STREAM_PUBLISHER,
    set_stamp,
    wrench_message,
)
from hapticmech_ros.nodes.robot_parameters import SimulatedRobotParameters
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.quaternions import turned
from hapticmech_ros.numerics.times import nanoseconds
from hapticmech_ros.robot.interfaces import servo_torque
from hapticmech_ros.robot.mujoco_robot import Around, MujocoRobot, Wall

# Least number of MuJoCo's steps in a period, and Hz of the joints' servo, which is no slower than
# that of a robot's own controller, whatever the control rate is.
STEPS, SERVO = 4, 1000.0
# N m, rad, rad/s and so on that no command exceeds.
LARGEST = 1e6


class SimulatedRobot(ClockedActor[SimulatedRobotParameters]):
    """Moves a robot under the commands of its joints.

    Commands that stop are replaced, after a timeout, by a brake: joints come to rest and stay.
    """

    name = "simulated_robot"
    parameters_type = SimulatedRobotParameters
    phase = 0.5

    def __init__(self, node: Host, parameters: SimulatedRobotParameters) -> None:
        if parameters.lockstep:
            raise InvalidInputError("lockstep", True, "must be false")
        super().__init__(node, parameters)
        wall = numbers_in("wall", parameters.wall)
        if wall.size not in (0, 6):
            raise InvalidInputError(
                "wall", parameters.wall, "must be a point and a normal, or empty"
            )
        around = Around(Wall(wall[:3], wall[3:] / np.linalg.norm(wall[3:])) if wall.size else None)
        self._turns = math.ceil(self.period_s * SERVO - 1e-9)
        self._steps = math.ceil(STEPS / self._turns)
        step = self.period_s / (self._turns * self._steps)
        self._robot = MujocoRobot(self.scene, parameters.operational_point, around, step)
        tree = build_tree(self.scene)
        self._names = list(tree.joint_names)
        start, rest = authored_state(self.scene, tree)
        self._robot.put(start, rest)
        self._last_valid = LastValidState(start, self.period_s)
        self._held: Array | None = None
        self._command: Latest[Array] = Latest()
        self._rates: Array | None = None
        self._states = node.keep(
            node.create_publisher(JointState, parameters.joint_state_topic, STREAM_PUBLISHER)
        )
        self._wrenches = node.keep(
            node.create_publisher(WrenchStamped, parameters.wrench_topic, STREAM_PUBLISHER)
        )
        is_trajectory = parameters.command_type == "trajectory"
        kind = JointTrajectory if is_trajectory else Float64MultiArray
        accept = self._on_trajectory if is_trajectory else self._on_array
        self.input(parameters.joint_command_topic, kind, CONTROL_SUBSCRIBER, accept)

    def activate(self) -> None:
        """Go on where the robot is, without earlier commands."""
        self._command, self._held = Latest(), None

    def reset(self) -> None:
        """Return to the last valid positions, at rest, without commands; be silent for a while."""
        q = self._last_valid.go_back(self.now_ns())
        self._robot.put(q, np.zeros(self._robot.nv))
        self.activate()

    def ready(self, deadline_ns: int) -> bool:
        """Return that there is no lockstep."""
        del deadline_ns
        return False

    def tick(self, periods: int, deadline_ns: int) -> None:
        """Move the robot, and publish its joints and its contact."""
        if self._last_valid.rests(deadline_ns, self.activate):
            return
        for _ in self.steps(periods, deadline_ns):
            for _ in range(self._turns):
                self._robot.advance(self._torque(deadline_ns), self._steps)
        self._last_valid.keep(self._robot.q, periods)
        message = JointState(name=self._names)
        set_stamp(message.header.stamp, deadline_ns)
        message.position, message.velocity = self._robot.q.tolist(), self._robot.v.tolist()
        self._states.publish(message)
        self._wrenches.publish(self._contact(deadline_ns))

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return whether the robot is commanded, and where it is."""
        commanded = self._commanded(self.now_ns())
        sentence = "commanded" if commanded else "no commands: the robot is at rest"
        force = float(np.linalg.norm(self._robot.contact_wrench()[:3]))
        return commanded, sentence, {**self.clock_figures(), "contact_n": f"{force:.3f}"}

    def _commanded(self, now_ns: int) -> bool:
        return self._command.fresh(now_ns, nanoseconds(self.parameters.command_timeout))

    def _torque(self, now_ns: int) -> Array:
        """Return torques (nv,) for the coming turn of the servo, N m or N."""
        robot, value = self._robot, self._command.value
        if value is None or not self._commanded(now_ns):
            if self._held is None:
                self._held = robot.q
            return servo_torque(robot, self._held, None)
        self._held = None
        if self.parameters.interface == "effort":
            return value
        if self.parameters.interface == "velocity":
            return servo_torque(robot, None, value)
        return servo_torque(robot, value, self._rates)

    def _contact(self, time_ns: int) -> WrenchStamped:
        """Return the wrench of a sensor at the tool, in the axes of the tool."""
        wrench = turned(self._robot.contact_wrench(), self._robot.pose.rotation.T)
        return wrench_message(wrench, time_ns, self.point)

    def _on_array(self, message: Float64MultiArray, now_ns: int) -> None:
        self._take(message.data, now_ns)

    def _on_trajectory(self, message: JointTrajectory, now_ns: int) -> None:
        """Take the end of a trajectory, at once: it is a period away."""
        if not message.points or list(message.joint_names) != self._names:
            rule = f"must be a trajectory of {self._names}"
            raise InvalidInputError("joint_names", list(message.joint_names), rule)
        end = message.points[-1]
        rates = self._checked(end.velocities) if len(end.velocities) else None
        self._take(end.positions, now_ns)
        self._rates = rates

    def _take(self, values: object, now_ns: int) -> None:
        self._command.put(self._checked(values), now_ns)

    def _checked(self, values: object) -> Array:
        found = np.array(values, dtype=float)
        if found.shape != (self._robot.nv,) or not (np.abs(found) <= LARGEST).all():
            rule = f"must be {self._robot.nv} numbers within ±{LARGEST:g}"
            raise InvalidInputError("command", found.tolist()[:20], rule)
        return found
