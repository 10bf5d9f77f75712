# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Named frames: what tf says of a mechanism and a device, apart from its messages.

Every link is placed in ``world``; what is fixed in a link is placed there once and for all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import pinocchio as pin

from hapticmech_ros.mechanism.model import se3
from hapticmech_ros.scene import Scene
from hapticmech_ros.view.placement import Placement

WORLD = "world"
DEVICE = "device"
# A frame whose name a link has already gets this behind it.
SECOND = "_frame"


@dataclass(frozen=True, slots=True)
class NamedTransform:
    """One frame in another: ``pose`` takes coordinates of ``child`` to ``parent``, m."""

    parent: str
    child: str
    pose: pin.SE3


def moving_frames(
    scene: Scene,
    placement: Placement,
    devices: Mapping[str, pin.SE3] = MappingProxyType({}),
    users: Sequence[str] = ("",),
) -> list[NamedTransform]:
    """Return all frames that move, in ``world``.

    A frame per link under the link's name, ``<point>_world`` at every operational point with the
    axes of the world; ``device`` and ``device_world`` likewise, of each device whose pose is known.

    Args:
        scene: whose links and points they are.
        placement: where these are.
        devices: pose of each device that is known, by what is before its name.
        users: what is before the names of all devices.
    """
    names = frame_names(scene, users)
    found = [
        NamedTransform(WORLD, link.name, placement.links[link.name])
        for link in scene.links
        if link.joint.type != "fixed"
    ]
    found += [
        _upright(names[at_world(point.name)], placement.points[point.name])
        for point in scene.operational_points
    ]
    for user, device in devices.items():
        found.append(NamedTransform(WORLD, names[f"{user}{DEVICE}"], device))
        found.append(_upright(names[at_world(f"{user}{DEVICE}")], device))
    return found


def fixed_frames(scene: Scene) -> list[NamedTransform]:
    """Return all frames that stay where they are in a link: fixed links, operational points."""
    names = frame_names(scene)
    found = [
        NamedTransform(link.parent, link.name, se3(link.joint.origin))
        for link in scene.links
        if link.joint.type == "fixed"
    ]
    found += [
        NamedTransform(point.link, names[point.name], se3(point.origin))
        for point in scene.operational_points
    ]
    return found


def at_world(name: str) -> str:
    """Return what the frame at the origin of another, with the axes of the world, is called."""
    return f"{name}_{WORLD}"


def frame_names(scene: Scene, users: Sequence[str] = ("",)) -> dict[str, str]:
    """Return the frames of points and devices -> their names, which no link nor other frame has.

    Args:
        scene: whose points they are.
        users: what is before the names of devices, one for each: nothing, or ``left/``.
    """
    taken = {WORLD, *(link.name for link in scene.links)}
    names: dict[str, str] = {}
    points = [point.name for point in scene.operational_points]
    devices = [f"{user}{DEVICE}" for user in users]
    for wanted in (w for name in (*points, *devices) for w in (name, at_world(name))):
        name = wanted
        while name in taken:
            name += SECOND
        taken.add(name)
        # A point called `device` has the name first; the device's own frame gives way.
        names.setdefault(wanted, name)
    return names


def _upright(name: str, pose: pin.SE3) -> NamedTransform:
    return NamedTransform(WORLD, name, pin.SE3(np.eye(3), pose.translation))
