# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages to numbers and back, with every rule that an incoming message has to keep.

Reading raises :class:`InvalidInputError` naming value and rule; writing fills a message in place.

Also the quality of service of every topic, with reasons; and waiting for reliable delivery.
"""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import pinocchio as pin
from builtin_interfaces.msg import Time
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseStamped,
    Quaternion,
    TransformStamped,
    TwistStamped,
    Vector3,
    WrenchStamped,
)
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header

from hapticmech_ros.errors import BagError, InvalidInputError, OutputError
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.scene.document import Limits
from hapticmech_ros.wire.bounds import SixBounds, pose_bounds
from hapticmech_ros.wire.layouts import pose_of
from hapticmech_ros.wire.stamped import seconds_of, stamp_of

if TYPE_CHECKING:
    # A restart of a node need not load them.
    from visualization_msgs.msg import Marker, MarkerArray

# Publishers are reliable: a reliable subscriber (CRTK clients, bags, `ros2 topic`) would silently
# not match a best-effort publisher. A few samples of history ride out a reader's hiccup.
STREAM_PUBLISHER = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=10, reliability=ReliabilityPolicy.RELIABLE
)
# The control path never waits for a lost sample, and wants new ones. Not the newest alone: of a
# publisher that leaves, Fast DDS 2.14 goes on counting messages as unread that newer ones replaced,
# and for each message that comes rclpy's events executor looks for as many as are unread. With a
# history of 1 the analyser took three times as much of a processor after 24 restarts of a second
# mechanism; with 5 it does not. Best effort connects to best-effort publishers of commands too.
CONTROL_SUBSCRIBER = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=5, reliability=ReliabilityPolicy.BEST_EFFORT
)
# State that changes rarely: a late subscriber gets the last value.
LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
# In lockstep nothing of the control path may be lost, not even messages from before a reader's
# discovery; at most two samples are ever in flight.
LOCKSTEP = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=10,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
# Recording loses nothing that arrives.
RECORDER_SUBSCRIBER = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=1000, reliability=ReliabilityPolicy.RELIABLE
)


# For all of them: a subscriber that stands still does not hold up a node's end.
WITHIN_S = 0.1
# How often it is looked whether they have the messages, s.
ASKS_S = 0.002


def wait_until_acknowledged(entities: Iterable[object], within_s: float = WITHIN_S) -> bool:
    """Wait until reliable subscribers have the messages of publishers among the entities.

    The end of a publisher is announced separately from its messages: a subscriber that receives it
    first drops messages not received yet.

    Args:
        entities: of a node.
        within_s: how long to wait for all of them together, s.

    Returns:
        Whether all was acknowledged.
    """
    end = time.monotonic() + within_s
    waiting = [one for one in entities if isinstance(one, Publisher)]
    while True:
        # Whoever waits in it holds Python's lock, and other nodes of the process act meanwhile.
        waiting = [one for one in waiting if not one.wait_for_all_acked(Duration())]
        if not waiting or time.monotonic() >= end:
            return not waiting
        time.sleep(ASKS_S)


def message_class(msgtype: str) -> Any:
    """Return the Python class of a message type.

    Raises:
        BagError: its package is not installed, or has no such message.
    """
    package, _, kind = msgtype.partition("/msg/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), kind)
    except (ImportError, AttributeError, ValueError):
        raise BagError(f"message type {msgtype!r}: its package is not installed") from None


WORLD = "world"
M = TypeVar("M")


def deserialized(message: bytes, message_type: type[M]) -> M:
    """Return the message in untrusted bytes.

    Raises:
        InvalidInputError: cut short, or not such a message.
    """
    try:
        found: M = deserialize_message(message, message_type)
    except RuntimeError as error:
        rule = f"must be a whole {message_type.__name__}"
        raise InvalidInputError("message", f"{len(message)} bytes: {error}", rule) from None
    return found


def stamp_ns(header: Header) -> int:
    """Return a header's stamp in ns."""
    return int(header.stamp.sec) * NANOSECONDS + int(header.stamp.nanosec)


def set_stamp(stamp: Time, time_ns: int) -> None:
    """Write a time in ns into a stamp.

    Raises:
        OutputError: a time that no stamp can hold.
    """
    stamp.sec, stamp.nanosec = seconds_of(time_ns)


def check_in_world(frame: str) -> None:
    """Check a command's frame, which may be left empty for ``world``.

    Raises:
        InvalidInputError: it is another one.
    """
    if frame not in ("", WORLD):
        raise InvalidInputError("frame_id", frame, f"must be '{WORLD}', or empty")


def checked_stamp(header: Header, now_ns: int, limit_ns: int, unstamped_is_now: bool) -> int:
    """Return the header's time, ns.

    Raises:
        InvalidInputError: none that a stamp can be; further than ``limit_ns`` from now; or zero
            where that is not allowed to mean now.
    """
    time_ns = stamp_of(header.stamp.sec, header.stamp.nanosec)
    return checked_time(time_ns, now_ns, limit_ns, unstamped_is_now)


def checked_time(time_ns: int, now_ns: int, limit_ns: int, unstamped_is_now: bool) -> int:
    """Return a stamp, ns, by the same rules as :func:`checked_stamp`.

    Raises:
        InvalidInputError: as there.
    """
    if time_ns == 0 and unstamped_is_now:
        return now_ns
    check_age(time_ns, now_ns, limit_ns)
    return time_ns


def check_age(time_ns: int, now_ns: int, limit_ns: int) -> None:
    """Refuse a stamp that is too far from now, before or after.

    Raises:
        InvalidInputError: further than ``limit_ns``.
    """
    if abs(now_ns - time_ns) > limit_ns:
        rule = f"must be within {limit_ns / NANOSECONDS:g} s of this node's clock"
        raise InvalidInputError("age of stamp, s", (now_ns - time_ns) / NANOSECONDS, rule)


def read_wrench(message: WrenchStamped, bounds: SixBounds, frame: str = WORLD) -> Array:
    """Return (6,) force and torque, N and N m, in the axes of ``frame``.

    Raises:
        InvalidInputError: another frame, or beyond its bounds.
    """
    check_frame(message.header, frame)
    return _six(bounds, message.wrench.force, message.wrench.torque)


def read_twist(message: TwistStamped, bounds: SixBounds, frame: str = WORLD) -> Array:
    """Return (6,) linear and angular velocity, m/s and rad/s, given in ``frame``.

    Raises:
        InvalidInputError: another frame, or beyond its bounds.
    """
    check_frame(message.header, frame)
    return _six(bounds, message.twist.linear, message.twist.angular)


def read_pose(message: PoseStamped, limits: Limits) -> pin.SE3:
    """Return the pose in ``world``.

    Raises:
        InvalidInputError: another frame, a position beyond its limit, not finite, or a quaternion
            that is not of unit length.
    """
    check_frame(message.header)
    return read_framed_pose(message, limits)


def read_framed_pose(message: PoseStamped, limits: Limits) -> pin.SE3:
    """Return the pose in the frame that the message names.

    Raises:
        InvalidInputError: a position beyond its limit, not finite, or a quaternion that is not of
            unit length.
    """
    p, o = message.pose.position, message.pose.orientation
    pose_bounds(limits).check((p.x, p.y, p.z, o.x, o.y, o.z))
    return pose_of(np.array((p.x, p.y, p.z)), np.array((o.x, o.y, o.z, o.w)))


def check_frame(header: Header, frame: str = WORLD) -> None:
    """Refuse any frame but one.

    Raises:
        InvalidInputError: another frame.
    """
    if header.frame_id != frame:
        raise InvalidInputError("frame_id", header.frame_id, f"must be '{frame}'")


def wrench_message(wrench: Array, time_ns: int, frame: str = WORLD) -> WrenchStamped:
    """Return a stamped wrench.

    Args:
        wrench: (6,) N and N m, in the axes of ``frame``.
        time_ns: its stamp, ns.
        frame: its name.
    """
    message = WrenchStamped()
    _write_header(message.header, time_ns, frame)
    force, torque = message.wrench.force, message.wrench.torque
    force.x, force.y, force.z, torque.x, torque.y, torque.z = wrench.tolist()
    return message


def write_pose(message: PoseStamped, pose: pin.SE3, time_ns: int) -> None:
    """Fill a stamped pose in ``world``."""
    _write_header(message.header, time_ns)
    fill_pose(message.pose, pose)


def fill_pose(message: Pose, pose: pin.SE3) -> None:
    """Fill a pose."""
    p, o = message.position, message.orientation
    p.x, p.y, p.z, o.x, o.y, o.z, o.w = pin.SE3ToXYZQUAT(pose).tolist()


def _write_header(header: Header, time_ns: int, frame: str = WORLD) -> None:
    header.frame_id = frame
    set_stamp(header.stamp, time_ns)


def _six(bounds: SixBounds, first: Vector3, second: Vector3) -> Array:
    six = first.x, first.y, first.z, second.x, second.y, second.z
    bounds.check(six)
    return np.array(six)


def check_finite(message: Any) -> None:
    """Refuse to send a message with a number that is not finite.

    Raises:
        OutputError: there is one.
    """
    numbers = _NUMBERS.get(type(message).__name__)
    if numbers is None:
        return
    for value in numbers(message):
        if not math.isfinite(value):
            raise OutputError(type(message).__name__, float(value), "must be finite")


def three_of(v: Vector3 | Point) -> tuple[float, float, float]:
    """Return the numbers of a vector."""
    return v.x, v.y, v.z


def _turn(q: Quaternion) -> tuple[float, float, float, float]:
    return q.x, q.y, q.z, q.w


def seven_of(pose: Pose) -> tuple[float, ...]:
    """Return position and quaternion of a pose."""
    return *three_of(pose.position), *_turn(pose.orientation)


def _array(message: Float64MultiArray) -> Iterable[float]:
    values = np.frombuffer(message.data)
    wrong = ~np.isfinite(values)
    return values[wrong].tolist()[:1] if wrong.any() else ()


def _markers(message: MarkerArray) -> Iterable[float]:
    for marker in message.markers:
        yield from _marker(marker)


def _marker(marker: Marker) -> Iterable[float]:
    yield from seven_of(marker.pose)
    yield from three_of(marker.scale)
    for point in marker.points:
        yield from three_of(point)


def _transform(message: TransformStamped) -> tuple[float, ...]:
    place = message.transform
    return *three_of(place.translation), *_turn(place.rotation)


_NUMBERS: dict[str, Callable[[Any], Iterable[float]]] = {
    WrenchStamped.__name__: lambda m: (*three_of(m.wrench.force), *three_of(m.wrench.torque)),
    TwistStamped.__name__: lambda m: (*three_of(m.twist.linear), *three_of(m.twist.angular)),
    PoseStamped.__name__: lambda m: seven_of(m.pose),
    JointState.__name__: lambda m: (*m.position, *m.velocity, *m.effort),
    Float64MultiArray.__name__: _array,
    TransformStamped.__name__: _transform,
    "MarkerArray": _markers,
}
