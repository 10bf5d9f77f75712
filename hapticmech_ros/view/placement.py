# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where everything that is drawn of a mechanism is, at a configuration.

The mechanism as lines, for pictures: links between their joints, at a configuration.

Named frames of a mechanism and a device for tf, apart from its messages.

Every link is placed in ``world``; frames fixed in a link are static there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import pinocchio as pin

from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.model import se3
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Origin

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
        devices: pose of each device that is known, by the prefix of its name.
        users: prefixes of the names of all devices.
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
    """Return the name of the frame at the origin of another, with the axes of the world."""
    return f"{name}_{WORLD}"


def frame_names(scene: Scene, users: Sequence[str] = ("",)) -> dict[str, str]:
    """Return the frames of points and devices -> their names, which no link nor other frame has.

    Args:
        scene: whose points they are.
        users: prefixes of the names of devices, one for each: empty, or ``left/``.
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
        # A point called `device` has priority; the device's own frame gets another name.
        names.setdefault(wanted, name)
    return names


def _upright(name: str, pose: pin.SE3) -> NamedTransform:
    return NamedTransform(WORLD, name, pin.SE3(np.eye(3), pose.translation))


# Frames nearer than this (m) to a link's own are at its joint: no line.
_SAME_PLACE = 1e-9


@dataclass(frozen=True, slots=True)
class Skeleton:
    """Lines and joints of a mechanism at one configuration.

    Attributes:
        links: per line, link name and (2, 3) its ends in the world, m.
        joints: (k, 3) where links are joined to each other, m.
        ground: (g, 3) where they are joined to the world, m.
        bars: (2, 3) ends of every rod that is closed at the start, and of every slide from where
            it is at zero, m.
    """

    links: tuple[tuple[str, Array], ...]
    joints: Array
    ground: Array
    bars: tuple[Array, ...] = ()


def skeleton(scene: Scene, q: Array) -> Skeleton:
    """Return the lines of ``scene`` at configuration q (nq,).

    A link is drawn from its own joint to every frame that something else is attached to.

    Args:
        scene: whose.
        q: (nq,) configuration.
    """
    placement = Placer(Mechanism(scene)).at(np.asarray(q, dtype=float))
    frames = {**placement.links, WORLD: pin.SE3.Identity()}

    def place(link: str, origin: Origin) -> Array:
        return np.array((frames[link] * se3(origin)).translation)

    held = attachments(scene)
    attached = {name for name, _, _ in held}
    lines = tuple((name, ends) for name, ends in placement.limbs if name in attached)
    joints = [place(name, origin) for name, origin, joins in held if joins and name != WORLD]
    ground = [
        place(WORLD, link.joint.origin)
        for link in scene.links
        if link.parent == WORLD and link.joint.type not in ("free", "planar")
    ]
    ground += [place(name, origin) for name, origin, _ in held if name == WORLD]
    rods = [
        np.array([place(end.link, end.origin) for end in (rod.a, rod.b)])
        for rod in scene.closures
        if rod.kind == "rod" and rod.active
    ]
    bars = (*rods, *placement.slides)
    long = tuple(bar for bar in bars if np.linalg.norm(bar[1] - bar[0]) > _SAME_PLACE)
    return Skeleton(lines, _rows(joints), _rows(ground), long)


def attachments(scene: Scene) -> list[tuple[str, Origin, bool]]:
    """Return link, frame in it, and whether it is a joint, for everything attached to a link.

    Joints of other links, closures (whether closed or not; their frames may be in ``world``) and
    operational points.
    """
    found = [
        (link.parent, link.joint.origin, True) for link in scene.links if link.parent != "world"
    ]
    for closure in scene.closures:
        found += [(end.link, end.origin, True) for end in (closure.a, closure.b)]
    found += [(point.link, point.origin, False) for point in scene.operational_points]
    return found


def _rows(points: list[Array]) -> Array:
    return np.array(points).reshape(-1, 3)


@dataclass(frozen=True, slots=True)
class Placement:
    """Poses in the world, m.

    Attributes:
        links: link name -> frame of the link, which is where its joint is.
        axes: link name -> axis of its joint in the world, a unit vector.
        limbs: link name and (2, 3) ends, for every part of a link that is worth a line.
        closures: closure name -> frames a and b.
        rods: names of the closures that keep a distance.
        slides: (2, 3) of every prismatic joint, where it is at zero and where it is.
        springs: (2, 3) ends of every spring between two points.
        solids: frames of the shapes that may touch.
        points: operational point name -> its frame.
    """

    links: dict[str, pin.SE3]
    axes: dict[str, Array]
    limbs: tuple[tuple[str, Array], ...]
    closures: dict[str, tuple[pin.SE3, pin.SE3]]
    rods: frozenset[str]
    slides: tuple[Array, ...]
    springs: tuple[Array, ...]
    solids: tuple[pin.SE3, ...]
    points: dict[str, pin.SE3]


class Placer:
    """Places one mechanism; holds its own scratch data.

    Attributes:
        limbs: link name and (3,) end in the link's frame of every limb; it begins at the origin.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        scene, tree = mechanism.scene, mechanism.tree
        self._model = mechanism.model
        self._data = self._model.createData()
        self._links = {link.name: tree.link_joint[link.name] for link in scene.links}
        self._axes = {
            link.name: np.array(link.joint.axis) / np.linalg.norm(link.joint.axis)
            for link in scene.links
        }
        self._closures = {
            c.name: (c.frame_a, c.frame_b) for c in mechanism.closures if c.kind != "coupling"
        }
        self._rods = frozenset(c.name for c in mechanism.closures if c.kind == "rod")
        self._points = {
            point.name: (*self._links[point.link], se3(point.origin))
            for point in scene.operational_points
        }
        self._slides = [
            ((link.parent, se3(link.joint.origin)), (link.name, pin.SE3.Identity()))
            for link in scene.links
            if link.joint.type == "prismatic"
        ]
        self._springs = [
            ((spring.a.link, se3(spring.a.origin)), (spring.b.link, se3(spring.b.origin)))
            for spring in scene.springs
        ]
        self._solids = [(shape.link, se3(shape.origin)) for shape in scene.shapes]
        self.limbs = _limbs(mechanism)

    def at(self, q: Array) -> Placement:
        """Return where everything is at q (nq,).

        Args:
            q: (nq,) configuration.
        """
        data = self._data
        pin.forwardKinematics(self._model, data, q)
        pin.updateFramePlacements(self._model, data)
        links = {name: data.oMi[joint] * local for name, (joint, local) in self._links.items()}
        carriers = {**links, "world": pin.SE3.Identity()}

        def line(ends: tuple[tuple[str, pin.SE3], tuple[str, pin.SE3]]) -> Array:
            return np.array([(carriers[link] * frame).translation for link, frame in ends])

        limbs = tuple(
            (name, np.array((links[name].translation, links[name] * end)))
            for name, end in self.limbs
        )
        return Placement(
            links,
            {name: links[name].rotation @ axis for name, axis in self._axes.items()},
            limbs,
            {n: (data.oMf[a].copy(), data.oMf[b].copy()) for n, (a, b) in self._closures.items()},
            self._rods,
            tuple(line(ends) for ends in self._slides),
            tuple(line(ends) for ends in self._springs),
            tuple(carriers[link] * frame for link, frame in self._solids),
            {n: data.oMi[j] * local * origin for n, (j, local, origin) in self._points.items()},
        )


def _limbs(mechanism: Mechanism) -> list[tuple[str, Array]]:
    """Return link names and ends in the link: of attached frames, or else the centre of mass."""
    scene = mechanism.scene
    found: list[tuple[str, Array]] = []
    for name, origin, _ in attachments(scene):
        end = np.array(origin.xyz)
        known = any(link == name and np.linalg.norm(end - e) <= _SAME_PLACE for link, e in found)
        if name != "world" and np.linalg.norm(end) > _SAME_PLACE and not known:
            found.append((name, end))
    attached = {name for name, _, _ in attachments(scene)}
    for link in scene.links:
        com = np.array(link.inertial.com)
        if link.name not in attached and np.linalg.norm(com) > _SAME_PLACE:
            found.append((link.name, com))
    return found
