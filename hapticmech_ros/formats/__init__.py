"""Files that people bring: URDF, MJCF and SDF become the links, joints and closures of a scene."""

from hapticmech_ros.formats.model import Imported, Note
from hapticmech_ros.formats.reading import (
    LeftOut,
    expand,
    left_out,
    read_model,
    scene_of,
    shapes_left_out,
)

__all__ = [
    "Imported",
    "LeftOut",
    "Note",
    "expand",
    "left_out",
    "read_model",
    "scene_of",
    "shapes_left_out",
]
