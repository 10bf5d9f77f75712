# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""WrenchStamped bytes: as rclpy writes and reads them, and refusals."""

import struct

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import deserialize_message, serialize_message

from hapticmech_ros.errors import InvalidInputError, OutputError
from hapticmech_ros.scene.document import Limits
from hapticmech_ros.wire.bounds import wrench_bounds
from hapticmech_ros.wire.wrench import decode_wrench, encode_wrench

VALUES = np.array([1.5, -2.0, 3.25, -1e-300, 5e5, -0.0])


def message(frame):
    found = WrenchStamped()
    found.header.frame_id = frame
    found.header.stamp.sec, found.header.stamp.nanosec = 1_795_253_521, 999_999_999
    force, torque = found.wrench.force, found.wrench.torque
    force.x, force.y, force.z, torque.x, torque.y, torque.z = VALUES.tolist()
    return found


def test_what_is_written_is_what_rclpy_writes():
    ours = encode_wrench(VALUES, 1_795_253_521_999_999_999)
    theirs = serialize_message(message("world"))
    # What aligns the numbers behind the name says nothing; rclpy leaves in it what was there.
    assert ours[:22] + ours[28:] == theirs[:22] + theirs[28:]
    assert ours[22:28] == bytes(6)
    assert deserialize_message(ours, WrenchStamped) == message("world")


@pytest.mark.parametrize("frame", ["", "a", "abc", "abcd", "world", "a_frame_with_a_longer_name"])
def test_what_rclpy_writes_is_read(frame):
    found = decode_wrench(serialize_message(message(frame)))
    assert found.stamp_ns == 1_795_253_521_999_999_999
    assert found.frame == frame
    assert found.values.tobytes() == VALUES.tobytes()


@pytest.mark.parametrize("length", [0, 3, 15, 20, 40, 75])
def test_a_message_cut_short_is_refused(length):
    with pytest.raises(InvalidInputError, match="whole WrenchStamped"):
        decode_wrench(encode_wrench(VALUES, 5)[:length])


def test_big_endian_is_refused():
    with pytest.raises(InvalidInputError, match="little-endian"):
        decode_wrench(b"\x00\x00" + encode_wrench(VALUES, 5)[2:])


def packed(values, seconds=5, nanoseconds=0):
    """Return the bytes of a wrench that nobody has looked at."""
    head = b"\x00\x01\x00\x00", seconds, nanoseconds, 6, b"world\0"
    return struct.pack("<4siII6s6x6d", *head, *values)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("index", range(6))
def test_what_is_not_finite_is_refused_and_never_sent(bad, index):
    values = VALUES.copy()
    values[index] = bad
    with pytest.raises(InvalidInputError, match="finite"):
        decode_wrench(packed(values))
    with pytest.raises(OutputError, match="finite"):
        encode_wrench(values, 5)


@pytest.mark.parametrize("index", range(6))
def test_what_is_larger_than_the_scene_allows_is_refused_and_never_sent(index):
    bounds = wrench_bounds(Limits(force=10.0, torque=2.0))
    values = np.zeros(6)
    values[index] = -(10.0 if index < 3 else 2.0)
    assert decode_wrench(encode_wrench(values, 5, bounds), bounds).values[index] == values[index]
    values[index] *= 1.0 + 1e-15
    rule = "at most 10 .*force" if index < 3 else "at most 2 .*torque"
    with pytest.raises(InvalidInputError, match=rule):
        decode_wrench(packed(values), bounds)
    with pytest.raises(OutputError, match=rule):
        encode_wrench(values, 5, bounds)


@pytest.mark.parametrize(("seconds", "nanoseconds"), [(-1, 0), (5, 1_000_000_000)])
def test_a_stamp_that_is_none_is_refused(seconds, nanoseconds):
    with pytest.raises(InvalidInputError, match="stamp"):
        decode_wrench(packed(VALUES, seconds, nanoseconds))


@pytest.mark.parametrize("time_ns", [-1, 2**31 * 1_000_000_000, 1 << 62])
def test_a_time_that_no_stamp_can_hold_is_refused_where_it_would_be_written(time_ns):
    with pytest.raises(OutputError, match=r"stamp, s is not sent: seconds must be from 0"):
        encode_wrench(VALUES, time_ns)
