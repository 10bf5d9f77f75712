# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes: documents become a validated, frozen :class:`Scene`."""

from hapticmech_ros.scene.scene import Scene, document_of, scene_from_document

__all__ = ["Scene", "document_of", "scene_from_document"]
