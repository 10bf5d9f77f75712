# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The arm in the file of a robot: its weight, and a gripper whose fingers stand still."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.scene import Scene

# m/s². URDF does not say where down is; by convention z is up.
EARTH = np.array([0.0, 0.0, -9.81])
NO_GRAVITY = np.empty(0)


def load_arm(file: str, gravity: Array = NO_GRAVITY) -> Scene:
    """Return the arm of a robot's file.

    Args:
        file: scene, URDF, MJCF or SDF, or the name of a shipped scene.
        gravity: (3,) m/s², world axes; empty: as in the file, and of a URDF file downwards along z.
            Zero for a robot whose own controller carries its weight.

    Raises:
        SceneError: as :func:`~hapticmech_ros.loading.load_scene`.
        InvalidInputError: gravity is not three numbers.
    """
    scene = arm_of(load_scene(file))
    if gravity.size == 0:
        if Path(file).suffix.lower() != ".urdf":
            return scene
        gravity = EARTH
    if gravity.shape != (3,) or not np.isfinite(gravity).all():
        raise InvalidInputError("gravity", gravity, "must be three numbers")
    return scene.model_copy(update={"gravity": tuple(gravity.tolist())})


def arm_of(scene: Scene) -> Scene:
    """Return a scene without couplings, whose joints are locked where they start.

    Their motors have a controller of their own, and what little they move changes the arm's
    inertia by less than a payload does.

    Args:
        scene: of a robot.
    """
    if not scene.couplings:
        return scene
    coupled = {name for one in scene.couplings for name in (one.joint, one.leader)}
    locked = {"locked": True}
    links = tuple(
        link.model_copy(update={"joint": link.joint.model_copy(update=locked)})
        if link.joint.name in coupled
        else link
        for link in scene.links
    )
    return scene.model_copy(update={"links": links, "couplings": ()})
