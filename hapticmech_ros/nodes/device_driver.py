# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The common part of the drivers of haptic devices, simulated and real.

CRTK: publishes measured_cp, measured_cv, measured_cf, setpoint_cf, setpoint_cp, operating_state;
obeys servo_cf, body/servo_cf, servo_cp, hold, free and state_command.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Empty, Float64MultiArray
from std_srvs.srv import SetBool

from hapticmech_ros.control.passivity import DeviceSide, PassivityController
from hapticmech_ros.device import NO_WRENCH, DeviceState, SimulatedDevice
from hapticmech_ros.device.safety import PositionServo, SafetyLimits, safety_limits
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes import device_kernels as own
from hapticmech_ros.nodes import lane_kernels as kernels
from hapticmech_ros.nodes.actor import (
    LOG_PERIOD_NS,
    Actor,
    ClockedActor,
    Host,
    LastValidState,
)
from hapticmech_ros.nodes.buttons import ButtonOutput
from hapticmech_ros.nodes.inputs import NEVER, Standing
from hapticmech_ros.nodes.local_loop import FRESH_NS, Answers, LocalLoop
from hapticmech_ros.nodes.messages import (
    STREAM_PUBLISHER,
    check_in_world,
    checked_stamp,
    read_framed_pose,
)
from hapticmech_ros.nodes.operating_state import OperatingState
from hapticmech_ros.nodes.other_users import OtherUsers
from hapticmech_ros.nodes.parameters import DriverParameters, ParameterError
from hapticmech_ros.nodes.sources import STOPPED, CommandGuard, Sources
from hapticmech_ros.nodes.timeouts import COMMAND, Losses, plain_timeout_ns, timeout_of
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import DeviceSample
from hapticmech_ros.numerics.quaternions import turned
from hapticmech_ros.scene.device import Device
from hapticmech_ros.simulation import Simulator
from hapticmech_ros.wire.bounds import message_bounds
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.layouts import write_device_state
from hapticmech_ros.wire.messages import (
    UNLIMITED,
    DeviceEnergy,
    DeviceStateMessage,
    LocalFeedbackGain,
)
from hapticmech_ros.wire.stamped import JointStateWriter, encode_pose, encode_twist, nearest_stamp
from hapticmech_ros.wire.topics import (
    DEVICE_BODY_AXES,
    DEVICE_BODY_COMMAND,
    DEVICE_COMMAND,
    DEVICE_ENERGY,
    DEVICE_FORCE,
    DEVICE_FREE,
    DEVICE_GAIN,
    DEVICE_HOLD,
    DEVICE_JOINTS,
    DEVICE_OPERATING_STATE,
    DEVICE_POSE,
    DEVICE_POSE_COMMAND,
    DEVICE_POSE_SETPOINT,
    DEVICE_SETPOINT,
    DEVICE_STATE,
    DEVICE_STATE_COMMAND,
    DEVICE_TWIST,
    EMERGENCY_STOP,
    HAND_FORCE,
    Topic,
)
from hapticmech_ros.wire.wrench import encode_wrench

SERVO, HOLD = "servo_cp", "hold"
ONE_KIND = "one kind of command at a time"
# A command to stop the device would not be received.
DEAF = "the middleware of this node does not respond"


class PoseCommands:
    """The pose commanded to a device by CRTK's servo_cp, hold and free, if any.

    A ``servo_cp`` is valid for the device's command timeout, a ``hold`` until another command.
    While wrenches are obeyed, poses are refused, and vice versa; but a wrench ends a ``hold``.

    Args:
        actor: the device's.
        pose: returns the device's measured pose.
        wrenches: returns whether ``servo_cf`` is obeyed at a time, ns.
        refusal: returns why no command may be obeyed at a time, ns; empty if one may.
        ended: called when a pose command ends, with the reason; empty if ended by another command.

    Attributes:
        kind: the command that acts, ``servo_cp`` or ``hold``; empty if neither does.
        sources: publishers of ``servo_cp``.
        timeout_ns: how long a ``servo_cp`` is valid, ns.
    """

    def __init__(
        self,
        actor: Actor[Any],
        pose: Callable[[], pin.SE3],
        wrenches: Callable[[int], bool],
        refusal: Callable[[int], str],
        ended: Callable[[str], None],
    ) -> None:
        self._actor, self._pose, self._ended = actor, pose, ended
        self._wrenches, self._refusal = wrenches, refusal
        self.timeout_ns = 0
        self.sources: Sources = actor.sources(DEVICE_POSE_COMMAND.name)
        self._goal: pin.SE3 | None = None
        self.kind = ""
        self._received_ns = NEVER
        self._setpoint = actor.view(DEVICE_POSE_SETPOINT, PoseStamped)
        qos, name = actor.control_input, DEVICE_POSE_COMMAND.name
        actor.input_stream(name, PoseStamped, qos, self._on_servo, self.sources)
        actor.input(DEVICE_HOLD.name, Empty, STREAM_PUBLISHER, self._on_hold)
        actor.input(DEVICE_FREE.name, Empty, STREAM_PUBLISHER, self._on_free)

    def goal(self, now_ns: int) -> pin.SE3 | None:
        """Return the pose commanded at a time (ns), or None; end a ``servo_cp`` that timed out."""
        if self.kind == SERVO and now_ns - self._received_ns > self.timeout_ns:
            self.end(f"{SERVO} is lost")
        return self._goal

    def end(self, reason: str = "") -> None:
        """End the pose command, and call ``ended`` with the reason."""
        if self._goal is not None:
            self.forget()
            self._ended(reason)

    def forget(self) -> None:
        """End the pose command without calling ``ended``."""
        self._goal, self.kind = None, ""

    def give_way(self, now_ns: int) -> None:
        """End a ``hold`` because a ``servo_cf`` has arrived.

        Raises:
            InvalidInputError: a ``servo_cp`` is obeyed.
        """
        if self.goal(now_ns) is None:
            return
        if self.kind == SERVO:
            raise InvalidInputError("servo_cf", f"while {SERVO} is obeyed", ONE_KIND)
        self.end()

    def publish(self, stamp_ns: int) -> None:
        """Publish the commanded pose, if there is one."""
        if self._goal is not None:
            self._setpoint.offer(encode_pose, pin.SE3ToXYZQUAT(self._goal).tolist(), stamp_ns)

    def _on_servo(self, message: PoseStamped, now_ns: int) -> None:
        self._check_kind(SERVO, now_ns)
        self._check_allowed(SERVO, now_ns)
        check_in_world(message.header.frame_id)
        checked_stamp(message.header, now_ns, self._actor.age_limit_ns, unstamped_is_now=True)
        self._goal, self.kind = read_framed_pose(message, self._actor.limits), SERVO
        self._received_ns = now_ns

    def _on_hold(self, message: Empty, now_ns: int) -> None:
        del message
        self._check_kind(HOLD, now_ns)
        self._check_allowed(HOLD, now_ns)
        if self.kind != HOLD:
            self._goal, self.kind = self._pose(), HOLD

    def _on_free(self, message: Empty, now_ns: int) -> None:
        del message
        self._check_kind("free", now_ns)
        self.end()

    def _check_kind(self, word: str, now_ns: int) -> None:
        self._actor.refuse_in_lockstep(word, "a command", "be commanded")
        if self._wrenches(now_ns):
            raise InvalidInputError(word, "while servo_cf is obeyed", ONE_KIND)

    def _check_allowed(self, word: str, now_ns: int) -> None:
        reason = self._refusal(now_ns)
        if reason:
            raise InvalidInputError(word, "a command", f"cannot be obeyed: {reason}")


# The six coordinates as joints: metres, and the rotation vector's components in radians.
COORDINATES = ("x", "y", "z", "rx", "ry", "rz")


class DeviceView:
    """A device's CRTK topics.

    Args:
        actor: the device's.
    """

    def __init__(self, actor: Actor[Any]) -> None:
        self._joints = JointStateWriter(COORDINATES)
        self._publish_hand = actor.view(HAND_FORCE, WrenchStamped)
        self._publish_force = actor.view(DEVICE_FORCE, WrenchStamped)
        self._publish_twist = actor.view(DEVICE_TWIST, TwistStamped)
        self._publish_setpoint = actor.view(DEVICE_SETPOINT, WrenchStamped)
        self._publish_joints = actor.view(DEVICE_JOINTS, JointState)
        self._energy = FlatArray(DeviceEnergy.layout)
        self._publish_energy = actor.view(DEVICE_ENERGY, Float64MultiArray)
        self._publish_pose = actor.view(DEVICE_POSE, PoseStamped)

    def publish_energy(self, account: PassivityController, sample: Array, time_ns: int) -> None:
        """Publish a device's energies at a sample (19,), at a time (ns).

        Args:
            account: the passivity controller with the energies.
            sample: (19,) of the device, in SI units; see ``layout.DeviceSample``.
            time_ns: of the sample, ns.
        """
        if not self._publish_energy.wanted:
            return
        energy = DeviceEnergy.of(
            time_ns,
            from_hand=account.hand(sample),
            taken_by_actuators=account.actuators,
            to_mechanism=account.mechanism or 0.0,
            available=min(account.available, UNLIMITED),
            dissipated=account.dissipated,
        )
        self._publish_energy.publish(self._energy.encode(energy.values))

    def publish(self, state: DeviceState, hand_wrench: Array, time_ns: int) -> None:
        """Publish a state with the total external wrench (6,), at a time (ns).

        Args:
            state: of the device.
            hand_wrench: (6,) F_h, N and N m, world axes at the point held.
            time_ns: stamp, ns.
        """
        pose, twist, applied = state.measured_pose, state.measured_twist, state.applied
        self._publish_hand.offer(encode_wrench, hand_wrench, time_ns)
        self._publish_force.offer(encode_wrench, applied, time_ns)
        self._publish_twist.offer(encode_twist, twist.tolist(), time_ns)
        self._publish_setpoint.offer(encode_wrench, applied, time_ns)
        self._publish_joints.offer(self._coordinates, pose, twist, applied, time_ns)
        # Last of the sample: a controller that uses CRTK only answers the pose.
        self._publish_pose.offer(encode_pose, pin.SE3ToXYZQUAT(pose).tolist(), time_ns)

    def _coordinates(self, pose: pin.SE3, twist: Array, applied: Array, time_ns: int) -> bytes:
        """Return the serialized coordinates, their rates, and the power-conjugate efforts."""
        turned = pin.log3(pose.rotation)
        spin = pose.rotation @ pin.Jexp3(turned)
        rates = pin.Jlog3(pose.rotation) @ pose.rotation.T @ twist[3:]
        return self._joints.encode(
            [*pose.translation.tolist(), *turned.tolist()],
            [*twist[:3].tolist(), *rates.tolist()],
            [*applied[:3].tolist(), *(spin.T @ applied[3:]).tolist()],
            time_ns,
        )


def command_timeout_of(parameters: DriverParameters, device: Device, period_s: float) -> float:
    """Return how long (s) a device acts on a command.

    Args:
        parameters: of the device's node.
        device: of the scene.
        period_s: control period, s.

    Raises:
        InvalidInputError: the time is longer than the scene allows, or below three periods.
    """
    return timeout_of(parameters, "command_timeout", COMMAND, period_s, device)


def limits_of(parameters: DriverParameters, device: Device, period_s: float) -> SafetyLimits:
    """Return the safety limits set by parameters, within those of the scene's device.

    Args:
        parameters: of the device's node.
        device: of the scene.
        period_s: control period, s.

    Raises:
        ParameterError: names every parameter that breaks a rule, with value and rule.
    """
    problems = list(_problems(parameters, device, period_s))
    if problems:
        raise ParameterError("; ".join(problems))
    scene = safety_limits(device)
    return SafetyLimits(
        force=parameters.force_limit or scene.force,
        torque=parameters.torque_limit or scene.torque,
        force_slew=parameters.force_slew or scene.force_slew,
        torque_slew=parameters.torque_slew or scene.torque_slew,
        ramp=parameters.start_ramp or scene.ramp,
        radius=parameters.workspace_radius or scene.radius,
    )


def _problems(parameters: DriverParameters, device: Device, period_s: float) -> Iterator[str]:
    safety = device.safety
    for name, bound, key in (
        ("force_limit", device.force_limit, "device.force_limit"),
        ("torque_limit", device.torque_limit, "device.torque_limit"),
        ("force_slew", safety.force_slew, "device.safety.force_slew"),
        ("torque_slew", safety.torque_slew, "device.safety.torque_slew"),
        ("workspace_radius", safety.workspace_radius or math.inf, "device.safety.workspace_radius"),
    ):
        value = getattr(parameters, name)
        if value > bound:
            yield f"{name}: must be at most the scene's {key}, {bound:g} (got {value:g})"
    # 0 selects the scene's; a shorter ramp reaches full force sooner.
    if 0.0 < parameters.start_ramp < safety.start_ramp:
        yield (
            "start_ramp: must be at least the scene's device.safety.start_ramp, "
            f"{safety.start_ramp:g} (got {parameters.start_ramp:g})"
        )
    try:
        command_timeout_of(parameters, device, period_s)
    except InvalidInputError as error:
        yield str(error)


_HAND_WRENCH = DeviceSample.layout.slice("hand_wrench")


def _sample_of(state: DeviceState, pushed: Array) -> Array:
    """Return a device's sample (19,) with a further external wrench (6,) added to the hand's."""
    numbers = state.published[: DeviceSample.layout.size].copy()
    numbers[_HAND_WRENCH] += pushed
    return numbers


D = TypeVar("D", bound=DriverParameters)


class DeviceDriver(ClockedActor[D]):
    """Drives a device at the control rate.

    Without commands the actuators are at zero. Commands are wrenches, or poses to which the scene's
    ``device.servo`` pulls. Each kind of device is a subclass with :meth:`new_device`.

    Attributes:
        command_timeout: how long a command, and a real device's sample, is valid, s.
        side: passivity controller and limits that commands pass.
        users: inputs from other users' devices.
        loop: stores samples, and corrects commands for the motion since.
        answers: to the device's samples.
        device: the device driven.
        held: the device's state when the hand took hold; None: not held.
        commanders, gains: publishers of ``servo_cf``, and of ``local_feedback_gain``.
    """

    def __init__(self, node: Host, parameters: D) -> None:
        super().__init__(node, parameters)
        self._limit(parameters)
        self.side = DeviceSide(self.scene, self._limits)
        self.users = OtherUsers(self)
        self._begin_loop()
        self.device = self.new_device()
        self._push: Array = NO_WRENCH
        # servo_cf, and the time of the sample that it answers, ns.
        self._command: Standing[tuple[Array, int]] = Standing()
        # In lockstep, by the stamp of the sample that is answered, ns.
        self._commands: dict[int, Array] = {}
        self._state: DeviceState = self.device.at_rest(self._start_pose())
        self._last_valid = LastValidState(self._state, self.period_s)
        self.held: DeviceState | None = None
        self._ticks_held = 0
        # Whether the view does not show yet that the hand was let go.
        self._let_go_unpublished = False
        # The reason logged last, when, ns, and how often it has come again since.
        self._warned = "", 0, 0
        # Logs why obeying has ended.
        self._unlogged: Callable[[], None] | None = None
        self.times_held = 0
        self._losses = Losses(node.pauses, 1.0 / self.period_s, node.get_logger().warning)
        # Age of commands since the samples that they answer.
        self.durations["loop_latency"] = self.ages
        self._ticks = 0
        self._wire = FlatArray(
            DeviceStateMessage.layout, message_bounds(DeviceStateMessage, self.limits)
        )
        self._written = DeviceStateMessage()
        self._publish_wire = self.output(DEVICE_STATE, Float64MultiArray)
        self._view = DeviceView(self)
        self.buttons = ButtonOutput(self)
        node.keep(node.create_service(SetBool, EMERGENCY_STOP, self._on_stop))
        commands = self.sources(DEVICE_COMMAND.name)
        self.gains = gains = self.sources(DEVICE_GAIN.name)
        self._servo = PositionServo(self.scene.device, self.period_s, self._limits)
        self._poses = PoseCommands(
            self,
            lambda: self._state.measured_pose,
            self._obeys_wrenches,
            self._refusal,
            self._end_pose,
        )
        self._poses.timeout_ns = self.timeout_ns
        own = self.sources(DEVICE_BODY_COMMAND.name)
        self._guard = CommandGuard(commands, gains, self._poses.sources, own)
        self.commanders = commands
        # The topic whose wrenches are obeyed, and whether those of body/ have world axes.
        self._obeyed_form, self._own_is_absolute = DEVICE_COMMAND, False
        self._operating = OperatingState(
            self,
            (DEVICE_OPERATING_STATE, DEVICE_STATE_COMMAND),
            fault=self._fault,
            at_zero=self._look_at_refusal,
        )
        qos = self.control_input
        self.input_command(DEVICE_COMMAND.name, qos, self._on_command, sources=commands)
        # With servo_axes "body" the controller publishes both.
        if self.scene.device.servo_axes == "world" and not self.lockstep:
            self.input_command(DEVICE_BODY_COMMAND.name, qos, self._on_own_command, sources=own)
            self.input(DEVICE_BODY_AXES.name, Bool, STREAM_PUBLISHER, self._on_own_axes)
        if self.is_local:
            self.input_array(DEVICE_GAIN.name, qos, self._on_gain, LocalFeedbackGain.layout, gains)
        self.users.listen(lambda: self.loop)

    def new_device(self) -> SimulatedDevice:
        """Return the device that is driven."""
        raise NotImplementedError

    def has_sample(self) -> bool:
        """Return whether the last step gave a sample that can be published."""
        return True

    def unavailable(self) -> str:
        """Return why the device itself cannot be driven now; empty if it can."""
        return ""

    def pushed(self, deadline_ns: int) -> Array:
        """Return the external wrench (6,) other than the hand's from a deadline (ns) on.

        N and N m, world axes at the point held.
        """
        return NO_WRENCH

    def _begin_loop(self) -> None:
        paired = self.is_local and self.scene.connection.networked
        others = self.users.begin()
        bounds = message_bounds(LocalFeedbackGain, self.limits)
        self.loop = LocalLoop(self.period_s, bounds, paired, others)
        self.answers = Answers(self.loop)

    @property
    def is_local(self) -> bool:
        """Whether the device closes a part of the controller's loop."""
        return self.scene.controller.local

    def apply_parameters(self, parameters: D) -> None:
        """Replace the parameters; new timeouts and limits apply from now on."""
        super().apply_parameters(parameters)
        self._limit(parameters)
        self.side.envelope.limit(self._limits)
        self._servo = PositionServo(self.scene.device, self.period_s, self._limits)
        self._poses.timeout_ns = self.timeout_ns

    def _limit(self, parameters: D) -> None:
        device = self.scene.device
        self._limits = limits_of(parameters, device, self.period_s)
        self.command_timeout = command_timeout_of(parameters, device, self.period_s)
        self.timeout_ns = self.silence_ns(self.command_timeout)

    def validate_parameters(self, parameters: D) -> None:
        """Raise for limits or timeouts less safe than the scene's."""
        limits_of(parameters, self.scene.device, self.period_s)

    def activate(self) -> None:
        """Begin at the device's pose, not held; in lockstep, held from the start."""
        self._push = NO_WRENCH
        self._command.clear()
        self._guard.forget()
        # Earlier stamps are not comparable if the clock was set.
        self._begin_loop()
        self._state = self.device.at_rest(self._state.pose, self.lockstep, self._state.home)
        self.side.envelope.place(self._state.published[:3])
        self.side.begin()
        self.held = self._state if self.lockstep else None
        self.times_held = int(self.lockstep)
        self._operating.publish(active=True)

    def deactivate(self) -> None:
        """Set the actuators to zero, and let the hand go."""
        self.put_at_zero()
        self._operating.publish(active=False)

    def reset(self) -> None:
        """Return to the last valid state, at rest, with the actuators at zero, not held."""
        self._state, self._push = self._last_valid.go_back(self.now_ns()), NO_WRENCH
        self.put_at_zero()
        self.activate()

    def ready(self, deadline_ns: int) -> bool:
        """Return whether the command for the next step, and what corrects it, have arrived."""
        answered = self.answered_ns(deadline_ns)
        if self._ticks < 2:
            return True
        known = answered in self._commands
        if not self.is_local:
            return known
        corrected = answered in self.loop.gains
        return (
            known and corrected and self.loop.knows_others(answered, deadline_ns - self.period_ns)
        )

    def tick(self, periods: int, deadline_ns: int) -> None:
        """Step the device under the valid command, and publish its measurement."""
        if self._last_valid.rests(deadline_ns, self.activate):
            return
        if not self.lockstep and self._command.lapsed(self.now_ns(), self.timeout_ns):
            # Now, and not only after the missed periods have been caught up.
            self._lose("servo_cf is lost")
        self.users.drop_doubtful(self.loop, self.now_ns())
        if self._ticks or not self.lockstep:
            for known_ns, now_ns in self.steps(periods, deadline_ns):
                self._move(self._standing_command(known_ns, now_ns))
            if not self.backlog.owed:
                self._command.sampled()
        if not self.has_sample():
            self._log_end()
            return
        self._push = self.pushed(deadline_ns)
        self._publish(deadline_ns)
        self._log_end()
        self._last_valid.keep(self._state)
        self.loop.measured(self._written.sample.values, deadline_ns)
        if self._ticks % self.view_every == 0 or self._let_go_unpublished:
            self._publish_view(deadline_ns)
        self._ticks += 1

    def plainly(self, link: own.DeviceLink, commands: Array, state: Array, model: Array) -> bool:
        """Return whether a kernel can do the next steps, which then need only commands and gains.

        Args:
            link: to fill: times and counters shared with the kernel.
            commands: (2, 6) to fill: the command, and that at the last sample, N and N m.
            state: (107,) to fill: the device's state, in SI units.
            model: (108,) to fill: how commands depend on the device, a ``LocalModel``, in SI units.
        """
        gain, clock, now = self.loop.plain_gain, self.clock, self.now_ns()
        acting, before = self._command.value, self._command.before
        if gain is None or clock is None or acting is None or before is None or self.lockstep:
            return False
        posed = self._poses.goal(now) is not None
        waits = self.backlog.owed or self._last_valid.resting or self._let_go_unpublished or posed
        doubtful = self.users.drop_doubtful(self.loop, now)
        reported = self._obeyed_form is DEVICE_COMMAND and self.answers.obeys
        if waits or doubtful or not reported or self._refusal(now) or self._push is not NO_WRENCH:
            return False
        held, order = self.held, self.loop.order.last
        model[:] = gain[0]
        for row, (wrench, _) in zip(commands, (acting, before), strict=True):
            row[:] = wrench
        state[:] = self._state.flat
        link.next, link.period = clock.next_ns, self.period_ns
        link.timeout, link.fresh = plain_timeout_ns(self.timeout_ns), FRESH_NS
        port, command = link.port, self._command
        port.received, port.received_before = command.stamp_ns, command.before_ns
        link.answered, link.answered_before = acting[1], before[1]
        port.newest, port.arrived = self.answers.last
        link.done = link.missed = 0
        link.sampled = self.loop.newest_ns
        link.held = -1 if held is None else self._ticks_held
        link.gain_ns, link.remembers = gain[1], self.loop.count
        link.gain_newest, link.gain_arrived, link.gain_after = *order, self.loop.from_ns
        link.trips = 0
        # A view is due at each tick whose number is a multiple of view_every.
        link.until_view = 1 + -self._ticks % self.view_every
        return True

    def moved(
        self, link: own.DeviceLink, commands: Array, state: Array, trips: Array, code: int
    ) -> None:
        """Take over the state to which the kernel has moved the device.

        Args:
            link: as for :meth:`plainly`.
            commands: (2, 6) as for :meth:`plainly`, N and N m.
            state: (107,) as for :meth:`plainly`, in SI units.
            trips: (n,) round-trip times of samples and their answers, s.
            code: why the kernel returned.
        """
        wrenches, clock, port = commands.copy(), self.clock, link.port
        if clock is None:
            return
        self._command.put((wrenches[0], link.answered), port.received)
        before = wrenches[1], link.answered_before
        self._command.before, self._command.before_ns = before, port.received_before
        self.answers.went_on((port.newest, port.arrived), trips)
        steps = link.done
        if steps == 0:
            return
        self._state = DeviceState(state.copy())
        self._ticks_held = max(link.held, self._ticks_held)
        clock.next_ns = link.next
        clock.periods += steps
        clock.missed += link.missed
        self._ticks += steps - link.missed - (code == kernels.TO_SAY)
        self.loop.went_on(link.remembers, link.sampled)
        if code == kernels.TO_SAY:
            # Of the states before this one, only that of the kernel's last return is still known.
            self.failures.run("tick", self._publish, clock.last_deadline_ns)
        else:
            self._last_valid.keep(self._state, steps)

    def _publish(self, stamp_ns: int) -> None:
        sensed = self.device.sensed(self._push)
        reported = self.answers.round_trip, self.answers.obeys or self.lockstep
        write_device_state(self._written, self._state, sensed, stamp_ns, *reported)
        self._publish_wire.publish(self._wire.encode(self._written.values))

    def _publish_view(self, stamp_ns: int) -> None:
        self._let_go_unpublished = False
        self.node.exchange.turn.publish_views()
        pushed = self.device.sensed(self._push)
        self.publish_view(self._state, pushed, self.side.passivity, stamp_ns)

    def publish_view(
        self, state: DeviceState, pushed: Array, account: PassivityController, stamp_ns: int
    ) -> None:
        """Publish the device's views: CRTK topics, energies, commanded pose.

        Args:
            state: of the device.
            pushed: (6,) external wrench other than the hand's, as sensed, N and N m, world axes.
            account: the passivity controller with the energies.
            stamp_ns: stamp of the state, ns.
        """
        self._operating.publish(self.node.active)
        sample = _sample_of(state, pushed)
        self._view.publish(state, sample[_HAND_WRENCH], stamp_ns)
        self._view.publish_energy(account, sample, stamp_ns)
        self._poses.publish(stamp_ns)

    def _move(self, command: Array | None) -> None:
        held, ticks = self.held, self._ticks_held
        self._state = self.device.step(self._state, command, held, ticks, self._push)
        self._ticks_held += held is not None

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return whether the device renders, a sentence, and figures."""
        now, counts = self.now_ns(), self.side.envelope.counts
        fault = self._fault() or self._operating.withheld
        posed = self._poses.kind
        rendering = not fault and (bool(posed) or self._command.fresh(now, self.timeout_ns))
        doing = f"pulled to a pose by {posed}" if posed else "rendering"
        sentence = doing if rendering else f"{fault or 'no commands'}: actuators at zero"
        doubtful = self.users.fault(now)
        if rendering and doubtful:
            sentence += f", not corrected for other hands: {doubtful}"
        return (
            rendering and not doubtful,
            sentence,
            {
                **self.clock_figures(),
                "times_held": str(self.times_held),
                **self._losses.figures(),
                "fault": fault,
                "changed_by_passivity": str(self.side.passivity.changed),
                **{reason.counted_as: str(count) for reason, count in counts.items()},
                **self.answers.figures(),
                **self.users.figures(self.loop, now),
                **self.figures(now),
            },
        )

    def figures(self, now_ns: int) -> Mapping[str, str]:
        """Return the diagnostic figures of a kind of device at a time (ns)."""
        return {}

    def _standing_command(self, known_ns: int, now_ns: int) -> Array | None:
        """Return the wrench that acts over a step; None if none does, or it is stale.

        Also lets the hand take hold or go accordingly. Arguments as :meth:`steps` yields them.
        """
        fault = self._refusal(now_ns)
        if (goal := self._poses.goal(now_ns)) is not None:
            if not fault:
                return self._pull(goal)
            self._poses.end(fault)
        if self.lockstep:
            answer = self._answer_of(self.answered_ns(now_ns)) if self._ticks >= 2 else NO_WRENCH
            if fault:
                self.side.envelope.stop()
                return None
            return self._safe(answer, self.loop.to_mechanism)
        received_ns = self._command.as_of(now_ns)[1]
        fresh = now_ns - received_ns <= self.timeout_ns
        if fault:
            self._obey_no_more(fault)
            return None
        if lost := "servo_cf is lost" if not fresh else self.answers.lost(now_ns):
            self._lose(lost, None if fresh else now_ns - received_ns)
            return None
        acting, received_ns = self._command.as_of(known_ns)
        if acting is None or known_ns - received_ns > self.timeout_ns:
            return None  # a new command acts from the next step on
        command, answered_ns = acting
        if not self.answers.begin(answered_ns, now_ns):
            return None
        self.take_hold()
        corrected = self.loop.correct(command, answered_ns, now_ns)
        return self._safe(corrected, self.loop.to_mechanism)

    def take_hold(self) -> None:
        """Let the hand take hold of the device, unless it has."""
        if self.held is None:
            self.held = self._state
            self._ticks_held = 0
            self.times_held += 1

    def _pull(self, goal: pin.SE3) -> Array:
        """Return the wrench that pulls the device to a pose, made passive and within all limits."""
        self.take_hold()
        state = self._state
        wrench = self._servo.wrench(goal, state.measured_pose, state.measured_twist)
        # None: the servo's energy is the device's, not a mechanism's.
        return self._safe(wrench, None)

    def _obeys_wrenches(self, now_ns: int) -> bool:
        """Return whether servo_cf is obeyed at a time, ns."""
        return self._command.value is not None and self._command.fresh(now_ns, self.timeout_ns)

    def _end_pose(self, reason: str) -> None:
        """Let the hand go as a pose command has ended; without a reason, publish that at once."""
        if reason:
            self._warn(reason)
            self._let_go(self.now_ns())
        else:
            self.put_at_zero()

    def _answer_of(self, answered_ns: int) -> Array:
        """Return the command that answers a sample, in lockstep."""
        command = self._commands.pop(answered_ns)
        if not self.is_local:
            return command
        return self.loop.correct_in_lockstep(command, answered_ns)

    def _safe(self, command: Array, reported: float | None) -> Array:
        """Return a command made passive and within all limits; ``reported``: E_m, J, if known."""
        state = self._state
        added = self.device.compensation(state)
        return self.side.allow(command, self._sample(), state.applied, reported, added)

    def _sample(self) -> Array:
        """Return the device's present sample (19,)."""
        return _sample_of(self._state, self.device.sensed(self._push))

    def _lose(self, what: str, silence_ns: int | None = None) -> None:
        """Stop obeying because an input is lost, and log what explains it; see ``Losses``."""
        now = self.now_ns()

        def explained() -> str:
            return self._losses.explained(silence_ns, self.timeout_ns, now)

        self._obey_no_more(what, explained)

    def _obey_no_more(self, reason: str, why: Callable[[], str] = lambda: "") -> None:
        """Stop obeying; :meth:`_log_end` logs that."""
        now = self.now_ns()
        if self.answers.obeys:
            self._unlogged = lambda: self._warn(reason, why())
            self._let_go(now)
        else:
            self.answers.let_go(now)

    def _let_go(self, now_ns: int) -> None:
        """Let the hand go; the next command begins anew."""
        self.held = None
        self._let_go_unpublished = True
        self.answers.let_go(now_ns)
        self.side.begin()

    def put_at_zero(self) -> None:
        """Set the actuators to zero, and publish that at once rather than with the next sample.

        The hand lets go; in lockstep it remains held for the whole run.
        """
        self._command.clear()
        self._poses.forget()
        if self.lockstep:
            self.side.envelope.stop()
        else:
            self._let_go(self.now_ns())
        self._state = self._state.without_force()
        if self.clock is None or not self.node.active or not self.has_sample():
            return
        # A stamp after the last sample and before the next.
        now = self.now_ns()
        stamp_ns = nearest_stamp(min(now, max(self.clock.next_ns - 1, now - self.period_ns)))
        if not self.lockstep:
            self._publish(stamp_ns)
        self._publish_view(stamp_ns)
        self.node.exchange.publish_kept()

    def _log_end(self) -> None:
        """Log why obeying has ended, if it has: after the sample, since it takes as long."""
        log, self._unlogged = self._unlogged, None
        if log is not None:
            log()

    def _warn(self, reason: str, why: str = "") -> None:
        """Log why the actuators are at zero; the same reason once in LOG_PERIOD_NS."""
        now = time.monotonic_ns()
        last, logged_ns, left_out = self._warned
        if reason == last and now - logged_ns < LOG_PERIOD_NS:
            self._warned = last, logged_ns, left_out + 1
            return
        more = f"; {last}, {left_out} times more" if left_out else ""
        self._warned = reason, now, 0
        self.node.get_logger().warning(f"{reason}: actuators at zero{why and f' ({why})'}{more}")

    def _on_own_axes(self, message: Bool, now_ns: int) -> None:
        del now_ns
        self._own_is_absolute = message.data

    def _on_own_command(self, wrench: Array, stamp_ns: int, now_ns: int) -> None:
        """Obey a wrench of body/servo_cf, in the device's present axes or in world's."""
        if not self._own_is_absolute:
            wrench = turned(wrench, np.asarray(self._state.measured_pose.rotation))
        self._obey(DEVICE_BODY_COMMAND, wrench, stamp_ns, now_ns)

    def _on_command(self, wrench: Array, stamp_ns: int, now_ns: int) -> None:
        self._obey(DEVICE_COMMAND, wrench, stamp_ns, now_ns)

    def _obey(self, form: Topic, wrench: Array, stamp_ns: int, now_ns: int) -> None:
        """Obey a wrench (6,), N and N m, world axes, received on a topic.

        Raises:
            InvalidInputError: wrenches of another topic, or poses of servo_cp, are obeyed.
        """
        if form is not self._obeyed_form:
            if self._obeys_wrenches(now_ns):
                what = f"while {self._obeyed_form.name} is obeyed"
                raise InvalidInputError(form.name, what, ONE_KIND)
            self._obeyed_form = form
        self.ages.add(now_ns - stamp_ns)
        self._look_at_fault(now_ns)
        self._poses.give_way(now_ns)
        if self.lockstep:
            self._commands[stamp_ns] = wrench
        elif not self.answers.is_next(stamp_ns, now_ns):
            self._command.renew(now_ns)  # the controller is alive, but a newer command is obeyed
            return
        self._command.put((wrench, stamp_ns), now_ns)
        if self.lockstep:
            self.act(now_ns)

    def _on_gain(self, values: Array, now_ns: int) -> None:
        self._look_at_fault(now_ns)
        # A gain taken during a fault is discarded with the next tick.
        self.loop.take(values, now_ns, self.lockstep, self.age_limit_ns)
        if self.lockstep:
            self.act(now_ns)

    def _refusal(self, now_ns: int) -> str:
        """Return why no command is obeyed, a fault or a request; empty if commands are."""
        deaf = DEAF if self.node.exchange.turn.is_deaf else ""
        withheld = self._operating.withheld
        return self._guard.fault(now_ns) or self.unavailable() or withheld or deaf

    def _fault(self) -> str:
        """Return the fault for which no command may be obeyed; empty if there is none."""
        resting = self._last_valid.resting
        failed = f"restarting after an error: {self.failures.last}" if resting else ""
        return self._guard.fault(self.now_ns()) or self.unavailable() or failed

    def _look_at_fault(self, now_ns: int) -> None:
        """Set the actuators to zero, and log why, if commands are obeyed but must be refused."""
        fault = self._refusal(now_ns)
        if fault and self.answers.obeys:
            self._warn(fault)
            self.put_at_zero()

    def _on_stop(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Set or release the emergency stop; respond once actuators at zero were published."""
        # First, so that the stop holds whatever fails afterwards.
        self._guard.stopped = request.data
        done = "actuators at zero" if request.data else "commands are obeyed again"
        return self.failures.answer(EMERGENCY_STOP, self._look_at_refusal, response, done)

    def _look_at_refusal(self) -> None:
        """Set the actuators to zero, and log why, if a stop was requested."""
        reason = STOPPED if self._guard.stopped else self._operating.withheld
        if reason:
            self._log_end()
            self.put_at_zero()
            # Logged with the next sample: the response does not wait for it.
            self._unlogged = partial(self._warn, reason)
            if not self.node.active:
                self._log_end()
        self._operating.publish(self.node.active)

    def _start_pose(self) -> pin.SE3:
        """Return the pose assumed before the first measurement: that of the point held."""
        simulator = Simulator(self.scene)
        terms = simulator.evaluate(simulator.initial_state())
        return terms.points[simulator.mechanism.point_index(self.point)].pose
