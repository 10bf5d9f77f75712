# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files that people bring: URDF, MJCF and SDF become the links, joints and closures of a scene."""

from hapticmech_ros.formats.model import Imported, Note
from hapticmech_ros.formats.reading import (
    DrawnShape,
    LeftOut,
    drawn_shapes,
    expand,
    left_out,
    read_model,
)

__all__ = [
    "DrawnShape",
    "Imported",
    "LeftOut",
    "Note",
    "drawn_shapes",
    "expand",
    "left_out",
    "read_model",
]
