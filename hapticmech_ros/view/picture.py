# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The whole picture: shapes of mechanism, devices and forces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.numerics import Array
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.contacts import Box, Capsule, Cylinder, Geometry, HalfSpace, Sphere
from hapticmech_ros.view import palette
from hapticmech_ros.view.palette import PLAIN, Look, looks
from hapticmech_ros.view.placement import Placement
from hapticmech_ros.view.shapes import (
    Scales,
    Shape,
    axes,
    box,
    capsule,
    closure_shapes,
    cylinder,
    direction_shapes,
    directions,
    joint_shapes,
    link_shapes,
    moving_with,
    numbered,
    rotation_to,
    sphere,
    strip,
    text,
    wrench_shapes,
)

# As shares of the mechanism's length: a half-space is drawn as a plate below its plane.
PLATE_SIDE, PLATE_THICKNESS = 1.2, 0.06
SPRING_WIDTH, COIL_RADIUS = 0.02, 0.05
COILS = 6


def solid_shapes(scene: Scene, placement: Placement, unit: float) -> list[Shape]:
    """Return every shape that may touch; of meshes none."""
    shapes: list[Shape] = []
    for shape, pose in zip(scene.shapes, placement.solids, strict=True):
        shapes += moving_with(shape.link, _solid(shape.geometry, pose, unit))
    return numbered("solids", shapes)


def spring_shapes(placement: Placement, unit: float) -> list[Shape]:
    """Return a line with as many coils, however long it is, for every spring between points."""
    width, colour = SPRING_WIDTH * unit, palette.MEANING["springs"]
    coils = [_coils(ends, COIL_RADIUS * unit) for ends in placement.springs]
    return numbered("springs", [strip(coil, width, colour) for coil in coils])


def _solid(geometry: Geometry, pose: pin.SE3, unit: float) -> list[Shape]:
    centre, along = pose.translation, pose.rotation[:, 2]
    match geometry:
        case Sphere():
            return [sphere(centre, 2.0 * geometry.radius, palette.SOLID)]
        case Box():
            return [box(pose, geometry.size, palette.SOLID)]
        case Cylinder():
            return [cylinder(centre, geometry.length * along, 2.0 * geometry.radius, palette.SOLID)]
        case Capsule():
            half = 0.5 * geometry.length * along
            return capsule(centre - half, centre + half, 2.0 * geometry.radius, palette.SOLID)
        case HalfSpace():
            side, thick = PLATE_SIDE * unit, PLATE_THICKNESS * unit
            below = pose * pin.SE3(np.eye(3), np.array((0.0, 0.0, -0.5 * thick)))
            return [box(below, (side, side, thick), palette.SOLID)]
        case _:
            return []


def _coils(ends: Array, radius: float) -> Array:
    """Return corners (n, 3) of a zigzag between two points, straight at its ends."""
    shares = np.linspace(0.15, 0.85, 2 * COILS + 1)
    across = np.where(np.arange(shares.size) % 2 == 0, 1.0, -1.0) * radius
    across[0] = across[-1] = 0.0
    start, end = ends
    sides = rotation_to(end - start)[:, :2]
    aside = sides[:, int(np.argmin(np.abs(sides[2])))]  # in the plane, of a planar scene
    turns = start + shares[:, None] * (end - start) + across[:, None] * aside
    return np.vstack((start, turns, end))


# Sizes as shares of the mechanism's characteristic length, or of its longest rod.
AXIS_LENGTH = 0.25
AXIS_SHAFT = 0.025
DEVICE_DIAMETER = 0.14
LETTER_HEIGHT = 0.14
LETTERS_ABOVE = 0.6


@dataclass(frozen=True, slots=True)
class UserSnapshot:
    """One user's state at one time; parts that are None are not drawn.

    Attributes:
        point: operational point that is held.
        device: its pose.
        hand_wrench: (6,) F_h, by the hand, on the device, N and N m, world axes.
        device_command: (6,) by the device, on the hand, likewise.
        analysis: spectrum of the point held.
        count: joint constraints felt there.
    """

    point: str
    device: pin.SE3 | None = None
    hand_wrench: Array | None = None
    device_command: Array | None = None
    analysis: OperationalAnalysis | None = None
    count: int = 0


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The whole state at one time; missing parts are not drawn.

    Attributes:
        active: per closure, whether it is closed.
        users: who hold the mechanism, in their order.
        contacts: operational point -> (6,) F_c, by the environment, on the mechanism.
        point_commands: operational point -> (6,) by the hand through the controller.
    """

    active: Active
    users: tuple[UserSnapshot, ...] = ()
    contacts: Mapping[str, Array] = field(default_factory=dict)
    point_commands: Mapping[str, Array] = field(default_factory=dict)


class Picture:
    """Draws snapshots of one mechanism.

    Args:
        mechanism: to draw.
        force_scale: length of arrows, m per N.
        torque_scale: radius of rings, m per N m.
    """

    def __init__(self, mechanism: Mechanism, force_scale: float, torque_scale: float) -> None:
        self._scene = mechanism.scene
        self._closures = [closure.name for closure in mechanism.closures]
        rods = [closure.length for closure in mechanism.scene.closures if closure.length]
        self._scales = Scales(max(mechanism.length, *rods, 0.0), force_scale, torque_scale)

    def draw(self, snapshot: Snapshot, placement: Placement) -> list[Shape]:
        """Return the shapes; the same part has the same key in every picture.

        Raises:
            InvalidInputError: more constraints counted than there are directions.
        """
        unit = self._scales.unit
        closed = dict(zip(self._closures, snapshot.active, strict=True))
        shapes = [
            *solid_shapes(self._scene, placement, unit),
            *spring_shapes(placement, unit),
            *link_shapes(self._scene, placement, unit),
            *joint_shapes(self._scene, placement, unit),
            *closure_shapes(placement, closed, unit),
        ]
        for point in self._scene.operational_points:
            found = _point(point.name, placement.points[point.name], unit)
            shapes += moving_with(point.link, found)
        look_of = looks([user.point for user in snapshot.users])
        shapes += self._point_wrenches(snapshot, placement, look_of)
        for user in snapshot.users:
            shapes += self._user(user, placement, look_of[user.point])
        return shapes

    def _point_wrenches(
        self, snapshot: Snapshot, placement: Placement, look_of: Mapping[str, Look]
    ) -> list[Shape]:
        shapes: list[Shape] = []
        for number, (name, pose) in enumerate(placement.points.items()):
            for meaning, wrenches in (
                ("contact_force", snapshot.contacts),
                ("point_command", snapshot.point_commands),
            ):
                if name in wrenches:
                    place, look = pose.translation, look_of.get(name, PLAIN)
                    shapes += wrench_shapes(
                        meaning, number, place, wrenches[name], self._scales, look
                    )
        return shapes

    def _user(self, user: UserSnapshot, placement: Placement, look: Look) -> list[Shape]:
        unit, shapes = self._scales.unit, []
        if user.device is not None:
            shapes += _device(user.device, unit, look)
            place = user.device.translation
            for meaning, given in (
                ("hand_force", user.hand_wrench),
                ("device_command", user.device_command),
            ):
                if given is not None:
                    shapes += wrench_shapes(meaning, 0, place, given, self._scales, look)
        if user.analysis is not None:
            place = placement.points[user.point].translation
            shapes += _directions(user.analysis, user.count, place, unit, look)
        return shapes


def count_words(count: int) -> str:
    """Return a number of joint constraints in words."""
    return "1 joint constraint" if count == 1 else f"{count} joint constraints"


def _point(name: str, pose: pin.SE3, unit: float) -> list[Shape]:
    length, shaft = AXIS_LENGTH * unit, AXIS_SHAFT * unit
    upright = pin.SE3(np.eye(3), pose.translation)
    body = axes(pose, length, shaft, palette.AXES)
    world = axes(upright, 1.5 * length, 0.5 * shaft, palette.WORLD_AXES)
    return [*numbered(f"point/{name}", body), *numbered(f"point/{name}_world", world)]


def _device(pose: pin.SE3, unit: float, look: Look) -> list[Shape]:
    ball = sphere(pose.translation, DEVICE_DIAMETER * unit, look.colour("device"))
    cross = axes(pose, 0.8 * AXIS_LENGTH * unit, 1.5 * AXIS_SHAFT * unit, palette.AXES)
    return numbered(look.namespace("device"), [ball, *cross])


def _directions(
    analysis: OperationalAnalysis, count: int, place: Array, unit: float, look: Look
) -> list[Shape]:
    rigid, free = directions(analysis, count)
    above = place + np.array((0.0, 0.0, LETTERS_ABOVE * unit))
    letters = text(
        above, look.words(count_words(count)), LETTER_HEIGHT * unit, look.colour("count")
    )
    return [
        *direction_shapes("rigid_directions", rigid, place, unit, look),
        *direction_shapes("free_directions", free, place, unit, look),
        *numbered(look.namespace("count"), [letters]),
    ]
