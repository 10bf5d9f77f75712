# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Relay to a driver of ros2_control: efforts per axis out, joint states in.

The controller behind keeps the last effort that it was sent. Efforts of zero are sent whenever
nothing is commanded and when the node ends; a node that is killed cannot send them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.device.real_device import Measured, RealDevice
from hapticmech_ros.device.state import NO_WRENCH
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes.actor import Host
from hapticmech_ros.nodes.buttons import joy_buttons
from hapticmech_ros.nodes.inputs import joints_read
from hapticmech_ros.nodes.messages import CONTROL_SUBSCRIBER, STREAM_PUBLISHER
from hapticmech_ros.nodes.parameters import RelayParameters
from hapticmech_ros.nodes.real_device_driver import RealDeviceDriver
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.scene import Scene

# m and m/s that no device of this kind exceeds.
FARTHEST, FASTEST = 2.0, 50.0


class AxesDevice(RealDevice):
    """A device of three or six axes.

    Args:
        scene: to render; its ``device`` describes the device.
        mounting: (3, 3) axes of the base in the world.
        send: called with efforts (3,) or (6,), N and N m, axes of the base.
        has_torques: whether there are six efforts.
        silence: s without joint states after which the device counts as lost.
        clock: s.
    """

    def __init__(
        self,
        scene: Scene,
        mounting: Array,
        send: Callable[[Array], None],
        has_torques: bool,
        silence: float,
        clock: Callable[[], float],
    ) -> None:
        super().__init__(scene, mounting, silence, clock, has_torques)
        self._send, self._efforts = send, 6 if has_torques else 3
        self._received, self._is_new = -np.inf, False
        self.problem = "no joint states have come"

    def receive(self, measured: Measured) -> None:
        """Take a sample."""
        self._last, self._received, self._is_new = measured, self._clock(), True
        self.problem = ""

    def look(self) -> bool:
        """Return whether the device is there."""
        if self._last is not None and self._clock() - self._received > self.silence:
            self.problem = f"no joint states for {1e3 * self.silence:.0f} ms"
            self.forget()
        return self._last is not None

    def exchange(self, wrench: Array, now: float) -> tuple[bool, Measured | None]:
        """Send efforts and take the sample that has come since the last time.

        Args:
            wrench: (6,) on the hand, N and N m, axes of the base.
            now: by the clock, s.

        Returns:
            That it was sent, and the measurement; None without a sample.
        """
        self._send(wrench[: self._efforts])
        measured = self._last if self._is_new else None
        self._is_new = False
        return True, measured

    def let_go(self) -> None:
        """Send efforts of zero."""
        self._send(np.zeros(self._efforts))
        self._given = NO_WRENCH


class RelayDevice(RealDeviceDriver[RelayParameters]):
    """Drives a device behind joint states and efforts, such as forcedimension_ros2's."""

    name = "relay_device"
    parameters_type = RelayParameters
    device: AxesDevice

    def __init__(self, node: Host, parameters: RelayParameters) -> None:
        self._names = tuple(parameters.axes.split())
        if len(self._names) not in (3, 6) or len(set(self._names)) < len(self._names):
            raise InvalidInputError("axes", parameters.axes, "must be 3 or 6 different joints")
        if parameters.torques and len(self._names) != 6:
            raise InvalidInputError("axes", parameters.axes, "must be 6 joints with torques")
        super().__init__(node, parameters)
        self.input(parameters.state_topic, JointState, CONTROL_SUBSCRIBER, self._on_state)
        if parameters.button_topic:
            self.input(parameters.button_topic, Joy, STREAM_PUBLISHER, self._on_buttons)

    def new_device(self) -> AxesDevice:
        """Return the device behind the topics."""
        given, node = self.parameters, self.node
        topic, kind = given.joint_command_topic, Float64MultiArray
        publisher = node.keep(node.create_publisher(kind, topic, STREAM_PUBLISHER))

        def send(efforts: Array) -> None:
            publisher.publish(Float64MultiArray(data=efforts.tolist()))

        silence, torques = self.command_timeout, given.torques
        return AxesDevice(
            self.scene, self.mounting, send, torques, silence, lambda: self.now_ns() / NANOSECONDS
        )

    def _on_buttons(self, message: Joy, now_ns: int) -> None:
        del now_ns
        self.device.buttons = joy_buttons(message)

    def _on_state(self, message: JointState, now_ns: int) -> None:
        """Take a state of all axes; one of others is none of ours."""
        del now_ns
        found = joints_read(message, self._names)
        if found is None:
            return
        position, velocity = found
        if not (np.abs(position[:3]) <= FARTHEST).all():
            raise InvalidInputError("position", position[:3], f"must be within ±{FARTHEST:g} m")
        if not (np.abs(velocity[:3]) <= FASTEST).all():
            raise InvalidInputError("velocity", velocity[:3], f"must be within ±{FASTEST:g} m/s")
        rotation = None
        if position.size == 6:
            if not np.isfinite(position[3:]).all():
                raise InvalidInputError("position", position[3:], "must be finite")
            # About axes that turn with the handle, as forcedimension_ros2 has them.
            rotation = pin.exp3(np.array((position[3], 0.0, 0.0)))
            rotation = rotation @ pin.exp3(np.array((0.0, position[4], 0.0)))
            rotation = rotation @ pin.exp3(np.array((0.0, 0.0, position[5])))
        self.device.receive(Measured(position[:3], velocity[:3], rotation))
