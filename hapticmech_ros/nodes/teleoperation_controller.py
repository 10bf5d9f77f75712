"""The controllers of Fig. 3 as a node: answers every device measurement with two wrenches."""

from __future__ import annotations

import pinocchio as pin
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.control import (
    ControlArchitecture,
    ControlOutput,
    DeviceMeasurement,
    Engagement,
    PointMeasurement,
)
from hapticmech_ros.control.prediction import carried_on
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.nodes.base import NANOSECONDS, HapticNode
from hapticmech_ros.nodes.inputs import Latest
from hapticmech_ros.nodes.messages import (
    checked_stamp,
    read_pose,
    read_twist,
    read_wrench,
    write_wrench,
)
from hapticmech_ros.nodes.qos import CONTROL_SUBSCRIBER
from hapticmech_ros.wire.layouts import Rendering, unpack_rendering
from hapticmech_ros.wire.topics import (
    CHANNEL_PART,
    CONSTRAINT_PART,
    CONTACT_FORCE,
    DEVICE_COMMAND,
    DEVICE_FORCE,
    DEVICE_POSE,
    DEVICE_TWIST,
    IMPEDANCE_PART,
    POINT_COMMAND,
    POINT_POSE,
    POINT_TWIST,
    RENDERING,
)

# The point's pose is carried on by its twist to the time of the device's measurement, by no more
# than this: beyond it the twist says nothing.
PREDICTION_LIMIT_S = 0.005


class TeleoperationControllerNode(HapticNode):
    """Runs a :class:`ControlArchitecture` on every device pose.

    While any input is missing or stale it is disengaged and sends nothing, so that device and
    mechanism let their commands run out; when all are back it engages anew, without a jump.
    """

    def __init__(self) -> None:
        super().__init__("teleoperation_controller")
        timeout = self.number_parameter(
            "input_timeout", 0.05, "an input older than this counts as lost, s", 0.001, 1.0
        )
        self.timeout_ns = round(timeout * NANOSECONDS)
        self._control = ControlArchitecture(self.scene)
        self._engagement: Engagement | None = None
        self._answers = 0
        self.engagements = 0
        self._last_ns = 0
        self._device_twist: Latest[Array] = Latest()
        self._hand: Latest[Array] = Latest()
        self._point_pose: Latest[pin.SE3] = Latest()
        self._point_twist: Latest[Array] = Latest()
        self._contact: Latest[Array] = Latest()
        self._rendering: Latest[Rendering] = Latest()
        self._message = WrenchStamped()
        self._publish_device = self.output(DEVICE_COMMAND, WrenchStamped)
        self._publish_point = self.output(POINT_COMMAND, WrenchStamped)
        self._publish_parts = [
            self.output(topic, WrenchStamped)
            for topic in (IMPEDANCE_PART, CONSTRAINT_PART, CHANNEL_PART)
        ]
        self._listen()

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return whether the controller is engaged, or which inputs it lacks."""
        now = self.now_ns()
        engaged = self._engagement is not None and now - self._last_ns <= self.timeout_ns
        missing = self._missing(now)
        if now - self._last_ns > self.timeout_ns:
            missing = [DEVICE_POSE.name, *missing]
        sentence = "engaged" if engaged else f"waiting for {', '.join(missing) or 'a device pose'}"
        figures = {"answers": str(self._answers), "engagements": str(self.engagements)}
        return engaged, sentence, figures

    def _on_device_pose(self, message: PoseStamped, now_ns: int) -> None:
        stamp = checked_stamp(message.header, now_ns, self.age_limit_ns, unstamped_is_now=False)
        device = read_pose(message)
        self.ages.add(now_ns - stamp)
        gap = now_ns - self._last_ns
        self._last_ns = now_ns
        twist, hand = self._device_twist.value, self._hand.value
        pose, point_twist, contact = (
            self._point_pose.value,
            self._point_twist.value,
            self._contact.value,
        )
        rendering = self._rendering.value
        if (
            self._missing(now_ns)
            or twist is None
            or hand is None
            or pose is None
            or point_twist is None
            or contact is None
            or rendering is None
        ):
            self._disengage()
            return
        if gap > self.timeout_ns:
            self._disengage()
        ahead = (stamp - self._point_pose.stamp_ns) / NANOSECONDS
        ahead = min(max(ahead, -PREDICTION_LIMIT_S), PREDICTION_LIMIT_S)
        point = carried_on(pose, point_twist, ahead)
        time_s = now_ns / NANOSECONDS
        if self._engagement is None:
            self._engagement = self._control.engage(time_s, device, point)
            self.engagements += 1
            self.get_logger().info("engaged")
        output = self._control.compute(
            time_s,
            self._engagement,
            DeviceMeasurement(device, twist, hand),
            PointMeasurement(point, point_twist, contact),
            rendering.model,
        )
        self._send(output, stamp)

    def _send(self, output: ControlOutput, stamp_ns: int) -> None:
        for publisher, wrench in (
            (self._publish_device, output.device),
            (self._publish_point, output.mechanism),
        ):
            write_wrench(self._message, wrench, stamp_ns)
            publisher.publish(self._message)
        if self._answers % self.view_every == 0:
            parts = (output.impedance, output.joint_constraint, output.four_channel)
            for publisher, wrench in zip(self._publish_parts, parts, strict=True):
                write_wrench(self._message, wrench, stamp_ns)
                publisher.publish(self._message)
        self._answers += 1

    def _missing(self, now_ns: int) -> list[str]:
        inputs: tuple[tuple[str, Latest[object]], ...] = (
            (DEVICE_TWIST.name, self._device_twist),
            (DEVICE_FORCE.name, self._hand),
            (POINT_POSE.of(self.point), self._point_pose),
            (POINT_TWIST.of(self.point), self._point_twist),
            (CONTACT_FORCE.of(self.point), self._contact),
            (RENDERING.of(self.point), self._rendering),
        )  # type: ignore[assignment]
        return [name for name, held in inputs if not held.fresh(now_ns, self.timeout_ns)]

    def _disengage(self) -> None:
        if self._engagement is not None:
            self.get_logger().warning(f"disengaged: lost {', '.join(self._missing(self._last_ns))}")
        self._engagement = None

    def _listen(self) -> None:
        def wrench(slot: Latest[Array], message: WrenchStamped, now_ns: int) -> None:
            stamp = checked_stamp(message.header, now_ns, self.age_limit_ns, unstamped_is_now=False)
            slot.put(read_wrench(message), stamp)

        def twist(slot: Latest[Array], message: TwistStamped, now_ns: int) -> None:
            stamp = checked_stamp(message.header, now_ns, self.age_limit_ns, unstamped_is_now=False)
            slot.put(read_twist(message), stamp)

        def point_pose(message: PoseStamped, now_ns: int) -> None:
            stamp = checked_stamp(message.header, now_ns, self.age_limit_ns, unstamped_is_now=False)
            self._point_pose.put(read_pose(message), stamp)
            self.ages.add(now_ns - stamp)

        def rendering(message: Float64MultiArray, now_ns: int) -> None:
            found = unpack_rendering(message.data)
            self._rendering.put(found, found.stamp_ns)
            self.ages.add(now_ns - found.stamp_ns)

        qos = CONTROL_SUBSCRIBER
        self.input(DEVICE_FORCE.name, WrenchStamped, qos, lambda m, now: wrench(self._hand, m, now))
        self.input(
            DEVICE_TWIST.name, TwistStamped, qos, lambda m, now: twist(self._device_twist, m, now)
        )
        self.input(
            POINT_TWIST.of(self.point),
            TwistStamped,
            qos,
            lambda m, now: twist(self._point_twist, m, now),
        )
        self.input(
            CONTACT_FORCE.of(self.point),
            WrenchStamped,
            qos,
            lambda m, now: wrench(self._contact, m, now),
        )
        self.input(POINT_POSE.of(self.point), PoseStamped, qos, point_pose)
        self.input(RENDERING.of(self.point), Float64MultiArray, qos, rendering)
        self.input(DEVICE_POSE.name, PoseStamped, qos, self._on_device_pose)
