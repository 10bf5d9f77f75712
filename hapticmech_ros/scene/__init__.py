# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is modelled: files and documents become a validated, frozen :class:`Scene`."""

from hapticmech_ros.scene.document import Scene
from hapticmech_ros.scene.loader import changed_scene, document_of, load_scene, shipped_scenes
from hapticmech_ros.scene.validation import scene_from_document

__all__ = [
    "Scene",
    "changed_scene",
    "document_of",
    "load_scene",
    "scene_from_document",
    "shipped_scenes",
]
