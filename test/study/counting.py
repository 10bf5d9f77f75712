# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Measures of a user's own, for tests of studies: workers import them by their names."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Mapping
from pathlib import Path

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.scene import Scene
from hapticmech_ros.study.parameter_study import ROWS

# A file for each scene that is measured, named after its mass.
FOLDER = "HAPTICMECH_TEST_STUDY"


def mass(scene: Scene, point: str) -> Mapping[str, float]:
    """Return the device's mass, and note that it was asked for."""
    with (Path(os.environ[FOLDER]) / repr(scene.device.mass)).open("a") as file:
        file.write("x")
    return {"mass": scene.device.mass, "double": 2.0 * scene.device.mass}


def deadly(scene: Scene, point: str) -> Mapping[str, float]:
    """End the process of a scene whose device has 0.2 kg, and fail at 0.5."""
    found = mass(scene, point)
    if scene.device.mass == 0.2:
        os.kill(os.getpid(), signal.SIGKILL)
    if scene.device.mass == 0.5:
        raise HapticMechError("half a kilogram")
    return found


def changing(scene: Scene, point: str) -> Mapping[str, float]:
    """Return other numbers of heavy devices."""
    return {"heavy": 1.0} if scene.device.mass > 0.35 else {"light": 1.0}


def late_end(scene: Scene, point: str) -> Mapping[str, float]:
    """End this process's parent, which runs the study, at 0.4 kg, once it has written rows."""
    found, folder = mass(scene, point), Path(os.environ[FOLDER])
    if scene.device.mass == 0.4 and not (folder / "spared").exists():
        until = time.monotonic() + 60.0
        while (folder.parent / "out" / ROWS).stat().st_size == 0 and time.monotonic() < until:
            time.sleep(0.01)
        os.kill(os.getppid(), signal.SIGKILL)
    return found
