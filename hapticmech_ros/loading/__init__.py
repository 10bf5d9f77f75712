# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files become scenes: YAML, the files that it names, and the models of ``formats``."""

from hapticmech_ros.loading.loader import find_scene, load_scene, shipped_scenes

__all__ = ["find_scene", "load_scene", "shipped_scenes"]
