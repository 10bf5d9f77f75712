"""WrenchStamped bytes: as rclpy writes and reads them, and refusals."""

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import deserialize_message, serialize_message

from hapticmech_ros.errors import InvalidInputError
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


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_refused(bad):
    values = VALUES.copy()
    values[4] = bad
    with pytest.raises(InvalidInputError, match="finite"):
        decode_wrench(encode_wrench(values, 5))
