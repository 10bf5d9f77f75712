# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where everything that is drawn of a mechanism is, at a configuration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.model import se3
from hapticmech_ros.view.skeleton import attachments

# Frames nearer than this (m) to a link's own are at its joint: no limb.
_SAME_PLACE = 1e-9


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
    """Places one mechanism; holds scratch data of its own.

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
    """Return link names and ends in the link: whatever is attached, or else the centre of mass."""
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
