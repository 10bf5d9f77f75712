# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Real devices that a scene can name: figures and their sources, from ``config/devices``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any

from hapticmech_ros.share import shared
from hapticmech_ros.yaml_text import read_yaml


@dataclass(frozen=True, slots=True)
class DevicePreset:
    """A real device.

    Attributes:
        name: in scenes.
        description: manufacturer and model, and what it moves.
        sources: where figures are from.
        chosen: keys whose figure nobody published, and how it was chosen.
        device: keys of a scene's ``device``, SI units.
    """

    name: str
    description: str
    sources: tuple[str, ...]
    chosen: Mapping[str, str]
    device: Mapping[str, Any]


@cache
def device_presets() -> Mapping[str, DevicePreset]:
    """Return the devices that come with the package, by name."""
    folder = shared("config/devices")
    found = {}
    for path in sorted(folder.glob("*.yaml")) if folder is not None else ():
        said = read_yaml(path.read_text(encoding="utf-8"), str(path))
        found[path.stem] = DevicePreset(
            path.stem,
            said["description"],
            tuple(said["sources"]),
            MappingProxyType(said["chosen"]),
            MappingProxyType(said["device"]),
        )
    return MappingProxyType(found)


def with_preset(given: object) -> object:
    """Return what a scene says of its device, with the preset's figures where it says nothing.

    In ``workspace`` and ``compensation`` too, each key stands for itself. A preset that nobody
    knows adds nothing.
    """
    if not isinstance(given, Mapping) or not isinstance(given.get("preset"), str):
        return given
    preset = device_presets().get(given["preset"])
    if preset is None:
        return given
    joined = {**preset.device, **given}
    for key, value in preset.device.items():
        own = given.get(key)
        if isinstance(value, Mapping) and isinstance(own, Mapping):
            joined[key] = {**value, **own}
    return joined
