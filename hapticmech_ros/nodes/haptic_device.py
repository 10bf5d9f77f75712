"""Simulated haptic device driver: what a real device's ROS driver would be, with a hand on it.

CRTK: publishes measured_cp, measured_cv, measured_cf; obeys servo_cf.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
from rclpy.event_handler import QoSSubscriptionMatchedInfo, SubscriptionEventCallbacks
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from hapticmech_ros.control.passivity import passivity_for
from hapticmech_ros.device import NO_WRENCH, DeviceState, device_for
from hapticmech_ros.device.safety import SafetyEnvelope, SafetyLimits
from hapticmech_ros.mechanism import Simulator
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.nodes.actor import ClockedActor
from hapticmech_ros.nodes.answers import Answers
from hapticmech_ros.nodes.command_guard import CommandGuard
from hapticmech_ros.nodes.device_view import DeviceView
from hapticmech_ros.nodes.host import Host
from hapticmech_ros.nodes.inputs import Latest, Stamped
from hapticmech_ros.nodes.local_loop import LocalLoop
from hapticmech_ros.nodes.parameters import DeviceParameters
from hapticmech_ros.nodes.pushes import Pushes
from hapticmech_ros.nodes.statistics import DurationHistogram
from hapticmech_ros.times import nanoseconds
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.device_wire import DeviceWriter
from hapticmech_ros.wire.gain_wire import GAIN_FIELDS
from hapticmech_ros.wire.layouts import DEVICE_FIELDS, DEVICE_MEASURED
from hapticmech_ros.wire.topics import (
    DEVICE_COMMAND,
    DEVICE_GAIN,
    DEVICE_STATE,
    EMERGENCY_STOP,
    HAND_WRENCH,
    START_HAND,
)


class HapticDevice(ClockedActor[DeviceParameters]):
    """Drives an :class:`~hapticmech_ros.device.ImpedanceDevice` at the control rate.

    The hand takes hold when commands arrive and lets go when they stop; without commands the
    actuators are at zero. In lockstep the hand holds from the start, and the command that acts over
    a period answers the sample one period before it.
    """

    name = "haptic_device"
    parameters_type = DeviceParameters

    def __init__(self, node: Host, parameters: DeviceParameters) -> None:
        self._pushes: Pushes | None = None
        super().__init__(node, parameters)
        self._hand_waits = parameters.hand_waits
        self._envelope = SafetyEnvelope(self.period_s)
        self._loop = LocalLoop(paired=self._is_local and self.scene.connection.networked)
        self._answers = Answers(self._loop)
        self._passivity = passivity_for(self.scene)
        self._device = device_for(self.scene, with_hand=parameters.hand == "scene")
        self._push: Array = NO_WRENCH
        self._awaited: Stamped[Array] = Stamped()
        self._command: Latest[Array] = Latest()
        self._commands: Stamped[Array] = Stamped()
        self._state: DeviceState = self._device.at_rest(self._start_pose())
        self._held: DeviceState | None = None
        self._ticks_held = 0
        self.times_held = 0
        self.latency = DurationHistogram()
        self._ticks = 0
        self._wire, self._written = FlatArray(DEVICE_FIELDS), DeviceWriter()
        self._publish_wire = self.output(DEVICE_STATE, Float64MultiArray)
        self._view = DeviceView(self)
        node.keep(node.create_service(Trigger, START_HAND, self._on_start_hand))
        node.keep(node.create_service(SetBool, EMERGENCY_STOP, self._on_stop))
        commands = node.resolve_topic_name(DEVICE_COMMAND.name)
        self._guard = CommandGuard(lambda: node.count_publishers(commands))
        self.input_command(
            DEVICE_COMMAND.name,
            self.control_input,
            self._on_command,
            events=SubscriptionEventCallbacks(matched=self._on_matched),
        )
        if self._is_local:
            self.input_array(DEVICE_GAIN.name, self.control_input, self._on_gain, GAIN_FIELDS)
        if self._awaits_hand:
            qos = self.control_input
            self.input_command(HAND_WRENCH.name, qos, self._on_awaited, unstamped_is_now=False)
        else:
            verbs = {"hand_cf": False, "held_cf": True}
            frames = ["device", "device_world"]
            self._pushes = Pushes(self, {"hand": "device"}, verbs, frames)
            self._pushes.listen(HAND_WRENCH.name)
            self.adopt(parameters)

    @property
    def _awaits_hand(self) -> bool:
        return self.lockstep and self.parameters.hand == "commanded"

    @property
    def _is_local(self) -> bool:
        return self.scene.controller.local

    def adopt(self, parameters: DeviceParameters) -> None:
        """Take new parameters: the timeouts count from now on."""
        super().adopt(parameters)
        self.timeout_ns = self.silence_ns(parameters.command_timeout)
        device = self.scene.device
        self._limits = SafetyLimits(
            force=parameters.force_limit or device.force_limit,
            torque=parameters.torque_limit or device.torque_limit,
            force_slew=parameters.force_slew,
            torque_slew=parameters.torque_slew,
            ramp=parameters.start_ramp,
            radius=parameters.workspace_radius or math.inf,
        )
        if self._pushes is not None:
            self._pushes.set_timeout(nanoseconds(parameters.hand_timeout))

    def activate(self) -> None:
        """Begin where the device is, held by nobody; in lockstep, held from the start."""
        if self._pushes is not None:
            self._pushes.forget()
        self._push = NO_WRENCH
        self._command = Latest()
        self._state = self._device.at_rest(self._state.pose, self.lockstep, self._state.home)
        self._envelope.place(self._state.published[:3])
        self._envelope.stop()
        self._passivity.begin()
        self._held = self._state if self.lockstep else None
        self.times_held = int(self.lockstep)

    def deactivate(self) -> None:
        """Put the actuators at zero and let go."""
        self._command = Latest()
        self._let_go(self.now_ns())
        self._state = self._device.at_rest(self._state.pose, home=self._state.home)

    def ready(self, deadline_ns: int) -> bool:
        """Return whether the command to act on, and the hand's wrench if awaited, are there."""
        if self._awaits_hand and not self._awaited.has(deadline_ns):
            return False
        answered = self.answered_ns(deadline_ns)
        known = self._commands.has(answered)
        return self._ticks < 2 or (known and (not self._is_local or self._loop.gains.has(answered)))

    def tick(self, periods: int, deadline_ns: int) -> None:
        """Move the device on under the command that stands, and publish what it measures."""
        if self._ticks or not self.lockstep:
            for behind in reversed(range(self.backlog.steps(periods))):
                self._move(self._standing_command(deadline_ns - behind * self.period_ns))
        self._push = self._pushing(deadline_ns)
        told = self._answers.round_trip, self._answers.obeys or self.lockstep
        self._written.see(self._state, self._device.sensed(self._push), deadline_ns, *told)
        self._publish_wire.publish(self._wire.encode(self._written.values))
        self._loop.measured(self._written.values[DEVICE_MEASURED], deadline_ns)
        if self._ticks % self.view_every == 0:
            self._view.publish(self._state, self._written.hand_wrench, deadline_ns)
            self._view.publish_energy(self._passivity, self._sample(), deadline_ns)
        self._ticks += 1

    def _move(self, command: Array | None) -> None:
        held, ticks = self._held, self._ticks_held
        self._state = self._device.step(self._state, command, held, ticks, self._push)
        self._ticks_held += held is not None

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return the device's state and figures."""
        fault, counts = self._guard.fault, self._envelope.counts
        rendering = not fault and self._command.fresh(self.now_ns(), self.timeout_ns)
        sentence = "rendering" if rendering else f"{fault or 'no commands'}: actuators at zero"
        return (
            rendering,
            sentence,
            {
                **self.clock_figures(),
                "times_held": str(self.times_held),
                "fault": fault,
                "changed_by_passivity": str(self._passivity.changed),
                **{f"limited_by_{reason.value}": str(count) for reason, count in counts.items()},
                **self._answers.figures(),
                **self.latency.summary("loop_latency"),
                **({} if self._pushes is None else self._pushes.figures(self.now_ns())),
            },
        )

    def _standing_command(self, now_ns: int) -> Array | None:
        """Return servo_cf, or None when it is stale; the hand takes hold and lets go with it."""
        fault = self._guard.fault
        if self.lockstep:
            answer = self._answer_of(self.answered_ns(now_ns)) if self._ticks >= 2 else NO_WRENCH
            if fault:
                self._envelope.stop()
                return None
            return self._safe(answer)
        command = self._command.value
        fresh = self._command.fresh(now_ns, self.timeout_ns)
        lost = fault or ("servo_cf is lost" if not fresh else self._answers.lost(now_ns))
        if command is None or lost:
            if self._held is not None:
                self.node.get_logger().warning(f"{lost}: actuators at zero")
            self._let_go(now_ns)
            return None
        if not self._answers.begin(now_ns):
            return None
        if self._held is None and not self._hand_waits:
            self._held = self._state
            self._ticks_held = 0
            self.times_held += 1
        return self._safe(self._loop.correct(command, self._answers.answered_ns, now_ns))

    def _answer_of(self, answered_ns: int) -> Array:
        """Return the answer to a sample, in lockstep."""
        command = self._commands.take(answered_ns)
        if not self._is_local:
            return command
        return self._loop.correct_in_lockstep(command, answered_ns)

    def _safe(self, command: Array) -> Array:
        """Return what leaves of a command: no energy that is not there, and within all limits."""
        sample = self._sample()
        self._passivity.see(sample, self._state.applied)
        self._passivity.mechanism = self._loop.to_mechanism
        held = self._passivity.hold(command, sample, self._device.compensation(self._state))
        return self._envelope.apply(self._limits, held, sample[:3])

    def _sample(self) -> Array:
        """Return the device's sample (19,) as it is now."""
        numbers = self._state.published[:19].copy()
        numbers[13:] += self._device.sensed(self._push)
        return numbers

    def _let_go(self, now_ns: int) -> None:
        """Let the hand go, and begin anew with the next command."""
        self._held = None
        self._answers.let_go(now_ns)
        self._passivity.begin()
        self._envelope.stop()

    def _pushing(self, now_ns: int) -> Array:
        """Return what others add to the hand's wrench from now on."""
        if self._pushes is None:
            return self._awaited.take(now_ns)
        return self._pushes.at(now_ns, self._rotation_of).get("hand", NO_WRENCH)

    def _rotation_of(self, frame: str) -> Array:
        return np.eye(3) if frame == "device_world" else np.asarray(self._state.pose.rotation)

    def _on_command(self, wrench: Array, stamp_ns: int, now_ns: int) -> None:
        self.latency.add(now_ns - stamp_ns)
        self.ages.add(now_ns - stamp_ns)
        self._guard.heard(wrench.tobytes(), stamp_ns, now_ns)
        if self.lockstep:
            self._commands.put(wrench, stamp_ns)
        elif not self._answers.is_next(stamp_ns, now_ns):
            self._command.renew(now_ns)  # a sign of life, but older than what is obeyed
            return
        self._command.put(wrench, now_ns)
        if self.lockstep:
            self.act(now_ns)

    def _on_gain(self, values: Array, now_ns: int) -> None:
        self._loop.take(values, now_ns, self.lockstep)
        if self.lockstep:
            self.act(now_ns)

    def _on_awaited(self, wrench: Array, stamp_ns: int, now_ns: int) -> None:
        self._awaited.put(wrench, stamp_ns)
        self.act(now_ns)

    def _on_matched(self, info: QoSSubscriptionMatchedInfo) -> None:
        self._guard.matched(info.current_count, self.now_ns(), self.timeout_ns)

    def _on_stop(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Put the actuators at zero, until it is taken back."""
        self._guard.stop(request.data)
        response.success = True
        response.message = "actuators at zero" if request.data else "commands are obeyed again"
        return response

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
        # Once, at the start: not worth the time that compiled kernels take to load.
        simulator = Simulator(self.scene, compiled=False)
        terms = simulator.evaluate(simulator.initial_state())
        return terms.points[simulator.mechanism.point_index(self.point)].pose
