# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Visualisation: shapes, frames, joint positions and URDF text. It uses no ROS and no clock."""

from hapticmech_ros.view.picture import Picture, Snapshot, UserSnapshot
from hapticmech_ros.view.placement import (
    NamedTransform,
    Placement,
    Placer,
    fixed_frames,
    moving_frames,
)
from hapticmech_ros.view.shapes import Shape, vanished
from hapticmech_ros.view.urdf import JointStates, urdf_of

__all__ = [
    "JointStates",
    "NamedTransform",
    "Picture",
    "Placement",
    "Placer",
    "Shape",
    "Snapshot",
    "UserSnapshot",
    "fixed_frames",
    "moving_frames",
    "urdf_of",
    "vanished",
]
