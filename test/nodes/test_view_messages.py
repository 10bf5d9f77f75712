# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages say what shapes, frames and wrenches say."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from visualization_msgs.msg import Marker

from hapticmech_ros import Mechanism, load_scene
from hapticmech_ros.mechanism.projection import consistent_initial_state
from hapticmech_ros.nodes.viewer.scene_viewer import (
    marker_array,
    marker_of,
    transform_message,
)
from hapticmech_ros.view import NamedTransform, Picture, Placer, Snapshot
from hapticmech_ros.view.shapes import arrow, box, cylinder, numbered, sphere, strip, text

NOW = 1_700_000_000_123_456_789
GREY = (0.25, 0.5, 0.75, 1.0)
POSE = pin.SE3(pin.rpy.rpyToMatrix(0.4, -0.8, 2.0), np.array((0.1, -0.2, 0.3)))


def pose_of(position: Any, orientation: Any) -> np.ndarray:
    o = orientation
    place = np.array((position.x, position.y, position.z))
    return pin.SE3(pin.Quaternion(o.w, o.x, o.y, o.z).matrix(), place).homogeneous


@pytest.mark.parametrize(
    ("shape", "kind", "size"),
    [
        (cylinder(np.ones(3), np.array((0, 0, 0.4)), 0.1, GREY), Marker.CYLINDER, (0.1, 0.1, 0.4)),
        (sphere(np.ones(3), 0.1, GREY), Marker.SPHERE, (0.1, 0.1, 0.1)),
        (box(POSE, (0.1, 0.2, 0.3), GREY), Marker.CUBE, (0.1, 0.2, 0.3)),
        (strip(np.eye(3), 0.01, GREY), Marker.LINE_STRIP, (0.01, 0.0, 0.0)),
        (text(np.ones(3), "two", 0.05, GREY), Marker.TEXT_VIEW_FACING, (0.0, 0.0, 0.05)),
        (arrow(np.zeros(3), np.ones(3), 0.1, GREY)[0], Marker.ARROW, (0.1, 0.25, 0.4)),
    ],
)
def test_a_marker_is_its_shape(shape: Any, kind: int, size: tuple[float, ...]) -> None:
    (shape,) = numbered("space", [shape], first=3)
    marker = marker_of(shape)
    assert (marker.ns, marker.id, marker.type, marker.action) == ("space", 3, kind, Marker.ADD)
    assert (marker.scale.x, marker.scale.y, marker.scale.z) == pytest.approx(size)
    assert (marker.color.r, marker.color.g, marker.color.b, marker.color.a) == GREY
    assert [[p.x, p.y, p.z] for p in marker.points] == shape.points.tolist()
    assert marker.text == shape.text
    found = pose_of(marker.pose.position, marker.pose.orientation)
    # Through a quaternion and back: rounding.
    assert np.abs(found - shape.pose.homogeneous).max() < 1e-15


def test_an_array_deletes_first_and_draws_then() -> None:
    shapes = numbered("a", [sphere(np.zeros(3), 0.1, GREY)])
    message = marker_array(shapes, [("b", 4)], NOW, 1.5, afresh=True)
    actions = [marker.action for marker in message.markers]
    assert actions == [Marker.DELETEALL, Marker.DELETE, Marker.ADD]
    gone, drawn = message.markers[1:]
    assert (gone.ns, gone.id) == ("b", 4)
    assert (drawn.lifetime.sec, drawn.lifetime.nanosec) == (1, 500_000_000)
    for marker in message.markers:
        assert marker.header.frame_id == "world"
        assert marker.header.stamp.sec * 10**9 + marker.header.stamp.nanosec == NOW


def test_what_is_not_drawn_afresh_begins_with_no_clearing() -> None:
    assert marker_array([], [], NOW, 1.0).markers == []


def test_every_shape_of_a_picture_has_a_marker() -> None:
    mechanism = Mechanism(load_scene("five_bar"))
    placement = Placer(mechanism).at(consistent_initial_state(mechanism)[0])
    shapes = Picture(mechanism, 0.05, 4.0).draw(Snapshot((False,)), placement)
    markers = marker_array(shapes, [], NOW, 1.0).markers
    assert [(m.ns, m.id) for m in markers] == [shape.key for shape in shapes]


def test_a_transform_is_its_frame() -> None:
    # The world is everybody's, and has no prefix.
    in_world = transform_message(NamedTransform("world", "device", POSE), NOW, "left/")
    assert in_world.header.frame_id == "world"
    message = transform_message(NamedTransform("link1", "handle", POSE), NOW, "left/")
    assert message.header.frame_id == "left/link1"
    assert message.child_frame_id == "left/handle"
    found = pose_of(message.transform.translation, message.transform.rotation)
    assert np.abs(found - POSE.homogeneous).max() < 1e-15
    assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == NOW
