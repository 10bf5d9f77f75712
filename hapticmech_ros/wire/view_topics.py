# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Topics of the scene viewer. /tf is not among them: its message type is not on PyPI."""

from __future__ import annotations

from hapticmech_ros.wire.topic import VIEWER, WRENCH, Topic

MARKERS = Topic(
    "view/markers",
    "visualization_msgs/msg/MarkerArray",
    VIEWER,
    "markers in `world`: mechanism, closures, device, forces, constraint directions; "
    "colours in docs/visualization.md",
    rate="marker",
)
FRAMES = Topic(
    "view/frames",
    "geometry_msgs/msg/TransformStamped",
    VIEWER,
    "the frames of tf, one message each: every link, operational points with axes of body and of "
    "`world`, device",
    rate="marker",
)
ROBOT_DESCRIPTION = Topic(
    "robot_description",
    "std_msgs/msg/String",
    VIEWER,
    "URDF text of the mechanism's tree, loops cut open",
    rate="change",
    qos="latched",
)
URDF_JOINTS = Topic(
    "joint_states",
    "sensor_msgs/msg/JointState",
    VIEWER,
    "positions and velocities of the joints of `robot_description`, passive ones included",
    rate="marker",
)
SEEN_POINT_COMMAND = Topic(
    "view/{point}/servo_cf",
    WRENCH,
    VIEWER,
    "`mechanism/{point}/servo_cf` in the frame `<point>_world`, for RViz",
    rate="marker",
)
SEEN_POINT_FORCE = Topic(
    "view/{point}/measured_cf",
    WRENCH,
    VIEWER,
    "`mechanism/{point}/measured_cf` in the frame `<point>_world`, for RViz",
    rate="marker",
)
SEEN_DEVICE_COMMAND = Topic(
    "view/device/servo_cf",
    WRENCH,
    VIEWER,
    "`device/servo_cf` in the frame `device_world`, for RViz",
    rate="marker",
)
SEEN_HAND_FORCE = Topic(
    "view/device/hand/measured_cf",
    WRENCH,
    VIEWER,
    "`device/hand/measured_cf` in the frame `device_world`, for RViz",
    rate="marker",
)

VIEW_TOPICS: tuple[Topic, ...] = (
    MARKERS,
    FRAMES,
    ROBOT_DESCRIPTION,
    URDF_JOINTS,
    SEEN_POINT_COMMAND,
    SEEN_POINT_FORCE,
    SEEN_DEVICE_COMMAND,
    SEEN_HAND_FORCE,
)
