# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A controller's inputs from its device, and its outputs.

Order, age and delay of samples; samples of CRTK only. Commands to both sides, how they depend on
the hands' wrenches, and their account.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.control import DeviceMeasurement
from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.loop_delay import DelayFollower, admissible_round_trip, made_for
from hapticmech_ros.control.measurements import flat_device
from hapticmech_ros.control.rendering_controller import ControllerCommand
from hapticmech_ros.device.state import NO_WRENCH
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.nodes.exchange import Outlet
from hapticmech_ros.nodes.inputs import NEVER, InOrder, Latest, SampleAge
from hapticmech_ros.nodes.messages import (
    CONTROL_SUBSCRIBER,
    check_age,
    checked_stamp,
    read_framed_pose,
    read_twist,
    read_wrench,
    wrench_message,
)
from hapticmech_ros.nodes.parameters import ControllerParameters
from hapticmech_ros.nodes.sources import Sources
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import ControllerEnergies
from hapticmech_ros.numerics.quaternions import turned
from hapticmech_ros.numerics.times import NANOSECONDS, nanoseconds
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.controller import Controller
from hapticmech_ros.wire.bounds import SixBounds, message_bounds
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.layouts import CouplingMatrices, CouplingWire
from hapticmech_ros.wire.messages import ControllerEnergy, DeviceStateMessage, LocalFeedbackGain
from hapticmech_ros.wire.stamped import nearest_stamp
from hapticmech_ros.wire.topics import (
    CHANNEL_PART,
    CONSTRAINT_PART,
    CONTROLLER_ENERGY,
    DEVICE_BODY_COMMAND,
    DEVICE_BODY_FORCE,
    DEVICE_COMMAND,
    DEVICE_COUPLING,
    DEVICE_FORCE,
    DEVICE_GAIN,
    DEVICE_POSE,
    DEVICE_TWIST,
    HAND_FORCE,
    IMPEDANCE_PART,
    POINT_COMMAND,
)
from hapticmech_ros.wire.wrench import encode_wrench

if TYPE_CHECKING:
    from hapticmech_ros.device.real_device import HandObserver, TwistEstimate

PERIOD_S = 1.0
_PERIOD_NS = round(PERIOD_S * NANOSECONDS)


class EngagementLog:
    """Logs when a controller engages and disengages.

    On a machine that stalls, rendering ends and resumes many times a second. Inputs that are lost
    within a second of the last logged are counted, and logged by :meth:`report_counts`.

    Args:
        logger: returns the node's.
        now_ns: returns the time, ns.
    """

    def __init__(self, logger: Callable[[], Any], now_ns: Callable[[], int]) -> None:
        self._logger, self._now_ns = logger, now_ns
        self._logged_ns: int | None = None
        self._unlogged, self._explained, self._reason, self._engaged = 0, 0, "", False

    def engaged(self, explanation: str = "") -> None:
        """Log that the controller is engaged, unless losses are still to be logged.

        Args:
            explanation: of the last loss, if that has become known since; else empty.
        """
        self._engaged = True
        if not self._unlogged:
            self._logger().info(f"engaged: {explanation}" if explanation else "engaged")
        elif explanation:
            self._explained, self._reason = self._explained + 1, f"{self._reason}: {explanation}"

    def lost(self, reason: str, explanation: str = "") -> None:
        """Log that the controller is disengaged because of inputs, now or later.

        Args:
            reason: the lost inputs.
            explanation: the pause of a process that explains it, if one is known; else empty.
        """
        self._engaged, now = False, self._now_ns()
        if explanation:
            reason = f"{reason}: {explanation}"
        if self._logged_ns is not None and now - self._logged_ns < _PERIOD_NS:
            self._unlogged, self._reason = self._unlogged + 1, reason
            self._explained += bool(explanation)
            return
        self._logged_ns = now
        self._logger().warning(f"disengaged: {reason}")

    def fault(self, reason: str) -> None:
        """Log that the controller is disengaged because it must not render."""
        self._engaged = False
        self._logger().warning(f"disengaged: {reason}")

    def stopped(self, reason: str) -> None:
        """Log that the controller is disengaged on request."""
        self._engaged = False
        self._logger().info(f"disengaged: {reason}")

    def has_counts(self) -> bool:
        """Return whether there are counts that are not logged yet."""
        return bool(self._unlogged)

    def report_counts(self) -> None:
        """Log the counts not logged yet; to be called once in ``PERIOD_S``."""
        if not self.has_counts():
            return
        state = "engaged" if self._engaged else "disengaged"
        times = f"{self._unlogged} more time{'s' * (self._unlogged > 1)}"
        if self._explained:
            times += f" ({self._explained} because a process paused)"
        self._logger().warning(f"disengaged {times}, the last: {self._reason}; now {state}")
        self._unlogged, self._explained, self._logged_ns = 0, 0, self._now_ns()


# A gain lapses after five times as long, and gains show who sends them.
LONGEST_WITHOUT_GAIN_NS = NANOSECONDS // 50


class ControllerOutputs:
    """A controller's topics.

    Args:
        actor: the controller.
        axes: returns the device's axes in the world (3, 3), for drivers that are commanded in them;
            None where they are not known: nothing is then published in them.

    Attributes:
        answers: commands sent to the device.
        to_device, to_point, to_gain: publishers of these, of those to the mechanism, and of how
            they depend on the device.
        gain_from_ns: stamp, ns, from which the latter is due.
    """

    def __init__(self, actor: Actor[Any], axes: Callable[[], Array | None]) -> None:
        self._actor, self._axes = actor, axes
        self._gain = FlatArray(
            LocalFeedbackGain.layout, message_bounds(LocalFeedbackGain, actor.limits)
        )
        self._energy = FlatArray(ControllerEnergy.layout)
        self.to_device = actor.output(DEVICE_COMMAND, WrenchStamped)
        self._publish_own: Outlet | None = None
        if actor.scene.device.servo_axes == "body":
            self._publish_own = actor.output(DEVICE_BODY_COMMAND, WrenchStamped)
        self.to_gain = actor.output(DEVICE_GAIN, Float64MultiArray)
        # Of the hands whose wrenches the device gets at once; None if it gets none.
        self._coupling = CouplingWire(actor.other_points, actor.limits)
        self._publish_coupling: Outlet | None = None
        if actor.other_points:
            self._publish_coupling = actor.output(DEVICE_COUPLING, Float64MultiArray)
        self._publish_energy = actor.view(CONTROLLER_ENERGY, Float64MultiArray)
        self.to_point = actor.output(POINT_COMMAND, WrenchStamped)
        self._publish_parts = [
            actor.view(topic, WrenchStamped)
            for topic in (IMPEDANCE_PART, CONSTRAINT_PART, CHANNEL_PART)
        ]
        self.answers = 0
        self.gain_from_ns = NEVER

    @property
    def gain_every_ns(self) -> int:
        """How long after a gain, ns, the next one is due: at view rate, at least at 50 Hz."""
        # Less half a period: samples are not evenly apart.
        every_ns = nanoseconds((self._actor.view_every - 0.5) * self._actor.period_s)
        return min(every_ns, LONGEST_WITHOUT_GAIN_NS)

    def wants_gain(self, stamp_ns: int) -> bool:
        """Return whether ``local_feedback_gain`` is due."""
        return self._actor.lockstep or stamp_ns >= self.gain_from_ns

    @property
    def until_view(self) -> int:
        """After how many more answers parts and energies are due; 0: no subscriber."""
        if not any(one.wanted for one in (*self._publish_parts, self._publish_energy)):
            return 0
        return 1 + -self.answers % self._actor.view_every

    @property
    def couple(self) -> bool:
        """Whether anybody receives how answers depend on other hands."""
        return self._publish_coupling is not None and self._publish_coupling.wanted

    @property
    def are_plain(self) -> bool:
        """Whether an answer is two commands, and nothing in the device's own axes."""
        return self._publish_own is None

    def gain(self, answer: ControllerCommand, stamp_ns: int) -> None:
        """Publish how an answer depends on the device."""
        self.gain_from_ns, numbers = stamp_ns + self.gain_every_ns, answer.numbers
        published = LocalFeedbackGain.answering(
            stamp_ns, answer.answered_ns, numbers.to_mechanism, numbers.model.values
        )
        self.to_gain.publish(self._gain.encode(published.values))

    def coupling(self, gains: Mapping[str, Array], stamp_ns: int) -> None:
        """Publish how an answer depends on the other hands.

        Args:
            gains: H_j (6, 6) by point; 1, m and 1/m, world axes.
            stamp_ns: of the sample that is answered.
        """
        if self._publish_coupling is not None:
            published = CouplingMatrices(stamp_ns, gains)
            self._publish_coupling.publish(self._coupling.encode(published))

    def device(self, wrench: Array, stamp_ns: int) -> None:
        """Publish the device's command.

        Args:
            wrench: (6,) N and N m, world axes at the point held.
            stamp_ns: of the sample that is answered.
        """
        self.to_device.publish(encode_wrench(wrench, stamp_ns, self._actor.wrenches))
        self._own(wrench, stamp_ns)

    def _own(self, wrench: Array, stamp_ns: int) -> None:
        """Publish the same in the device's own axes, to a driver that is commanded in them."""
        axes = None if self._publish_own is None else self._axes()
        if self._publish_own is not None and axes is not None:
            self._publish_own.publish(wrench_message(turned(wrench, axes.T), stamp_ns, frame=""))

    def view(self, wrenches: Array, stamp_ns: int, energies: ControllerEnergies) -> None:
        """Publish, at view rate, the parts of an answer (6, 6), rows 2 to 4, and energies.

        Args:
            wrenches: (6, 6) world axes, rows as in :class:`ControlOutput`; N, N m; the last m, rad.
            stamp_ns: of the sample that is answered.
            energies: of the controllers.
        """
        if self.answers % self._actor.view_every == 0:
            self._actor.node.exchange.turn.publish_views()
            self.publish_view(wrenches, stamp_ns, energies)
        self.answers += 1

    def publish_view(self, wrenches: Array, stamp_ns: int, energies: ControllerEnergies) -> None:
        """Publish the parts of an answer, and energies, now.

        Args:
            wrenches: (6, 6) as of :meth:`view`.
            stamp_ns: of the sample that is answered.
            energies: of the controllers.
        """
        for outlet, wrench in zip(self._publish_parts, wrenches[2:5], strict=True):
            outlet.offer(encode_wrench, wrench, stamp_ns)
        if self._publish_energy.wanted:
            message = ControllerEnergy.of(stamp_ns, energies=energies.values)
            self._publish_energy.publish(self._energy.encode(message.values))

    def mechanism(self, wrench: Array, stamp_ns: int) -> None:
        """Publish the mechanism's command.

        Args:
            wrench: (6,) N and N m, world axes at the operational point.
            stamp_ns: of the device's sample; over a network, of the operational model.
        """
        self.to_point.publish(encode_wrench(wrench, stamp_ns, self._actor.wrenches))

    def zero(self, device_ns: int, mechanism_ns: int) -> None:
        """Command zero to both sides, each by its own clock (ns), after the last command."""
        self.gain_from_ns = NEVER
        for outlet, time_ns in (
            (self.to_device, device_ns),
            (self.to_point, mechanism_ns),
        ):
            outlet.publish(encode_wrench(NO_WRENCH, nearest_stamp(time_ns)))
        self._own(NO_WRENCH, nearest_stamp(device_ns))


# Samples that have waited are passed over for no longer than this share of the timeout.
LATE_SHARE = 4


class CrtkDevice:
    """Makes a sample with each measured_cp, from that and the driver's other topics.

    Without measured_cv the twist is that of the poses. By the scene's ``force_sensor`` the hand's
    wrench is received on ``hand/measured_cf``; estimated from the motion and the wrench of the
    actuators, which is measured_cf, or else their command; or zero.

    Args:
        actor: that listens.
        bounds: of a twist.
        timeout_ns: returns how long twist and wrenches are valid, ns.
        watch: returns the ``Sources`` that distinguish a topic's publishers.
        wanted: whether samples are wanted at a time, ns.
        answer: called with each sample (19,), its stamp and the time, ns.
        lost: called with the topics that are not fresh, instead.
        commanded: returns the wrench (6,) that was commanded last, N and N m, world axes.

    Attributes:
        streams: the topics, by their names on the lane, and the sources of each.
    """

    def __init__(
        self,
        actor: Actor[ControllerParameters],
        bounds: SixBounds,
        timeout_ns: Callable[[], int],
        watch: Callable[[str], Sources],
        wanted: Callable[[int], bool],
        answer: Callable[[Array, int, int], None],
        lost: Callable[[Sequence[str]], None],
        commanded: Callable[[], Array],
    ) -> None:
        self._actor, self._bounds, self._timeout_ns, self._watch = actor, bounds, timeout_ns, watch
        self._wanted, self._answer, self._lost, self._commanded = wanted, answer, lost, commanded
        self._sensor = actor.scene.device.force_sensor
        self.streams: list[tuple[str, Sources]] = []
        self.forget()
        if self._sensor == "measured":
            self._listen(HAND_FORCE.name, WrenchStamped, self._on_hand)
        self._in_own_axes = actor.scene.device.servo_axes == "body"
        force = DEVICE_BODY_FORCE if self._in_own_axes else DEVICE_FORCE
        self._listen(force.name, WrenchStamped, self._on_force)
        self._listen(DEVICE_TWIST.name, TwistStamped, self._on_twist)

    def listen(self) -> None:
        """Subscribe to measured_cp, which comes last of a sample's messages."""
        self._listen(DEVICE_POSE.name, PoseStamped, self._on_pose)

    def _listen(self, name: str, kind: Any, accept: Callable[[Any, int], None]) -> None:
        sources = self._watch(name)

        def receive(message: Any, now_ns: int) -> None:
            try:
                self._check_frame(name, message.header.frame_id)
                accept(message, now_ns)
            except InvalidInputError as error:
                self._refusals[name] = str(error), now_ns
                raise

        self.streams.append((self._actor.lane_topic(name, kind), sources))
        self._actor.input_stream(name, kind, CONTROL_SUBSCRIBER, receive, sources, self._wanted)

    def _check_frame(self, name: str, frame: str) -> None:
        """Refuse a message in undeclared axes.

        Raises:
            InvalidInputError: with the remedy.
        """
        declared = self._actor.parameters.device_frame
        if frame == declared or name == DEVICE_BODY_FORCE.name:
            # Wrenches in the device's own axes may have any name of its frame.
            return
        rule = f"must be '{declared}'; if its axes are the world's, let device_frame be '{frame}'"
        if frame.strip("/") == declared:
            rule = f"must be '{declared}', without the slash of tf's old spelling"
        raise InvalidInputError("frame_id", frame, rule)

    def forget(self) -> None:
        """Wait for all anew."""
        self._twist: Latest[Array] = Latest()
        self._hand: Latest[Array] = Latest()
        self._force: Latest[Array] = Latest()
        self._pose: Latest[pin.SE3] = Latest()
        self._epoch_ns = self._stamp_ns = self._answered_ns = 0
        self._age = SampleAge()
        self._refusals: dict[str, tuple[str, int]] = {}
        # Made on access.
        self.__dict__.pop("_observer", None)
        self.__dict__.pop("_moving", None)

    @cached_property
    def _observer(self) -> HandObserver:
        # Imported here: the controllers of most devices load no kernels of it.
        from hapticmech_ros.device.real_device import HandObserver

        scene = self._actor.scene
        return HandObserver(scene.device, scene.task_space == "planar")

    @cached_property
    def _moving(self) -> TwistEstimate:
        from hapticmech_ros.device.real_device import TwistEstimate

        return TwistEstimate(self._actor.scene.device.velocity_filter)

    def lacking(self, now_ns: int) -> list[str]:
        """Return the full names of the topics that a driver with fresh poses lacks.

        Args:
            now_ns: present time, ns.
        """
        limit_ns = self._timeout_ns()
        if not self._pose.fresh(now_ns, limit_ns):
            refused = self._refused(DEVICE_POSE.name, now_ns)
            return [self._named(DEVICE_POSE.name) + refused] if refused else []
        needed = [(HAND_FORCE, self._hand)] if self._sensor == "measured" else []
        if self._twist.value is not None:
            needed.append((DEVICE_TWIST, self._twist))
        return [
            self._named(topic.name) + self._refused(topic.name, now_ns)
            for topic, held in needed
            if not held.fresh(now_ns, limit_ns)
        ]

    def _named(self, name: str) -> str:
        """Return a topic's full name."""
        return str(self._actor.node.resolve_topic_name(name))

    def _refused(self, name: str, now_ns: int) -> str:
        """Return, in parentheses, why messages of a topic were refused lately; nothing if not."""
        why, refused_ns = self._refusals.get(name, ("", NEVER))
        return f" (refused: {why})" if now_ns - refused_ns < NANOSECONDS else ""

    def _stamp(self, message: Any, now_ns: int) -> int:
        limit_ns = self._actor.age_limit_ns
        return checked_stamp(message.header, now_ns, limit_ns, unstamped_is_now=False)

    def _on_pose(self, message: PoseStamped, now_ns: int) -> None:
        stamp = self._stamp(message, now_ns)
        pose = read_framed_pose(message, self._actor.limits)
        self._pose.put(pose, now_ns)
        since_ns, self._stamp_ns = stamp - self._stamp_ns, stamp
        late = 0 < since_ns < self._age.beyond(stamp)
        if late and now_ns - self._answered_ns < self._timeout_ns() // LATE_SHARE:
            # The next one is here already. Answers to one after the other would stay that late.
            return
        self._answered_ns = now_ns
        self._epoch_ns = self._epoch_ns or stamp
        time = (stamp - self._epoch_ns) / NANOSECONDS
        twist = self._moving.at(time, pose) if self._twist.value is None else self._twist.value
        if lost := self.lacking(now_ns):
            self._lost(lost)
            return
        hand = self._hand_wrench(time, twist, now_ns)
        self._answer(flat_device(DeviceMeasurement(pose, twist, hand)), stamp, now_ns)

    def _hand_wrench(self, time: float, twist: Array, now_ns: int) -> Array:
        if self._sensor == "absent":
            return np.zeros(6)
        if self._hand.value is not None:
            return self._hand.value
        known = self._force.fresh(now_ns, self._timeout_ns()) and self._force.value is not None
        applied = self._force.value if known else self._commanded()
        return self._observer.at(time, twist, np.zeros(6) if applied is None else applied)

    def _on_hand(self, message: WrenchStamped, now_ns: int) -> None:
        self._stamp(message, now_ns)
        wrench = read_wrench(message, self._actor.wrenches, message.header.frame_id)
        self._hand.put(wrench, now_ns)

    def _on_force(self, message: WrenchStamped, now_ns: int) -> None:
        self._stamp(message, now_ns)
        wrench = read_wrench(message, self._actor.wrenches, message.header.frame_id)
        if not self._in_own_axes:
            self._force.put(wrench, now_ns)
            return
        axes = self.rotation
        if axes is not None:
            self._force.put(turned(wrench, axes), now_ns)

    @property
    def rotation(self) -> Array | None:
        """Axes of the device's last pose in the world (3, 3); None before the first."""
        pose = self._pose.value
        return None if pose is None else np.asarray(pose.rotation)

    def _on_twist(self, message: TwistStamped, now_ns: int) -> None:
        self._stamp(message, now_ns)
        self._twist.put(read_twist(message, self._bounds, message.header.frame_id), now_ns)


class DevicePath(InOrder):
    """A controller's state of the path to its device.

    Over a declared network, samples are answered when the analysis comes, at even times: a bunch of
    samples gets one answer, for its newest, and the mechanism gets a command every period. A
    simulated connection works alike.

    Args:
        scene: whose connection and device.
        log: called when gains change to those for another delay.

    Attributes:
        round_trip: s, from the device's samples to their answers, by its report; 0: not known.
        paced: whether samples are answered when the analysis comes.
        obeyed: whether the device obeyed when it took its last sample; a driver without that report
            counts as obeying.
    """

    def __init__(self, scene: Scene, log: Callable[[str], object]) -> None:
        super().__init__()
        self.round_trip = 0.0
        self.obeyed = True
        self.paced = scene.connection.networked
        self._scene, self._log = scene, log
        self._follower = DelayFollower(scene.connection)
        self._logged_delay = scene.connection.designed
        self._age = SampleAge()
        self._sample: tuple[Array, int] | None = None
        self._turn_ns = NEVER

    def received(self, reading: DeviceStateMessage, now_ns: int, limit_ns: int) -> bool:
        """Return whether a sample is no older than those before it, and store its report.

        Raises:
            InvalidInputError: it is older than ``limit_ns``.
        """
        if not self.paced:
            check_age(reading.stamp_ns, now_ns, limit_ns)
        if not self.is_next(reading.stamp_ns, now_ns):
            return False
        if self.paced:
            self._age.check(reading.stamp_ns, limit_ns)
        self.round_trip, self.obeyed = reading.round_trip, reading.obeys
        return True

    def changed(self, time: float) -> bool:
        """Return whether gains are to be made for another delay from a time (s) on."""
        return self.round_trip > 0.0 and self._follower.follow(self.round_trip, time)

    @property
    def is_settled(self) -> bool:
        """Whether further samples with the same round trip change nothing."""
        return self.round_trip <= 0.0 or self._follower.is_settled(self.round_trip)

    @property
    def round_trips(self) -> tuple[float, float]:
        """The round trip as it was reported last, and up to which another changes nothing, s."""
        tolerated = self._follower.tolerated
        alike = self.round_trip <= tolerated and self._follower.is_settled(tolerated)
        return self.round_trip, tolerated if alike else 0.0

    def tune(
        self, control: ControlArchitecture, gains: Controller, soften: bool, time: float | None
    ) -> None:
        """Change gains to those for the present delay.

        Args:
            control: whose gains.
            gains: by the parameters.
            soften: whether they are made for the measured delay, if above the declared one.
            time: s, of the gain ramp; None sets them at once.
        """
        if time is not None and self._follower.delay != self._logged_delay:
            self._logged_delay = self._follower.delay
            short = f"gains are set for a one-way delay of {1e3 * self._logged_delay:.0f} ms again"
            self._log(self.warning(gains, soften) or short)
        delay = self._follower.delay if soften else self._scene.connection.designed
        if delay != self._scene.connection.designed:
            period = self._scene.simulation.period
            gains = made_for(gains, self._scene.device, period, delay)
        if time is None:
            control.apply_gains(gains, delay)
        elif (gains, delay) != control.aim:
            control.tune(time, gains, delay)

    def warning(self, gains: Controller, soften: bool) -> str:
        """Return a warning that the path is too slow for gains; empty if it is not.

        Args:
            gains: by the parameters.
            soften: whether they are made for the measured delay.
        """
        if not self._follower.exceeded(self.round_trip):
            return ""
        device, designed = self._scene.device, 2.0 * self._scene.connection.designed
        inertia = np.array(device.inertias)
        admissible = admissible_round_trip(gains, inertia, self._scene.simulation.period)
        admissible = max(admissible, designed)
        if self.round_trip <= admissible:
            return ""
        done = "gains are not reduced (parameter soften)"
        if soften:
            done = f"gains are reduced for a one-way delay of {1e3 * self._follower.delay:.0f} ms"
        return (
            f"the round trip to the device takes {1e3 * self.round_trip:.0f} ms instead of the "
            f"declared {1e3 * designed:.0f} ms, and gains allow {1e3 * admissible:.0f} ms: {done}; "
            "set network_delay to the one-way delay on all nodes"
        )

    def put(self, sample: Array, stamp_ns: int) -> None:
        """Keep a sample (19,) until the analysis comes.

        Args:
            sample: (19,) of the device, in SI units; see ``layout.DeviceSample``.
            stamp_ns: its stamp, ns.
        """
        self._sample = sample, stamp_ns

    def take(self) -> tuple[Array, int] | None:
        """Return the newest sample (19,) and its answer's stamp, ns.

        That is its own stamp the first time; answers that follow are later by a nanosecond each, as
        far as this leaves the microsecond.
        """
        found = self._sample
        if found is not None and (found[1] + 1) % 1000:
            self._sample = found[0], found[1] + 1
        return found

    def turn(self, now_ns: int) -> int:
        """Return how long (ns) it is since the analysis came last, and note that it comes now."""
        before, self._turn_ns = self._turn_ns, now_ns
        return now_ns - before

    def restart(self) -> None:
        """Wait for samples anew: earlier ones do not count any more."""
        self.forget()
        self._sample, self._turn_ns, self.obeyed = None, NEVER, True

    def figures(self, gains: Controller, soften: bool, loop_warning: str) -> dict[str, str]:
        """Return entries for diagnostics; arguments as of :meth:`warning`, and the scene's."""
        return {
            "loop_warning": self.warning(gains, soften) or loop_warning,
            "round_trip_ms": f"{1e3 * self.round_trip:.1f}",
            "designed_delay_ms": f"{1e3 * self._scene.connection.designed:.1f}",
            "softened_for_ms": f"{1e3 * self._follower.delay if soften else 0.0:.1f}",
            "overtaken_samples": str(self.overtaken),
        }
