# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated haptic device driver: like a real device's ROS driver, with a hand on it.

It subscribes to others' additions to the hand's wrench: pushes, or in lockstep one for each sample.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from functools import partial

import numpy as np
from geometry_msgs.msg import WrenchStamped
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from hapticmech_ros.control.loop_layout import DeviceAccount
from hapticmech_ros.device import (
    NO_WRENCH,
    DeviceState,
    ImpedanceDevice,
    SimulatedDevice,
    device_for,
)
from hapticmech_ros.device.kernels import SimulatedState
from hapticmech_ros.device.motion_kernels import is_too_fast
from hapticmech_ros.errors import HapticMechError, OutputError
from hapticmech_ros.nodes import device_kernels as own
from hapticmech_ros.nodes.actor import Actor, Host
from hapticmech_ros.nodes.device_driver import DeviceDriver
from hapticmech_ros.nodes.exchange import Outlet
from hapticmech_ros.nodes.external_wrenches import ExternalWrenches
from hapticmech_ros.nodes.local_loop import NO_GAIN
from hapticmech_ros.nodes.parameters import DeviceParameters
from hapticmech_ros.nodes.plain_messages import (
    MOST_READ,
    PlainCommand,
    PlainMessages,
    Publication,
    Received,
    stacked,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import nanoseconds
from hapticmech_ros.scene.hand import STILL_HAND
from hapticmech_ros.wire.bounds import message_bounds
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.messages import DeviceStateMessage, LocalFeedbackGain
from hapticmech_ros.wire.topics import DEVICE_COMMAND, DEVICE_GAIN, HAND_WRENCH, START_HAND


class HandWrenches:
    """Listens to ``device/hand_cf``, ``device/hand_cf/persistent``, and names below these.

    Args:
        actor: the device.
        rotation: returns the device's orientation (3, 3) in the world.
        go_on: called when something came that a tick in lockstep may have waited for.
    """

    def __init__(
        self,
        actor: Actor[DeviceParameters],
        rotation: Callable[[], Array],
        go_on: Callable[[int], None],
    ) -> None:
        self._rotation = rotation
        self._go_on = go_on
        self._external: ExternalWrenches | None = None
        # By stamp, ns.
        self._awaited: dict[int, Array] = {}
        if actor.lockstep and actor.parameters.hand == "commanded":
            qos = actor.control_input
            actor.input_command(HAND_WRENCH.name, qos, self._on_awaited, unstamped_is_now=False)
            return
        self._external = ExternalWrenches(
            actor, {"hand": "device"}, "hand_cf", ["device", "device_world"]
        )
        self._external.listen(HAND_WRENCH.name)
        self.apply_parameters(actor.parameters)

    def apply_parameters(self, parameters: DeviceParameters) -> None:
        """Take new parameters."""
        if self._external is not None:
            self._external.set_timeout(nanoseconds(parameters.hand_timeout))

    def forget(self) -> None:
        """Drop received wrenches."""
        if self._external is not None:
            self._external.forget()

    def ready(self, deadline_ns: int) -> bool:
        """Return whether the inputs of a tick in lockstep are there."""
        return self._external is not None or deadline_ns in self._awaited

    def at(self, now_ns: int) -> Array:
        """Return the wrench (6,) from now on, N and N m, axes of the world."""
        if self._external is None:
            return self._awaited.pop(now_ns)
        return self._external.at(now_ns, self._rotation_of).get("hand", NO_WRENCH)

    def pushes(self, now_ns: int) -> bool:
        """Return whether any wrench acts at a time, ns, or one is awaited."""
        return self._external is None or self._external.pushes(now_ns)

    def figures(self, now_ns: int) -> dict[str, str]:
        """Return who pushes now, for diagnostics."""
        return {} if self._external is None else self._external.figures(now_ns)

    def _rotation_of(self, frame: str) -> Array:
        return np.eye(3) if frame == "device_world" else self._rotation()

    def _on_awaited(self, wrench: Array, stamp_ns: int, now_ns: int) -> None:
        self._awaited[stamp_ns] = wrench
        self._go_on(now_ns)


class DeviceTicks(PlainMessages):
    """Moves the device of a driver.

    Args:
        actor: the driver's.
        device: to move.
        outlet: publisher of samples.
    """

    def __init__(self, actor: HapticDevice, device: ImpedanceDevice, outlet: Outlet) -> None:
        command, sample = PlainCommand(actor.wrenches), FlatArray(DeviceStateMessage.layout)
        topic = actor.lane_topic(DEVICE_COMMAND.name, WrenchStamped)
        most = message_bounds(DeviceStateMessage, actor.limits).most
        gain_most = message_bounds(LocalFeedbackGain, actor.limits).most
        gains, gain_topic = FlatArray(LocalFeedbackGain.layout), ""
        if actor.is_local:
            gain_topic = actor.lane_topic(DEVICE_GAIN.name, Float64MultiArray)
        received = [
            command.received(topic, actor.commanders),
            Received(gain_topic, actor.gains, gains.prefix, gain_most, beside=True),
            *actor.users.received(),
        ]
        self.link = own.DeviceLink()
        super().__init__(actor, received, [Publication(outlet, sample.prefix, most)], self.link)
        self._driver, self._device = actor, device
        self._hands = stacked(self.inputs[own.HANDS :])
        self._out = DeviceStateMessage(self.outputs[0].values)
        self._commands, self._trips = np.zeros((2, 6)), np.zeros(MOST_READ)
        self._state, self._later = SimulatedState().values, SimulatedState().values
        self._model = NO_GAIN.copy()
        self._out.obeys = True

    def ready(self) -> bool:
        """Give the kernel the driver's state; return whether it may do anything for it."""
        actor, device = self._driver, self._device
        if not actor.plainly(self.link, self._commands, self._state, self._model):
            return False
        if actor.held is not None and actor.held is not device.held:
            device.take_hold(actor.held)
        self._out.round_trip = actor.answers.round_trip
        return True

    def kernel(self) -> Callable[[], int]:
        """Return the kernel with all that it is called with."""
        actor, loop, side = self._driver, self._driver.loop, self._driver.side
        command, gain, coupling = self.inputs[: own.HANDS]
        return partial(
            own.drive_at_deadlines,
            self.link,
            command,
            gain,
            coupling,
            *self._hands,
            self.outputs[0],
            self.polled,
            self._commands,
            actor.fastest,
            self._device.data,
            self._state,
            self._later,
            side.passivity.account,
            side.envelope.numbers,
            loop.stamps,
            loop.samples,
            loop.hand,
            self._model,
            loop.others.data,
            actor.users.places,
            actor.period_s,
            loop.energies,
            self._trips,
            self.ages,
            actor.node.exchange.turn.listened,
        )

    def did(self, code: int, reads: int) -> None:
        """Update the driver with the kernel's work."""
        actor, trips = self._driver, self._trips[: self.link.trips]
        if self.inputs[own.GAINS].reading.read:
            link = self.link
            newest = link.gain_newest, link.gain_arrived
            actor.loop.took(self._model, link.gain_ns, newest)
        if reads or self.link.done:
            actor.moved(self.link, self._commands, self._state, trips, code)

    def view(self) -> Callable[[], None]:
        """Return a function that publishes the device's state for people."""
        actor, account = self._driver, copy(self._driver.side.passivity)
        account.account = DeviceAccount(account.account.values.copy())
        state, stamp_ns = DeviceState(self._state.copy()), self.link.next - self.link.period
        return partial(actor.publish_view, state, NO_WRENCH, account, stamp_ns)


class HapticDevice(DeviceDriver[DeviceParameters]):
    """Drives an :class:`~hapticmech_ros.device.ImpedanceDevice`.

    The hand takes hold when commands arrive and lets go when they stop. In lockstep it holds from
    the start, and the command that acts over a period answers the sample one period before it.
    """

    name = "haptic_device"
    parameters_type = DeviceParameters
    # m/s and rad/s, (2,): see ``device.motion`` of a scene.
    fastest: Array

    def __init__(self, node: Host, parameters: DeviceParameters) -> None:
        super().__init__(node, parameters)
        self._wait_for_start = parameters.wait_for_start
        motion = self.scene.device.motion
        self.fastest = np.array([motion.speed, motion.angular_speed])
        node.keep(node.create_service(Trigger, START_HAND, self._on_start_hand))
        self._hand = HandWrenches(self, lambda: np.asarray(self._state.pose.rotation), self.act)
        self._plain: DeviceTicks | None = None
        if isinstance(self.device, ImpedanceDevice) and self.device.plain:
            self._plain = DeviceTicks(self, self.device, self._publish_wire)

    def new_device(self) -> SimulatedDevice:
        """Return the scene's device, in the hand that the parameters choose."""
        scene, hand = self.scene, self.parameters.hand
        if hand == "still":
            scene = scene.model_copy(update={"hand": STILL_HAND})
        return device_for(scene, with_hand=hand != "commanded")

    def _publish(self, stamp_ns: int) -> None:
        twist = self._state.measured_twist
        if not self.lockstep and is_too_fast(twist, self.fastest):
            found = f"{np.linalg.norm(twist[:3]):.3g} m/s, {np.linalg.norm(twist[3:]):.3g} rad/s"
            speed, turning = self.fastest
            rule = f"must not exceed device.motion: {speed:g} m/s, {turning:g} rad/s"
            raise OutputError("twist of device/state", found, rule)
        super()._publish(stamp_ns)

    def pushed(self, deadline_ns: int) -> Array:
        """Return others' pushes (6,), by topics, N and N m, world axes at the point held."""
        return self._hand.at(deadline_ns)

    def apply_parameters(self, parameters: DeviceParameters) -> None:
        """Take new parameters: the timeouts count from now on."""
        super().apply_parameters(parameters)
        self._hand.apply_parameters(parameters)

    def activate(self) -> None:
        """Begin where the device is, without a hand; in lockstep, held from the start."""
        self._hand.forget()
        super().activate()
        self.wait_by(self._plain)

    def deactivate(self) -> None:
        """Put the actuators at zero and let go."""
        self.wait_by(None)
        super().deactivate()

    def plainly(self, link: own.DeviceLink, commands: Array, state: Array, model: Array) -> bool:
        """Return the result of :meth:`DeviceDriver.plainly`, if no wrench pushes.

        Args:
            link: the driver's state, to fill.
            commands: (2, 6) to fill, N and N m.
            state: (107,) to fill, of the device.
            model: (108,) to fill: how commands depend on the device.
        """
        pushed = self._hand.pushes(self.now_ns())
        # The hand is to take hold, once it need not wait.
        free = self.held is None and not self._wait_for_start
        return not (pushed or free) and super().plainly(link, commands, state, model)

    def take_hold(self) -> None:
        """Let the hand take hold, unless it has, or waits."""
        if not self._wait_for_start:
            super().take_hold()

    def ready(self, deadline_ns: int) -> bool:
        """Return whether the command to act on, and the hand's wrench if awaited, are there."""
        return self._hand.ready(deadline_ns) and super().ready(deadline_ns)

    def figures(self, now_ns: int) -> Mapping[str, str]:
        """Return the hand, and the names of pushes, for diagnostics."""
        return {"hand": self.parameters.hand, **self._hand.figures(now_ns)}

    def _on_start_hand(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        del request
        return self.failures.answer(START_HAND, self._start_hand, response, "the hand starts")

    def _start_hand(self) -> None:
        if not self._wait_for_start:
            raise HapticMechError("the hand was not waiting")
        self._wait_for_start = False
