"""Simulated haptic device driver: what a real device's ROS driver would be, with a hand on it.

CRTK: publishes measured_cp, measured_cv, measured_cf; obeys servo_cf.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from hapticmech_ros.control import DeviceMeasurement
from hapticmech_ros.device import DeviceState, ImpedanceDevice, hand_law
from hapticmech_ros.mechanism import Simulator
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.nodes.base import NANOSECONDS, ClockedNode
from hapticmech_ros.nodes.inputs import ExpiringWrench, Latest
from hapticmech_ros.nodes.messages import (
    checked_stamp,
    read_wrench,
    write_pose,
    write_twist,
    write_wrench,
)
from hapticmech_ros.nodes.period_clock import Backlog
from hapticmech_ros.nodes.qos import COMMAND_SUBSCRIBER, CONTROL_SUBSCRIBER
from hapticmech_ros.nodes.statistics import DurationHistogram
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.layouts import DEVICE_FIELDS, pack_device
from hapticmech_ros.wire.topics import (
    DEVICE_COMMAND,
    DEVICE_FORCE,
    DEVICE_POSE,
    DEVICE_STATE,
    DEVICE_TWIST,
    HAND_WRENCH,
    START_HAND,
)


class HapticDeviceNode(ClockedNode):
    """Drives an :class:`ImpedanceDevice` at the control rate.

    The hand takes hold when commands arrive and lets go when they stop; without commands the
    actuators are at zero.
    """

    def __init__(self) -> None:
        super().__init__("haptic_device")
        scene = self.scene
        timeout = self.number_parameter(
            "command_timeout", 0.05, "servo_cf older than this counts as lost, s", 0.001, 1.0
        )
        hand_timeout = self.number_parameter(
            "hand_timeout", 0.2, "hand_cf stands this long, s; 0 for ever", 0.0, 3600.0
        )
        # With hand_waits the hand first takes hold when the service start_hand is called.
        self._hand_waits = self.flag_parameter(
            "hand_waits", False, "the hand takes hold only once device/start_hand is called"
        )
        self.timeout_ns = round(timeout * NANOSECONDS)
        self._device = ImpedanceDevice(
            scene.device, scene.simulation.period, scene.task_space == "planar"
        )
        self._hand = hand_law(scene.hand)
        self._push = np.zeros(6)
        self._extra = ExpiringWrench(round(hand_timeout * NANOSECONDS), NANOSECONDS // 20)
        self._command: Latest[Array] = Latest()
        self._state: DeviceState = self._device.at_rest(self._start_pose())
        # A real device would not have waited for a stall to pass: its motion is caught up.
        self._backlog = Backlog()
        self._held: pin.SE3 | None = None
        self._ticks_held = 0
        self.times_held = 0
        self.latency = DurationHistogram()
        self._pose, self._twist, self._force = PoseStamped(), TwistStamped(), WrenchStamped()
        self._ticks = 0
        self._wire = FlatArray(DEVICE_FIELDS)
        self._publish_wire = self.output(DEVICE_STATE, Float64MultiArray)
        self._publish_force = self.output(DEVICE_FORCE, WrenchStamped)
        self._publish_twist = self.output(DEVICE_TWIST, TwistStamped)
        self._publish_pose = self.output(DEVICE_POSE, PoseStamped)
        self.create_service(Trigger, START_HAND, self._on_start_hand)
        self.input(DEVICE_COMMAND.name, WrenchStamped, CONTROL_SUBSCRIBER, self._on_command)
        self.input(HAND_WRENCH.name, WrenchStamped, COMMAND_SUBSCRIBER, self._on_hand_wrench)

    def tick(self, periods: int, deadline_ns: int) -> None:
        """Move the device on under the command that stands, and publish what it measures."""
        command = self._standing_command(deadline_ns)
        self._push = self._extra.at(deadline_ns)
        for _ in range(self._backlog.steps(periods)):
            held = self._state.pose if self._held is None else self._held
            elapsed = self._ticks_held * self.period_s
            self._state = self._device.step(self._state, command, self._hand_now, elapsed, held)
            self._ticks_held += self._held is not None
        state = self._state
        measured = DeviceMeasurement(state.measured_pose, state.measured_twist, self._hand_wrench())
        self._publish_wire.publish(self._wire.encode(pack_device(deadline_ns, measured)))
        if self._ticks % self.view_every == 0:
            self._publish_view(measured, deadline_ns)
        self._ticks += 1

    def _publish_view(self, measured: DeviceMeasurement, deadline_ns: int) -> None:
        write_wrench(self._force, measured.hand_wrench, deadline_ns)
        write_twist(self._twist, measured.twist, deadline_ns)
        write_pose(self._pose, measured.pose, deadline_ns)
        self._publish_force.publish(self._force)
        self._publish_twist.publish(self._twist)
        self._publish_pose.publish(self._pose)

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return the device's state and figures."""
        rendering = self._command.fresh(self.now_ns(), self.timeout_ns)
        sentence = "rendering" if rendering else "no commands: actuators at zero"
        return (
            rendering,
            sentence,
            {
                **self.clock_figures(self._backlog),
                "times_held": str(self.times_held),
                **self.latency.summary("loop_latency"),
            },
        )

    def _standing_command(self, now_ns: int) -> Array:
        """Return servo_cf, or zero when it is stale; the hand takes hold and lets go with it."""
        command = self._command.value
        if command is None or not self._command.fresh(now_ns, self.timeout_ns):
            if self._held is not None:
                self.get_logger().warning("servo_cf is lost: actuators at zero")
            self._held = None
            return np.zeros(6)
        if self._held is None and not self._hand_waits:
            self._held = self._state.pose
            self._ticks_held = 0
            self.times_held += 1
        return command

    def _hand_now(self, elapsed: float, pose: pin.SE3, twist: Array, held: pin.SE3) -> Array:
        if self._held is None:
            return self._push
        return self._push + self._hand(elapsed, pose, twist, held)

    def _hand_wrench(self) -> Array:
        state = self._state
        held = state.pose if self._held is None else self._held
        return self._hand_now(self._ticks_held * self.period_s, state.pose, state.twist, held)

    def _on_command(self, message: WrenchStamped, now_ns: int) -> None:
        measured = checked_stamp(message.header, now_ns, self.age_limit_ns, unstamped_is_now=True)
        self._command.put(read_wrench(message), now_ns)
        self.latency.add(now_ns - measured)
        self.ages.add(now_ns - measured)

    def _on_hand_wrench(self, message: WrenchStamped, now_ns: int) -> None:
        checked_stamp(message.header, now_ns, self.age_limit_ns, unstamped_is_now=True)
        self._extra.put(read_wrench(message), now_ns)

    def _on_start_hand(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        del request
        response.success = self._hand_waits
        response.message = "the hand starts" if self._hand_waits else "the hand was not waiting"
        self._hand_waits = False
        return response

    def _start_pose(self) -> pin.SE3:
        """Return where the device stands at the start: at the operational point."""
        simulator = Simulator(self.scene)
        terms = simulator.evaluate(simulator.initial_state())
        return terms.points[simulator.mechanism.point_index(self.point)].pose
