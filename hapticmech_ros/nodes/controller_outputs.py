# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the controller publishes: commands to both sides, how they depend, and their account."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.rendering_controller import ControllerCommand, LedgerEntry
from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.nodes.exchange import Outlet
from hapticmech_ros.nodes.inputs import NEVER
from hapticmech_ros.nodes.messages import write_wrench
from hapticmech_ros.quaternions import turned
from hapticmech_ros.times import NANOSECONDS, nanoseconds
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.layouts import (
    CONTROLLER_ENERGY_FIELDS,
    GAIN_FIELDS,
    CouplingMatrices,
    CouplingWire,
    LocalFeedbackGain,
    gain_bounds,
    pack_controller_energy,
    pack_gain,
)
from hapticmech_ros.wire.stamped import nearest_stamp
from hapticmech_ros.wire.topics import (
    CHANNEL_PART,
    CONSTRAINT_PART,
    CONTROLLER_ENERGY,
    DEVICE_BODY_COMMAND,
    DEVICE_COMMAND,
    DEVICE_COUPLING,
    DEVICE_GAIN,
    IMPEDANCE_PART,
    POINT_COMMAND,
)
from hapticmech_ros.wire.wrench import encode_wrench

PERIOD_S = 1.0
_PERIOD_NS = round(PERIOD_S * NANOSECONDS)


class EngagementLog:
    """Says when a controller engages and disengages.

    On a machine that stalls, rendering ends and resumes many times a second. Inputs that are lost
    within a second of the last that was said are counted, and told by :meth:`tell`.

    Args:
        logger: returns the node's.
        now_ns: returns the time, ns.
    """

    def __init__(self, logger: Callable[[], Any], now_ns: Callable[[], int]) -> None:
        self._logger, self._now_ns = logger, now_ns
        self._said_ns: int | None = None
        self._untold, self._explained, self._reason, self._engaged = 0, 0, "", False

    def engaged(self, explanation: str = "") -> None:
        """Say that the controller is engaged, unless it is told later why it was not.

        Args:
            explanation: what explains the last loss, if that has become known since; else empty.
        """
        self._engaged = True
        if not self._untold:
            self._logger().info(f"engaged: {explanation}" if explanation else "engaged")
        elif explanation:
            self._explained, self._reason = self._explained + 1, f"{self._reason}: {explanation}"

    def lost(self, reason: str, explanation: str = "") -> None:
        """Say that the controller is disengaged because of inputs, now or later.

        Args:
            reason: what is lost.
            explanation: the pause of a process that explains it, if one is known; else empty.
        """
        self._engaged, now = False, self._now_ns()
        if explanation:
            reason = f"{reason}: {explanation}"
        if self._said_ns is not None and now - self._said_ns < _PERIOD_NS:
            self._untold, self._reason = self._untold + 1, reason
            self._explained += bool(explanation)
            return
        self._said_ns = now
        self._logger().warning(f"disengaged: {reason}")

    def fault(self, reason: str) -> None:
        """Say that the controller is disengaged because it must not render."""
        self._engaged = False
        self._logger().warning(f"disengaged: {reason}")

    def stopped(self, reason: str) -> None:
        """Say that the controller is disengaged because somebody wants it so."""
        self._engaged = False
        self._logger().info(f"disengaged: {reason}")

    def tell(self) -> None:
        """Say what has not been said; to be called once in ``PERIOD_S``."""
        if not self._untold:
            return
        state = "engaged" if self._engaged else "disengaged"
        times = f"{self._untold} more time{'s' * (self._untold > 1)}"
        if self._explained:
            times += f" ({self._explained} by pauses of a process)"
        self._logger().warning(f"disengaged {times}, the last: {self._reason}; now {state}")
        self._untold, self._explained, self._said_ns = 0, 0, self._now_ns()


NO_WRENCH = np.zeros(6)
# A gain lapses after five times as long, and who sends gains is known by them.
LONGEST_WITHOUT_GAIN_NS = NANOSECONDS // 50


class ControllerOutputs:
    """A controller's topics.

    Args:
        actor: the controller.
        axes: returns the device's axes in the world (3, 3), for drivers that are commanded in them;
            None where they are not known, and nothing is then said in them.

    Attributes:
        answers: commands sent to the device.
        to_device, to_point: what these, and those to the mechanism, are published through.
    """

    def __init__(self, actor: Actor[Any], axes: Callable[[], Array | None]) -> None:
        self._actor, self._axes = actor, axes
        self._gain = FlatArray(GAIN_FIELDS, gain_bounds(actor.limits))
        self._energy = FlatArray(CONTROLLER_ENERGY_FIELDS)
        self.to_device = actor.output(DEVICE_COMMAND, WrenchStamped)
        self._publish_own: Outlet | None = None
        if actor.scene.device.servo_axes == "body":
            self._publish_own = actor.output(DEVICE_BODY_COMMAND, WrenchStamped)
        self._publish_gain = actor.output(DEVICE_GAIN, Float64MultiArray)
        # Of the hands whose wrenches the device gets at once; None if it gets none.
        self._coupling = CouplingWire(actor.other_points, actor.limits)
        self._coupling_encoder = FlatArray(self._coupling.fields, self._coupling.bounds)
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
        self._gain_ns = NEVER

    @property
    def gain_from_ns(self) -> int:
        """From which stamp on, ns, a gain is due: at view rate, at least at 50 Hz."""
        # Less half a period: samples are not evenly apart.
        every_ns = nanoseconds((self._actor.view_every - 0.5) * self._actor.period_s)
        return self._gain_ns + min(every_ns, LONGEST_WITHOUT_GAIN_NS)

    def wants_gain(self, stamp_ns: int) -> bool:
        """Return whether ``local_feedback_gain`` is due."""
        return self._actor.lockstep or stamp_ns >= self.gain_from_ns

    @property
    def until_view(self) -> int:
        """After how many more answers parts and energies are due; 0: nobody wants them."""
        if not any(one.wanted for one in (*self._publish_parts, self._publish_energy)):
            return 0
        return 1 + -self.answers % self._actor.view_every

    @property
    def are_plain(self) -> bool:
        """Whether an answer is two commands, and nothing in the device's own axes."""
        return self._publish_own is None

    def gain(self, answer: ControllerCommand, stamp_ns: int) -> None:
        """Publish how an answer depends on the device."""
        self._gain_ns = stamp_ns
        told = LocalFeedbackGain(stamp_ns, answer.answered_ns, answer.to_mechanism, answer.model)
        self._publish_gain.publish(self._gain.encode(pack_gain(told)))

    def coupling(self, gains: Mapping[str, Array], stamp_ns: int) -> None:
        """Publish how an answer depends on the other hands.

        Args:
            gains: H_j (6, 6) by point; 1, m and 1/m, world axes.
            stamp_ns: of the sample that is answered.
        """
        if self._publish_coupling is not None:
            told = self._coupling.pack(CouplingMatrices(stamp_ns, gains))
            self._publish_coupling.publish(self._coupling_encoder.encode(told))

    def device(self, wrench: Array, stamp_ns: int) -> None:
        """Publish what the device is commanded.

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
            message = WrenchStamped()
            write_wrench(message, turned(wrench, axes.T), stamp_ns)
            message.header.frame_id = ""
            self._publish_own.publish(message)

    def view(self, wrenches: Array, stamp_ns: int, energies: LedgerEntry) -> None:
        """Publish, at view rate, the parts of an answer (6, 6), rows 2 to 4, and energies.

        Args:
            wrenches: (6, 6) world axes, rows as in :class:`ControlOutput`; N, N m; the last m, rad.
            stamp_ns: of the sample that is answered.
            energies: of the controllers.
        """
        if self.answers % self._actor.view_every == 0:
            for outlet, wrench in zip(self._publish_parts, wrenches[2:5], strict=True):
                if outlet.wanted:
                    outlet.publish(encode_wrench(wrench, stamp_ns))
            if self._publish_energy.wanted:
                values = pack_controller_energy(energies, stamp_ns)
                self._publish_energy.publish(self._energy.encode(values))
        self.answers += 1

    def mechanism(self, wrench: Array, stamp_ns: int) -> None:
        """Publish what the mechanism is told.

        Args:
            wrench: (6,) N and N m, world axes at the operational point.
            stamp_ns: of the device's sample; over a network, of the operational model.
        """
        self.to_point.publish(encode_wrench(wrench, stamp_ns, self._actor.wrenches))

    def zero(self, device_ns: int, mechanism_ns: int) -> None:
        """Say zero to both sides, each by its own clock (ns), later than what it was told last."""
        self._gain_ns = NEVER
        for outlet, time_ns in (
            (self.to_device, device_ns),
            (self.to_point, mechanism_ns),
        ):
            outlet.publish(encode_wrench(NO_WRENCH, nearest_stamp(time_ns)))
        self._own(NO_WRENCH, nearest_stamp(device_ns))
