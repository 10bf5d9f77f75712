# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot behind ros2_control that follows an operational point of the mechanism.

It receives joint states, and publishes commands of joints in a form of ros2_control's controllers.
The robot's contact wrench acts on the mechanism, and the hand feels it.
"""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.nodes.actor import ClockedActor, Host
from hapticmech_ros.nodes.inputs import joints_read, numbers_in
from hapticmech_ros.nodes.messages import (
    CONTROL_SUBSCRIBER,
    STREAM_PUBLISHER,
    WORLD,
    checked_stamp,
    read_pose,
    read_twist,
    read_wrench,
    set_stamp,
)
from hapticmech_ros.nodes.robot_parameters import BY_RULE, FollowerParameters
from hapticmech_ros.nodes.timeouts import ROBOT_JOINTS, ROBOT_TARGET, ROBOT_WRENCH, timeout_of
from hapticmech_ros.numerics.times import NANOSECONDS, nanoseconds
from hapticmech_ros.robot.follower import Follower, FollowerSettings, Order, load_arm
from hapticmech_ros.robot.interfaces import FeedbackPort, FeedbackSettings, WrenchSensor
from hapticmech_ros.robot.law import Gains, OperationalLaw, Tuning, inertia_ratio, loop_rates
from hapticmech_ros.wire.bounds import twist_bounds
from hapticmech_ros.wire.topics import EXTERNAL_WRENCH, POINT_POSE, POINT_TWIST
from hapticmech_ros.wire.wrench import encode_wrench

# Name below external_cf under which the robot's contact is put on the mechanism.
WHO = "robot"
# Service that tares the wrench sensor.
TARE_SENSOR = "robot/tare_wrench"
NO_TWIST = np.zeros(6)
# Parameters that may be -1: by R8 and R9.
RATES = ("linear_rate", "angular_rate", "observer_rate")
TIMEOUTS = {
    "joint_timeout": ROBOT_JOINTS,
    "target_timeout": ROBOT_TARGET,
    "wrench_timeout": ROBOT_WRENCH,
}
# rad, m, rad/s and m/s that no joint of a robot exceeds.
LARGEST = 1e3


class RobotFollower(ClockedActor[FollowerParameters]):
    """Runs a :class:`~hapticmech_ros.robot.follower.Follower` at the control rate."""

    name = "robot_follower"
    parameters_type = FollowerParameters
    phase = 0.75

    def __init__(self, node: Host, parameters: FollowerParameters) -> None:
        if parameters.lockstep:
            raise InvalidInputError("lockstep", True, "must be false: a robot has real time")
        if not parameters.robot:
            raise InvalidInputError("robot", "", "must be the file of a scene, URDF, MJCF or SDF")
        if parameters.command_type == "trajectory" and parameters.interface != "position":
            rule = "must be position with command_type trajectory"
            raise InvalidInputError("interface", parameters.interface, rule)
        super().__init__(node, parameters)
        self._timeouts = {
            name: timeout_of(parameters, name, rule, self.period_s)
            for name, rule in TIMEOUTS.items()
        }
        self._target_timeout_ns = nanoseconds(self._timeouts["target_timeout"])
        self._mechanism = Mechanism(
            load_arm(parameters.robot, numbers_in("gravity", parameters.gravity))
        )
        if parameters.wrench_frame:
            self._known_frame(parameters.wrench_frame)
        self._names = list(self._mechanism.tree.joint_names)
        self._law = self._new_law(parameters)
        self._port = FeedbackPort(self._feedback(parameters))
        self._sensor = WrenchSensor(
            parameters.tool_mass,
            numbers_in("tool_centre", parameters.tool_centre),
            numbers_in("sensor_offset", parameters.sensor_offset),
            numbers_in("sensor_gravity", parameters.sensor_gravity),
        )
        self._follower = self._new_follower(parameters)
        self._twist_bounds = twist_bounds(self.limits)
        self._twist, self._twist_ns = np.zeros(6), 0
        self._trouble = "no joint states have come"
        kind = JointTrajectory if parameters.command_type == "trajectory" else Float64MultiArray
        topic = parameters.joint_command_topic
        self._commands = node.keep(node.create_publisher(kind, topic, STREAM_PUBLISHER))
        pushed = f"{EXTERNAL_WRENCH.of(self.point)}/{WHO}"
        self._contact = self.output_named(pushed, WrenchStamped, STREAM_PUBLISHER)
        self._told_contact = False
        self._speakers = {
            name: self.sources(name)
            for name in (parameters.joint_state_topic, POINT_POSE.of(self.point))
        }
        self.input_stream(
            parameters.joint_state_topic,
            JointState,
            CONTROL_SUBSCRIBER,
            self._on_joints,
            self._speakers[parameters.joint_state_topic],
        )
        pose = POINT_POSE.of(self.point)
        self.input_stream(
            pose, PoseStamped, CONTROL_SUBSCRIBER, self._on_pose, self._speakers[pose]
        )
        twist = POINT_TWIST.of(self.point)
        self.input(twist, TwistStamped, CONTROL_SUBSCRIBER, self._on_twist)
        if parameters.wrench_topic:
            self.input(parameters.wrench_topic, WrenchStamped, CONTROL_SUBSCRIBER, self._on_wrench)
            node.keep(node.create_service(Trigger, TARE_SENSOR, self._on_tare))

    def activate(self) -> None:
        """Follow once joints and target are received from now on."""
        self._follower = self._new_follower(self.parameters)
        self._port.begin()
        for sources in self._speakers.values():
            sources.forget()

    def deactivate(self) -> None:
        """Leave the robot with its weight compensated, or at rest, and the mechanism without it."""
        order = self._follower.last()
        if order is not None:
            self._send(order, self.now_ns())

    def ready(self, deadline_ns: int) -> bool:
        """Return that there is no lockstep."""
        del deadline_ns
        return False

    def tick(self, periods: int, deadline_ns: int) -> None:
        """Command the robot's controller, and put the robot's contact on the mechanism."""
        del periods, deadline_ns
        now = self.now_ns()
        order = self._follower.order(now / NANOSECONDS)
        if order is None:
            return
        if order.trouble != self._trouble:
            self._trouble = order.trouble
            say = self.node.get_logger()
            if order.trouble:
                say.warning(f"the robot does not follow: {order.trouble}")
            else:
                say.info("the robot follows")
        self._send(order, now)

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return whether the robot follows, and how often it did not."""
        now = self.now_ns()
        faults = [sources.fault(now) for sources in self._speakers.values()]
        fault = "; ".join(filter(None, faults))
        follower = self._follower
        follows = follower.follows and not fault
        sentence = "the robot follows" if follows else fault or self._trouble
        port = {
            "feedback_energy": f"{self._port.given:.3g}",
            "feedback_changed": str(self._port.changed),
        }
        figures = {
            "fault": fault,
            **self.clock_figures(),
            **dict(follower.counts.figures()),
            **_rates(follower.tuning),
            **port,
        }
        return follows, sentence, figures

    def validate_parameters(self, parameters: FollowerParameters) -> None:
        """Refuse rates that are none, and an observer that would begin or end."""
        self._follower.check_change(self._tuning(parameters))

    def apply_parameters(self, parameters: FollowerParameters) -> None:
        """Take new parameters: feedback acts from now on, rates pass to the new ones."""
        super().apply_parameters(parameters)
        self._port.settings = self._feedback(parameters)
        self._follower.tune(self._tuning(parameters), self.now_ns() / NANOSECONDS)

    def _new_law(self, parameters: FollowerParameters) -> OperationalLaw:
        limits = numbers_in("torque_limits", parameters.torque_limits)
        return OperationalLaw(self._mechanism, parameters.robot_point, torque_limits=limits)

    def _tuning(self, parameters: FollowerParameters) -> Tuning:
        """Return the rates of parameters, those of -1 by R8 and R9.

        Raises:
            InvalidInputError: a rate that is none, or a rule without a delay.
        """
        asked = {name: getattr(parameters, name) for name in RATES}
        for name, rate in asked.items():
            if rate < 0.0 and rate != BY_RULE:
                raise InvalidInputError(name, rate, "must be 0 or more, or -1")
        linear, angular, observer = asked.values()
        if observer == BY_RULE != linear:
            raise InvalidInputError("linear_rate", linear, "must be -1 with observer_rate -1")
        if linear == BY_RULE:
            if parameters.interface != "effort":
                rule = f"must be 0 or more with interface {parameters.interface}: -1 is for torques"
                raise InvalidInputError("linear_rate", linear, rule)
            # Both rates share the sum that the delay allows.
            if observer not in (0.0, BY_RULE):
                rule = "must be 0 or -1 with linear_rate -1"
                raise InvalidInputError("observer_rate", observer, rule)
            if parameters.loop_delay == 0.0:
                raise InvalidInputError("loop_delay", 0.0, "must be above 0 for rates of -1")
            ratio, observed = self._inertia_ratio(parameters), observer == BY_RULE
            linear, observer = loop_rates(parameters.loop_delay, ratio, observed)
        gains = Gains(
            linear_rate=linear,
            angular_rate=linear if angular == BY_RULE else angular,
            damping_ratio=parameters.damping_ratio,
            posture_rate=parameters.posture_rate,
        )
        return Tuning(gains, observer)

    def _inertia_ratio(self, parameters: FollowerParameters) -> float:
        """Return R of the unknown payload, in the robot's initial state."""
        place = numbers_in("payload_centre", parameters.payload_centre)
        if place.size != 3:
            rule = "must be three numbers"
            raise InvalidInputError("payload_centre", parameters.payload_centre, rule)
        state = self._law.state(self._law.posture, np.zeros_like(self._law.posture))
        return inertia_ratio(state, parameters.unknown_payload, place)

    def _new_follower(self, parameters: FollowerParameters) -> Follower:
        tuning = self._tuning(parameters)
        law = self._law.with_gains(tuning.gains)
        return Follower(law, self._settings(parameters, tuning.observer_rate), self._sensor)

    def _feedback(self, parameters: FollowerParameters) -> FeedbackSettings:
        return FeedbackSettings(
            self.period_s,
            parameters.feedback,
            parameters.feedback_force,
            parameters.feedback_torque,
            parameters.feedback_passivity,
            parameters.feedback_allowance,
        )

    def _settings(self, parameters: FollowerParameters, observer_rate: float) -> FollowerSettings:
        return FollowerSettings(
            **self._timeouts,
            interface=parameters.interface,
            period=self.period_s,
            has_sensor=bool(parameters.wrench_topic),
            observer_rate=observer_rate,
            largest_error=parameters.largest_error,
            swing_speed=parameters.swing_speed,
            gain_ramp=parameters.gain_ramp,
        )

    def _send(self, order: Order, now_ns: int) -> None:
        self._commands.publish(self._message(order))
        fresh = now_ns - self._twist_ns <= self._target_timeout_ns
        felt = self._port.wrench(order.contact, self._twist if fresh else NO_TWIST)
        # Zero once, and then silence: a wrench that stands is taken away by its timeout as well.
        if felt.any() or self._told_contact:
            self._told_contact = bool(felt.any())
            self._contact.publish(encode_wrench(felt, now_ns))

    def _message(self, order: Order) -> Float64MultiArray | JointTrajectory:
        positions, rates = order.values.tolist(), order.rates.tolist()
        if self.parameters.command_type == "array":
            return Float64MultiArray(data=positions)
        # Without a stamp: from now on, to be reached a period later.
        point = JointTrajectoryPoint(positions=positions, velocities=rates)
        set_stamp(point.time_from_start, round(self.period_s * NANOSECONDS))
        return JointTrajectory(joint_names=self._names, points=[point])

    def _on_joints(self, message: JointState, now_ns: int) -> None:
        """Take a state of all joints, from one publisher; one of others is none of ours."""
        self._refuse_two(self.parameters.joint_state_topic, now_ns)
        found = joints_read(message, self._names)
        if found is None:
            return
        for what, values in zip(("position", "velocity"), found, strict=True):
            if not (np.abs(values) <= LARGEST).all():
                raise InvalidInputError(what, values.tolist(), f"must be within ±{LARGEST:g}")
        stamp = checked_stamp(message.header, now_ns, self.age_limit_ns, unstamped_is_now=True)
        self.ages.add(now_ns - stamp)
        self._follower.update_joints(*found, stamp / NANOSECONDS)

    def _on_twist(self, message: TwistStamped, now_ns: int) -> None:
        twist = read_twist(message, self._twist_bounds)
        stamp = checked_stamp(message.header, now_ns, self.age_limit_ns, unstamped_is_now=False)
        self._twist, self._twist_ns = twist, stamp

    def _on_pose(self, message: PoseStamped, now_ns: int) -> None:
        self._refuse_two(POINT_POSE.of(self.point), now_ns)
        pose = read_pose(message, self.limits)
        stamp = checked_stamp(message.header, now_ns, self.age_limit_ns, unstamped_is_now=False)
        # Sent just before it, of the same sample; an older one carries nothing on.
        is_of_now = abs(stamp - self._twist_ns) <= self._target_timeout_ns
        twist = self._twist if is_of_now else np.zeros(6)
        self._follower.update_target(pose, twist, stamp / NANOSECONDS)

    def _on_wrench(self, message: WrenchStamped, now_ns: int) -> None:
        frame = self._known_frame(self.parameters.wrench_frame or message.header.frame_id)
        wrench = read_wrench(message, self.wrenches, message.header.frame_id)
        stamp = checked_stamp(message.header, now_ns, self.age_limit_ns, unstamped_is_now=True)
        self._follower.update_wrench(wrench, stamp / NANOSECONDS, frame)

    def _known_frame(self, frame: str) -> str:
        """Return the frame that a wrench is given in, as it is.

        Raises:
            InvalidInputError: the robot has none of that name.
        """
        known = (
            WORLD,
            *(link.name for link in self._mechanism.scene.links),
            *self._mechanism.point_names,
        )
        if frame not in known:
            rule = f"must be one of {', '.join(known)}; or wrench_frame names the one that is meant"
            raise InvalidInputError("frame_id", frame, rule)
        return frame

    def _on_tare(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        del request
        return self.failures.answer(
            TARE_SENSOR, self._follower.tare, response, "the sensor is tared"
        )

    def _refuse_two(self, topic: str, now_ns: int) -> None:
        """Refuse a topic with two publishers where one is allowed: the robot stops."""
        if fault := self._speakers[topic].fault(now_ns):
            raise InvalidInputError(topic, fault, "must have one publisher")


def _rates(tuning: Tuning) -> dict[str, str]:
    """Return the rates that act, 1/s, for diagnostics."""
    gains = tuning.gains
    values = gains.linear_rate, gains.angular_rate, tuning.observer_rate
    return {name: f"{rate:.3g}" for name, rate in zip(RATES, values, strict=True)}
