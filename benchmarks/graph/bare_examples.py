# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the bare graph publishes: on every topic a message of the scene's own, with a stamp put in.

Values are a session's, so each message has the type and the bytes' number of the real one.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, UInt8, UInt8MultiArray

from hapticmech_ros.control import DeviceMeasurement, PointMeasurement
from hapticmech_ros.control.measurements import (
    flat_device,
    flat_operational_model,
    operational_model_of,
)
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.closures import flat_grasps
from hapticmech_ros.nodes.messages import WORLD, message_class, set_stamp
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.quaternions import quaternion_of
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Session
from hapticmech_ros.wire import topics as table
from hapticmech_ros.wire.cdr import FlatArray, encode_matrix
from hapticmech_ros.wire.layouts import energy_of
from hapticmech_ros.wire.messages import (
    ControllerEnergy,
    DeviceEnergy,
    DeviceStateMessage,
    LocalFeedbackGain,
    MechanismEnergy,
    OperationalModelMessage,
)
from hapticmech_ros.wire.stamped import encode_pose, encode_twist
from hapticmech_ros.wire.state import StateLayout, WireState, coordinate_names
from hapticmech_ros.wire.topics import (
    ARRAY,
    CONTROLLER_ENERGY,
    DEVICE_ENERGY,
    ENERGY,
    POSE,
    TWIST,
    WRENCH,
    Topic,
)
from hapticmech_ros.wire.wrench import encode_wrench

# What is published at a time, ns: a message, or one already serialized.
Example = Callable[[int], Any]
TYPES: dict[str, Any] = {
    POSE: PoseStamped,
    TWIST: TwistStamped,
    WRENCH: WrenchStamped,
    ARRAY: Float64MultiArray,
    "sensor_msgs/msg/JointState": JointState,
    "sensor_msgs/msg/Joy": Joy,
    "std_msgs/msg/UInt8": UInt8,
    "std_msgs/msg/UInt8MultiArray": UInt8MultiArray,
}
# Of states and of commands that change them: CRTK's own types, or what stands for them here.
STATES = (table.DEVICE_OPERATING_STATE, table.POINT_OPERATING_STATE)
COMMANDS = (table.DEVICE_STATE_COMMAND, table.POINT_STATE_COMMAND)
WORDS = (*STATES, *COMMANDS, table.DEVICE_HOLD, table.DEVICE_FREE, table.DEVICE_BODY_AXES)
TYPES |= {topic.type: message_class(topic.type) for topic in WORDS}


class StampedArray:
    """A serialized flat array whose first two numbers are its stamp.

    Attributes:
        offset: where in the bytes the stamp stands.
    """

    def __init__(self, wire: FlatArray, values: Array) -> None:
        encoded = wire.encode(values)
        self.offset = len(encoded) - values.nbytes
        self._bytes = bytearray(encoded)

    def __call__(self, stamp_ns: int) -> bytes:
        """Return the message with a stamp, ns."""
        struct.pack_into("<dd", self._bytes, self.offset, *divmod(stamp_ns, NANOSECONDS))
        return bytes(self._bytes)

    def stamp_ns(self, message: bytes) -> int:
        """Return the stamp of a message of this length and layout, ns."""
        seconds, nanoseconds = struct.unpack_from("<dd", message, self.offset)
        return int(seconds) * NANOSECONDS + int(nanoseconds)


class Examples:
    """Examples of a scene's messages, by topic.

    Args:
        scene: taken after one tick of its session.
        point: operational point that the device holds; empty: the first.
    """

    def __init__(self, scene: Scene, point: str = "") -> None:
        session = Session(scene, point)
        session.tick()
        sample = session.tick()
        mechanism = session.simulator.mechanism
        self.points = tuple(mechanism.point_names)
        state, analysis, output = sample.mechanism, sample.analysis, sample.output
        external = np.zeros((len(self.points), 6))
        received, grasps = (True,) * len(self.points), flat_grasps(scene)
        layout = StateLayout(mechanism)
        own = sample.device
        device = DeviceStateMessage.of(0, applied=output.device)
        device.sample.values[:] = flat_device(
            DeviceMeasurement(own.measured_pose, own.measured_twist, sample.hand_wrench)
        )
        seen = PointMeasurement(sample.point.pose, sample.point.twist, external[0])
        model = OperationalModelMessage.of(0, count=sample.count, commanded=1.0, grasp=grasps[0])
        model.directions = analysis.spectrum.s.size
        model.operational_model.values[:] = flat_operational_model(
            operational_model_of(analysis), seen
        )
        model.s[:] = analysis.spectrum.s
        energy = energy_of(mechanism, state, 0)
        wire = WireState(0, state.active, state.q, state.v, external, grasps, received)
        joints = coordinate_names(mechanism), layout.coordinates(state.q), state.v
        self.arrays: dict[Topic, StampedArray] = {
            table.DEVICE_STATE: StampedArray(
                FlatArray(DeviceStateMessage.layout),
                device.values,
            ),
            table.STATE: StampedArray(FlatArray(layout.fields), layout.pack(wire)),
            table.POINT_MODEL: StampedArray(
                FlatArray(OperationalModelMessage.layout), model.values
            ),
            table.DEVICE_GAIN: StampedArray(
                FlatArray(LocalFeedbackGain.layout),
                LocalFeedbackGain().values,
            ),
            DEVICE_ENERGY: StampedArray(
                FlatArray(DeviceEnergy.layout),
                DeviceEnergy().values,
            ),
            CONTROLLER_ENERGY: StampedArray(
                FlatArray(ControllerEnergy.layout),
                ControllerEnergy.of(0, **session.energies._asdict()).values,
            ),
            ENERGY: StampedArray(FlatArray(MechanismEnergy.layout), energy.values),
        }
        wrenches = np.zeros((6, sample.count))
        flags, names = state.active, [closure.name for closure in mechanism.closures]
        self._others: dict[Topic, Example] = {
            table.DEVICE_POSE: _pose(own.measured_pose),
            table.DEVICE_POSE_SETPOINT: _pose(own.measured_pose),
            table.DEVICE_TWIST: _twist(own.measured_twist),
            table.DEVICE_JOINTS: _joints(
                ("x", "y", "z", "rx", "ry", "rz"), np.zeros(6), own.measured_twist, output.device
            ),
            table.JOINT_STATES: _joints(*joints),
            table.POINT_JOINTS: _joints(*joints),
            table.POINT_POSE: _pose(sample.point.pose),
            table.OPERATIONAL_POINT: _pose(sample.point.pose),
            table.POINT_TWIST: _twist(sample.point.twist),
            table.CLOSURES: _constant(_flags(flags, names)),
            table.INVERSE_INERTIA: _matrix("row", "column", analysis.inverse_inertia),
            table.PROJECTOR: _matrix("row", "column", analysis.constraint_projector),
            table.CONSTRAINT_WRENCHES: _matrix("wrench", "constraint", wrenches),
            table.SPECTRUM: _matrix("mu", "value", analysis.spectrum.mu.reshape(-1, 1)),
            table.COUNT: _constant(UInt8(data=sample.count)),
            table.DEVICE_BUTTONS: _header(Joy()),
            **{topic: _constant(TYPES[topic.type]()) for topic in STATES},
        }

    def of(self, topic: Topic) -> Example:
        """Return what is published on a topic.

        Raises:
            InvalidInputError: a topic that this has no example for.
        """
        if topic in self.arrays:
            return self.arrays[topic]
        if topic in self._others:
            return self._others[topic]
        # Wrenches differ in their values only.
        if topic.type == WRENCH:
            return _wrench(np.full(6, 0.1))
        raise InvalidInputError("topic", topic.name, "must have an example in the bare graph")


def _pose(pose: pin.SE3) -> Example:
    place = *pose.translation.tolist(), *quaternion_of(pose.rotation).tolist()
    return _header(deserialize_message(encode_pose(place, 0), PoseStamped))


def _twist(twist: Array) -> Example:
    return _header(deserialize_message(encode_twist(twist.tolist(), 0), TwistStamped))


def _wrench(wrench: Array) -> Example:
    return _header(deserialize_message(encode_wrench(wrench, 0), WrenchStamped))


def _joints(names: Any, positions: Array, rates: Array, efforts: Array | None = None) -> Example:
    message = JointState(name=list(names))
    message.header.frame_id = WORLD
    message.position, message.velocity = positions.tolist(), rates.tolist()
    message.effort = [] if efforts is None else efforts.tolist()
    return _header(message)


def _matrix(row: str, column: str, values: Array) -> Example:
    return _constant(deserialize_message(encode_matrix(row, column, values), Float64MultiArray))


def _flags(flags: Any, names: list[str]) -> UInt8MultiArray:
    message = UInt8MultiArray(data=[int(on) for on in flags])
    size = len(names)
    message.layout.dim = [MultiArrayDimension(label=",".join(names), size=size, stride=size)]
    return message


def _header(message: Any) -> Example:
    def at(stamp_ns: int) -> Any:
        set_stamp(message.header.stamp, stamp_ns)
        return message

    return at


def _constant(message: Any) -> Example:
    return lambda stamp_ns: message
