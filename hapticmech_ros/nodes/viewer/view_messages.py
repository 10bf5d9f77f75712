# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes, frames and wrenches of the pure core as messages that viewers understand."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pinocchio as pin
from geometry_msgs.msg import Point, Pose, TransformStamped, WrenchStamped
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from hapticmech_ros.arrays import Array
from hapticmech_ros.nodes.messages import WORLD, set_stamp, write_wrench
from hapticmech_ros.quaternions import quaternion_of
from hapticmech_ros.times import nanoseconds
from hapticmech_ros.view.frames import NamedTransform
from hapticmech_ros.view.shapes import Key, Shape

_TYPES = {
    "cylinder": Marker.CYLINDER,
    "sphere": Marker.SPHERE,
    "box": Marker.CUBE,
    "arrow": Marker.ARROW,
    "strip": Marker.LINE_STRIP,
    "text": Marker.TEXT_VIEW_FACING,
    "triangles": Marker.TRIANGLE_LIST,
}


def marker_array(
    shapes: Iterable[Shape],
    gone: Iterable[Key],
    time_ns: int,
    lifetime_s: float,
    afresh: bool = False,
) -> MarkerArray:
    """Return a picture as markers in ``world``.

    Args:
        shapes: what is to be seen.
        gone: what was seen before and is to vanish.
        time_ns: stamp.
        lifetime_s: after this a shape vanishes that nobody renews.
        afresh: remove everything first, whoever put it there.
    """
    message = MarkerArray()
    if afresh:
        message.markers.append(_header(Marker(action=Marker.DELETEALL), time_ns))
    for namespace, number in gone:
        marker = Marker(ns=namespace, id=number, action=Marker.DELETE)
        message.markers.append(_header(marker, time_ns))
    for shape in shapes:
        marker = _header(marker_of(shape), time_ns)
        set_stamp(marker.lifetime, nanoseconds(lifetime_s))
        message.markers.append(marker)
    return message


def marker_of(shape: Shape) -> Marker:
    """Return a shape as a marker without a header."""
    red, green, blue, opacity = shape.colour
    marker = Marker(
        ns=shape.namespace,
        id=shape.number,
        type=_TYPES[shape.kind],
        action=Marker.ADD,
        pose=_pose(shape.pose),
        color=ColorRGBA(r=red, g=green, b=blue, a=opacity),
        points=[Point(x=x, y=y, z=z) for x, y, z in shape.points.tolist()],
        text=shape.text,
    )
    # Message fields take nothing but floats, and an int becomes a wrong number without a word.
    marker.scale.x, marker.scale.y, marker.scale.z = map(float, shape.size)
    return marker


def transform_message(frame: NamedTransform, time_ns: int, prefix: str = "") -> TransformStamped:
    """Return a frame in its parent; every frame but ``world`` has ``prefix`` before its name."""
    message = TransformStamped(child_frame_id=prefixed(frame.child, prefix))
    message.header.frame_id = prefixed(frame.parent, prefix)
    set_stamp(message.header.stamp, time_ns)
    pose = _pose(frame.pose)
    moved = message.transform.translation
    moved.x, moved.y, moved.z = pose.position.x, pose.position.y, pose.position.z
    message.transform.rotation = pose.orientation
    return message


def tf_message(message_type: Any, transforms: Iterable[TransformStamped]) -> Any:
    """Return transforms as one message of tf; ``message_type`` is tf2_msgs' TFMessage."""
    return message_type(transforms=list(transforms))


def wrench_in(frame: str, wrench: Array, time_ns: int) -> WrenchStamped:
    """Return a wrench (6,), axes of ``world``, stamped in a frame that has those axes.

    Args:
        frame: its name.
        wrench: (6,) N and N m.
        time_ns: its stamp, ns.
    """
    message = WrenchStamped()
    write_wrench(message, wrench, time_ns)
    message.header.frame_id = frame
    return message


def prefixed(name: str, prefix: str) -> str:
    """Return the frame's name with ``prefix``; ``world`` is everybody's."""
    return name if name == WORLD else prefix + name


def _header(marker: Marker, time_ns: int) -> Marker:
    marker.header.frame_id = WORLD
    set_stamp(marker.header.stamp, time_ns)
    return marker


def _pose(pose: pin.SE3) -> Pose:
    message = Pose()
    place, turn = message.position, message.orientation
    place.x, place.y, place.z = pose.translation.tolist()
    turn.x, turn.y, turn.z, turn.w = quaternion_of(pose.rotation).tolist()
    return message
