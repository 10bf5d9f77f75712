"""The controllers of Fig. 3 as a node: answers every device measurement with two wrenches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.control import DeviceMeasurement, Engagement, control_for
from hapticmech_ros.control.flat import flat_device, model_of
from hapticmech_ros.control.prediction import InFlight
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.nodes.host import Host
from hapticmech_ros.nodes.inputs import NEVER, Latest, Stamped
from hapticmech_ros.nodes.messages import (
    check_age,
    checked_stamp,
    read_pose,
    read_twist,
    read_wrench,
    write_wrench,
)
from hapticmech_ros.nodes.parameters import ControllerParameters
from hapticmech_ros.nodes.qos import CONTROL_SUBSCRIBER
from hapticmech_ros.times import NANOSECONDS, nanoseconds
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.layouts import DEVICE_FIELDS, GAIN_FIELDS, RENDERING_FIELDS, pack_gain
from hapticmech_ros.wire.readings import RenderingReading, read_device, read_rendering
from hapticmech_ros.wire.topics import (
    CHANNEL_PART,
    CONSTRAINT_PART,
    DEVICE_COMMAND,
    DEVICE_FORCE,
    DEVICE_GAIN,
    DEVICE_POSE,
    DEVICE_STATE,
    DEVICE_TWIST,
    IMPEDANCE_PART,
    POINT_COMMAND,
    RENDERING,
)
from hapticmech_ros.wire.wrench import encode_wrench

# The point's pose is carried on by its twist to the time of the device's measurement, by no more
# than this: beyond it the twist says nothing.
PREDICTION_LIMIT_S = 0.005
_NO_WRENCH = np.zeros(6)


class TeleoperationController(Actor[ControllerParameters]):
    """Runs a scene's :class:`ControlArchitecture` on every sample of the device.

    While an input is missing or stale, or the mechanism does not hear it, it is disengaged: the
    device and the mechanism get zero once, then nothing; then it engages anew, without a jump. When
    the mechanism is held elsewhere it goes on there, without a jump either. In lockstep it answers
    when device and rendering of the same time are there.
    """

    name = "teleoperation_controller"
    parameters_type = ControllerParameters

    def __init__(self, node: Host, parameters: ControllerParameters) -> None:
        super().__init__(node, parameters)
        self._control = control_for(self.scene)
        self._engagement: Engagement | None = None
        self._grasp = b""
        self._sent = self._told = _NO_WRENCH
        # Whether the device corrects commands; one that speaks CRTK only does not.
        self._local = False
        self._answers = 0
        self.engagements = self.grasps = 0
        self._last_ns = NEVER
        self._state_ns = NEVER
        self._twist: Latest[Array] = Latest()
        self._hand: Latest[Array] = Latest()
        self._rendering: Latest[RenderingReading] = Latest()
        self._message = WrenchStamped()
        self._publish_device = self.output(DEVICE_COMMAND, WrenchStamped)
        self._publish_gain = self.output(DEVICE_GAIN, Float64MultiArray)
        self._gain = FlatArray(GAIN_FIELDS)
        self._gain_ns = NEVER
        self._publish_point = self.output(POINT_COMMAND, WrenchStamped)
        self._publish_parts = [
            self.output(topic, WrenchStamped)
            for topic in (IMPEDANCE_PART, CONSTRAINT_PART, CHANNEL_PART)
        ]
        self._devices: Stamped[Array] = Stamped()
        self._renderings: Stamped[RenderingReading] = Stamped()
        self._epoch_ns = 0
        qos = CONTROL_SUBSCRIBER
        self.input_array(
            DEVICE_STATE.name, self.control_input, self._on_device_state, DEVICE_FIELDS
        )
        self.input(DEVICE_FORCE.name, WrenchStamped, qos, self._on_force)
        self.input(DEVICE_TWIST.name, TwistStamped, qos, self._on_twist)
        self.input_array(
            RENDERING.of(self.point), self.control_input, self._on_rendering, RENDERING_FIELDS
        )
        self.input(DEVICE_POSE.name, PoseStamped, qos, self._on_device_pose)

    def adopt(self, parameters: ControllerParameters) -> None:
        """Take new parameters: the timeout counts from now on."""
        super().adopt(parameters)
        self.timeout_ns = nanoseconds(parameters.input_timeout)
        # Less half a period: samples are not evenly apart.
        self._gain_every_ns = nanoseconds((self.view_every - 0.5) * self.period_s)

    def activate(self) -> None:
        """Wait for device and rendering; times count from now, to lose no digits."""
        self._last_ns = self._state_ns = NEVER
        self._twist, self._hand, self._rendering = Latest(), Latest(), Latest()
        self._epoch_ns = self.now_ns()

    def deactivate(self) -> None:
        """Let go of device and mechanism."""
        self._disengage(["activity"])

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return whether the controller is engaged, or which inputs it lacks."""
        now = self.now_ns()
        silent = [
            name
            for name, heard in (
                (DEVICE_STATE.name, self._last_ns),
                (RENDERING.of(self.point), self._rendering.stamp_ns),
            )
            if now - heard > self.timeout_ns
        ]
        rendering = self._rendering.value
        if not silent and rendering is not None and not rendering.commanded:
            silent.append(POINT_COMMAND.of(self.point) + " to reach the mechanism")
        engaged = self._engagement is not None and not silent
        sentence = "engaged" if engaged else f"waiting for {', '.join(silent) or 'a device'}"
        figures = {
            "answers": str(self._answers),
            "engagements": str(self.engagements),
            "grasps": str(self.grasps),
        }
        return engaged, sentence, figures

    def _on_device_state(self, values: Array, now_ns: int) -> None:
        stamp, device = read_device(values)
        check_age(stamp, now_ns, self.age_limit_ns)
        self._state_ns = now_ns
        self._local = self.scene.controller.force_channel.local
        if self.lockstep:
            self._devices.put(device, stamp)
            self._answer_pair(stamp)
        else:
            self._answer(device, stamp, now_ns)

    def _answer_pair(self, stamp: int) -> None:
        """Answer once device and rendering of one time are there, in lockstep."""
        if not (self._devices.has(stamp) and self._renderings.has(stamp)):
            return
        device, rendering = self._devices.take(stamp), self._renderings.take(stamp)
        self._last_ns = stamp
        self._answer_to(device, rendering, stamp, stamp)

    def _on_device_pose(self, message: PoseStamped, now_ns: int) -> None:
        """Answer a device that speaks CRTK only: its pose comes last of a sample's three."""
        stamp = checked_stamp(message.header, now_ns, self.age_limit_ns, unstamped_is_now=False)
        pose = read_pose(message)
        if self.lockstep or now_ns - self._state_ns <= self.timeout_ns:
            return
        twist, hand = self._twist.value, self._hand.value
        lost = [
            topic.name
            for topic, held in ((DEVICE_TWIST, self._twist), (DEVICE_FORCE, self._hand))
            if not held.fresh(now_ns, self.timeout_ns)
        ]
        if lost or twist is None or hand is None:
            self._disengage(lost)
            return
        self._local = False
        self._answer(flat_device(DeviceMeasurement(pose, twist, hand)), stamp, now_ns)

    def _answer(self, device: Array, stamp: int, now_ns: int) -> None:
        self.ages.add(now_ns - stamp)
        gap = now_ns - self._last_ns
        self._last_ns = now_ns
        rendering = self._rendering.value
        if rendering is None or not self._rendering.fresh(now_ns, self.timeout_ns):
            self._disengage([RENDERING.of(self.point)])
            return
        if gap > self.timeout_ns:
            self._disengage([DEVICE_STATE.name])
        if not rendering.commanded:
            # The mechanism does not hear us (yet): the device is left alone until it does.
            self._disengage([POINT_COMMAND.of(self.point) + " at the mechanism"])
            self._publish_point.publish(encode_wrench(_NO_WRENCH, stamp))
            return
        self._answer_to(device, rendering, stamp, now_ns)

    def _answer_to(
        self, device: Array, rendering: RenderingReading, stamp: int, now_ns: int
    ) -> None:
        ahead = (stamp - rendering.stamp_ns) / NANOSECONDS
        ahead = min(max(ahead, -PREDICTION_LIMIT_S), PREDICTION_LIMIT_S)
        rendered = rendering.rendered
        time_s = (now_ns - self._epoch_ns) / NANOSECONDS
        engagement = self._engagement
        if engagement is None:
            engagement = self._control.engage_flat(time_s, device, rendered, ahead)
            self._told = _NO_WRENCH
            self.engagements += 1
            self.node.get_logger().info("engaged")
        elif rendering.grasp != self._grasp:
            # Held elsewhere from now on: what the hand feels is carried over.
            engagement = self._control.engage_flat(time_s, device, rendered, ahead, self._sent)
            self._told = _NO_WRENCH
            self.grasps += 1
        self._grasp = rendering.grasp
        self._engagement = self._control.slipped_flat(time_s, engagement, device, rendered)
        self._send_gain(time_s, self._engagement, rendered, stamp)
        self._send(
            self._control.answer(
                time_s, self._engagement, device, rendered, ahead, self._in_flight()
            ),
            stamp,
        )

    def _in_flight(self) -> InFlight | None:
        """Return what the mechanism was told last, and the device has done already."""
        if not self._local:
            return None
        return InFlight(self.period_s, self.period_s * self._told)

    def _send_gain(
        self, time_s: float, engagement: Engagement, rendered: Array, stamp_ns: int
    ) -> None:
        """Publish how the device corrects commands: at view rate, in lockstep with each of them."""
        if not self._local:
            return
        if self.lockstep or stamp_ns - self._gain_ns >= self._gain_every_ns:
            self._gain_ns = stamp_ns
            gain = self._control.force_gain(time_s, engagement, model_of(rendered))
            self._publish_gain.publish(self._gain.encode(pack_gain(gain, stamp_ns)))

    def _send(self, wrenches: Array, stamp_ns: int) -> None:
        """Publish rows 0 and 1 of an answer (6, 6); at view rate also its parts, rows 2 to 4."""
        self._sent, self._told = wrenches[0], wrenches[1]
        self._publish_device.publish(encode_wrench(wrenches[0], stamp_ns))
        self._publish_point.publish(encode_wrench(wrenches[1], stamp_ns))
        if self._answers % self.view_every == 0:
            for publisher, wrench in zip(self._publish_parts, wrenches[2:5], strict=True):
                write_wrench(self._message, wrench, stamp_ns)
                publisher.publish(self._message)
        self._answers += 1

    def _disengage(self, lost: Sequence[str]) -> None:
        """Say zero to both sides at once, rather than let them find out by waiting."""
        if self._engagement is None:
            return
        self.node.get_logger().warning(f"disengaged: lost {', '.join(lost)}")
        self._engagement = None
        self._gain_ns = NEVER
        zero = encode_wrench(_NO_WRENCH, self.now_ns())
        self._publish_device.publish(zero)
        self._publish_point.publish(zero)

    def _on_force(self, message: WrenchStamped, now_ns: int) -> None:
        stamp = checked_stamp(message.header, now_ns, self.age_limit_ns, unstamped_is_now=False)
        self._hand.put(read_wrench(message), stamp)

    def _on_twist(self, message: TwistStamped, now_ns: int) -> None:
        stamp = checked_stamp(message.header, now_ns, self.age_limit_ns, unstamped_is_now=False)
        self._twist.put(read_twist(message), stamp)

    def _on_rendering(self, values: Array, now_ns: int) -> None:
        found = read_rendering(values)
        check_age(found.stamp_ns, now_ns, self.age_limit_ns)
        self._rendering.put(found, found.stamp_ns)
        self.ages.add(now_ns - found.stamp_ns)
        if self.lockstep:
            self._renderings.put(found, found.stamp_ns)
            self._answer_pair(found.stamp_ns)
