# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is written without a message's objects is read by the middleware as that message."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, UInt8

from hapticmech_ros.errors import OutputError
from hapticmech_ros.wire.cdr import encode_byte, encode_matrix
from hapticmech_ros.wire.stamped import JointStateWriter, encode_pose, encode_twist

STAMP_NS = 1_700_000_000_123_456_789
SIX = [0.1, -2e300, 5e-324, 0.0, -0.0, 7.0]


def stamped(kind: type) -> object:
    message = kind()
    message.header.frame_id = "world"
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(STAMP_NS, 10**9)
    return message


def same(written: bytes, message: object) -> None:
    # The middleware leaves in padding what was in its memory, and its buffer may be longer.
    assert deserialize_message(written, type(message)) == message
    assert len(written) <= len(serialize_message(message))


def test_a_twist() -> None:
    message = stamped(TwistStamped)
    parts = message.twist.linear, message.twist.angular
    for part, values in zip(parts, (SIX[:3], SIX[3:]), strict=True):
        part.x, part.y, part.z = values
    same(encode_twist(SIX, STAMP_NS), message)


def test_a_pose() -> None:
    message = stamped(PoseStamped)
    place = message.pose
    place.position.x, place.position.y, place.position.z = SIX[:3]
    turn = place.orientation
    turn.x, turn.y, turn.z, turn.w = SIX[2:]
    same(encode_pose([*SIX[:3], *SIX[2:]], STAMP_NS), message)


@pytest.mark.parametrize(
    "names", [[], ["a"], ["shoulder", "elbow_2"], [f"j{'x' * n}" for n in range(9)]]
)
@pytest.mark.parametrize("with_effort", [True, False])
def test_joint_states(names: list[str], with_effort: bool) -> None:
    message = stamped(JointState)
    message.name = names
    numbers = np.linspace(-1.0, 2.0, 3 * len(names)).reshape(3, -1).tolist()
    position, velocity, effort = numbers[0], numbers[1], numbers[2] if with_effort else []
    message.position, message.velocity, message.effort = position, velocity, effort
    same(JointStateWriter(names).encode(position, velocity, effort, STAMP_NS), message)


@pytest.mark.parametrize("shape", [(6, 6), (6, 0), (6, 2), (1, 1), (3, 1)])
def test_a_matrix(shape: tuple[int, int]) -> None:
    matrix = np.arange(float(math.prod(shape))).reshape(shape)
    message = Float64MultiArray(data=matrix.ravel().tolist())
    rows, columns = shape
    message.layout.dim = [
        MultiArrayDimension(label="wrench", size=rows, stride=rows * columns),
        MultiArrayDimension(label="constraint", size=columns, stride=columns),
    ]
    same(encode_matrix("wrench", "constraint", matrix), message)
    same(encode_matrix("wrench", "constraint", np.asfortranarray(matrix)), message)


@pytest.mark.parametrize("value", [0, 1, 255])
def test_a_byte(value: int) -> None:
    written = encode_byte(value)
    assert deserialize_message(written, UInt8) == UInt8(data=value)
    assert len(written) % 4 == 0


@pytest.mark.parametrize("value", [-1, 256])
def test_a_number_that_is_no_byte_is_not_written(value: int) -> None:
    with pytest.raises(OutputError, match="within 0 to 255"):
        encode_byte(value)


WRITERS: list[Callable[[float, int], bytes]] = [
    lambda value, stamp: encode_twist([0.0] * 5 + [value], stamp),
    lambda value, stamp: encode_pose([value] + [0.0] * 6, stamp),
    lambda value, stamp: JointStateWriter(["a"]).encode([0.0], [value], [], stamp),
]


@pytest.mark.parametrize("write", WRITERS)
def test_what_is_no_number_or_time_is_not_written(write: Callable[[float, int], bytes]) -> None:
    for value in (math.nan, math.inf, -math.inf):
        with pytest.raises(OutputError, match="must be finite"):
            write(value, STAMP_NS)
    for stamp in (-1, 1 << 62):
        with pytest.raises(OutputError):
            write(0.0, stamp)
    with pytest.raises(OutputError, match="must be finite"):
        encode_matrix("a", "b", np.array([[1.0, math.nan]]))
