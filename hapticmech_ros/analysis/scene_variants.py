# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Copies of scenes with one change: gains, rate, hand, device or inertias."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.errors import (
    InvalidInputError,
    check_not_negative,
    check_one_of,
    check_positive,
)
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.controller import PositionChannelGains
from hapticmech_ros.scene.device import Device, device_presets
from hapticmech_ros.scene.hand import ConstantWrenchHand, Hand, TargetHand, Waypoint
from hapticmech_ros.scene.mechanism import Inertial

# Whether the device closes force channel and joint constraint, by name of the loop.
LOOPS = {"device": True, "controller": False}
NO_HAND = ConstantWrenchHand(kind="constant_wrench")
NO_CHANNEL = PositionChannelGains(
    stiffness=0.0, damping=0.0, angular_stiffness=0.0, angular_damping=0.0
)


def of_first_user(scene: Scene) -> Scene:
    """Return a scene as the user of its first operational point has it, without other hands."""
    return scene.held_at(scene.operational_points[0].name)


def at_once(scene: Scene) -> Scene:
    """Return a scene without engagement ramp and without passivity control."""
    free = scene.controller.passivity.model_copy(update={"control": False})
    changed = {"engagement_ramp": 0.0, "passivity": free}
    return scene.model_copy(update={"controller": scene.controller.model_copy(update=changed)})


def held_by_nobody(scene: Scene) -> Scene:
    """Return a scene whose hand exerts no wrench."""
    return scene.model_copy(update={"hand": NO_HAND})


def held_still(scene: Scene) -> Scene:
    """Return a scene whose hand grasps at once and stays there; see :func:`still`."""
    return scene.model_copy(update={"hand": still(scene.hand)})


def still(hand: Hand) -> Hand:
    """Return a hand without waypoints and delays; one that has no waypoints is unchanged."""
    if not isinstance(hand, TargetHand):
        return hand
    calm = {"start_delay": 0.0, "release_at": (), "grab_at": (), "tremor": None}
    return hand.model_copy(update={**calm, "waypoints": (Waypoint(time=0.0),)})


def with_constraint(scene: Scene, stiffness: float, damping: float) -> Scene:
    """Return a scene with other joint-constraint gains, N/m and N s/m.

    Raises:
        InvalidInputError: a gain that is negative or not finite.
    """
    check_not_negative(stiffness=stiffness, damping=damping)
    joint = scene.controller.joint_constraint.model_copy(
        update={"stiffness": stiffness, "damping": damping}
    )
    controller = scene.controller.model_copy(update={"joint_constraint": joint})
    return scene.model_copy(update={"controller": controller})


def without_channel(scene: Scene) -> Scene:
    """Return a scene without position channels."""
    controller = scene.controller.model_copy(update={"position_channel": NO_CHANNEL})
    return scene.model_copy(update={"controller": controller})


def with_loop(scene: Scene, local: bool) -> Scene:
    """Return a scene whose device closes force channel and joint constraint if ``local``."""
    return scene.model_copy(update={"controller": scene.controller.closed_in_device(local)})


def with_device(scene: Scene, preset: str) -> Scene:
    """Return a scene with another device and gains for it, named after both.

    Raises:
        InvalidInputError: an unknown preset.
    """
    check_one_of("device", preset, sorted(device_presets()))
    device = Device.model_validate({"preset": preset})
    return scene.model_copy(update={"name": f"{scene.name}_{preset}", "device": device})


def at_rate(scene: Scene, rate_hz: float) -> Scene:
    """Return a scene with another control rate, Hz.

    Raises:
        InvalidInputError: a rate below 10 Hz or not finite.
    """
    if not (np.isfinite(rate_hz) and rate_hz >= 10.0):
        raise InvalidInputError("rate", rate_hz, "must be 10 Hz or more")
    return scene.stepped(period=1.0 / rate_hz)


def scaled(scene: Scene, factor: float) -> Scene:
    """Return a scene with all inertias multiplied by ``factor``, which divides X by it.

    The metric is scaled too: the same directions are rigid, with the same stiffness.

    Raises:
        InvalidInputError: a factor that is not positive and finite.
    """
    check_positive(factor=factor)
    links = tuple(
        link.model_copy(update={"inertial": _heavier(link.inertial, factor)})
        for link in scene.links
    )
    points = tuple(
        point
        if point.metric is None
        else point.model_copy(
            update={"metric": point.metric.model_copy(update={"mass": factor * point.metric.mass})}
        )
        for point in scene.operational_points
    )
    return scene.model_copy(update={"links": links, "operational_points": points})


def _heavier(inertial: Inertial, factor: float) -> Inertial:
    inertia = inertial.inertia
    parts = {name: factor * getattr(inertia, name) for name in type(inertia).model_fields}
    changed = {"mass": factor * inertial.mass, "inertia": inertia.model_copy(update=parts)}
    return inertial.model_copy(update=changed)
