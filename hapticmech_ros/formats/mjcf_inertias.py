# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The inertia of a body in MJCF: as written, or that of its geoms.

Rotors of actuators add to the inertia of the joints that they drive.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import pi

import numpy as np
import pinocchio as pin

from hapticmech_ros.formats.mjcf_classes import ACTUATOR, UP, Context, NotCompiledError
from hapticmech_ros.formats.model import WHY_ELSEWHERE, Body, Joint
from hapticmech_ros.formats.xml_nodes import Node

OF_TENDON, ELSEWHERE = "armature of a tendon", "armature of an actuator on no hinge or slide"
WHY = {OF_TENDON: WHY_ELSEWHERE, ELSEWHERE: WHY_ELSEWHERE}
_JOINT_KEYS = ("joint", "jointinparent")


def with_rotors(context: Context, hinges: Sequence[Joint], notes: Counter[str]) -> list[Joint]:
    """Return joints with the inertia of rotors that drive them: gear ratio squared times theirs.

    Args:
        context: the file.
        hinges: its joints.
        notes: counts rotors that are left out.
    """
    source = context.source
    alone = {hinge.name for hinge in hinges if hinge.type in ("revolute", "prismatic")}
    added: dict[str, float] = {}
    for section in source.root.all("tendon"):
        for tendon in section.children:
            full = context.full(tendon)
            notes[OF_TENDON] += source.value(full, "armature", 0.0) != 0.0
    for section in source.root.all(ACTUATOR):
        for actuator in section.children:
            full = context.full(actuator)
            armature = source.value(full, "armature", 0.0)
            if armature == 0.0:
                continue
            named = [full.attributes[key].strip() for key in _JOINT_KEYS if key in full.attributes]
            if len(named) != 1 or named[0] not in alone:
                notes[ELSEWHERE] += 1
                continue
            gear = context.padded(full, "gear", (1.0,) + (0.0,) * 5)[0]
            added[named[0]] = added.get(named[0], 0.0) + gear * gear * armature
    return [replace(one, armature=one.armature + added.get(one.name, 0.0)) for one in hinges]


# How many sizes a shape has, of which the last is half its length where that is from here to there.
SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}
WATER = 1000.0
GIVE = "give the body an <inertial>"
Geom = tuple[Node, pin.SE3]


def body_of(context: Context, name: str, inertial: Node | None, geoms: Iterable[Geom]) -> Body:
    """Return a body with its inertia.

    Args:
        context: the file.
        name: of the body.
        inertial: its element, or None.
        geoms: its geoms with their defaults, and the frames that they are in.

    Raises:
        SceneError: the element is not whole, or a geom of no known inertia counts.
    """
    compiler = context.compiler
    policy = context.word(compiler, "inertiafromgeom", "auto")
    if policy not in ("auto", "true", "false"):
        rule = "inertiafromgeom must be auto, true or false"
        raise context.source.error(compiler, policy, rule)
    if inertial is not None and policy != "true":
        found = _written(context, name, inertial)
    elif policy == "false":
        found = Body(name)
    else:
        try:
            total = _of_geoms(context, geoms)
        except _NotSimple as geom:
            found = _compiled(context, name, geom)
        else:
            found = Body(name, float(total.mass), np.array(total.lever), np.array(total.inertia))
    return _bounded(context, found)


class _NotSimple(Exception):
    """A geom that counts has no shape of ``SIZES``, or is a shell.

    Attributes:
        node: the geom.
        shape: of it.
    """

    def __init__(self, node: Node, shape: str) -> None:
        self.node, self.shape = node, shape
        super().__init__(shape)


def _compiled(context: Context, name: str, geom: _NotSimple) -> Body:
    """Return a body as MuJoCo compiles it.

    Raises:
        SceneError: it cannot be compiled, or the compiler joined the body with another.
    """
    try:
        found = context.compiled().get(name)
    except NotCompiledError as error:
        rule = f"the inertia of a {geom.shape} has no closed form: {GIVE}; {error}"
        raise context.source.error(geom.node, geom.shape, rule) from None
    if found is None:
        rule = f"MuJoCo, which computes the inertia of a {geom.shape}, has no such body: {GIVE}"
        raise context.source.error(geom.node, geom.shape, rule)
    return found


def _bounded(context: Context, found: Body) -> Body:
    """Return the body, with what the compiler is told to do about too small an inertia."""
    value = context.source.value
    mass = max(found.mass, value(context.compiler, "boundmass", 0.0))
    inertia, least = found.inertia, value(context.compiler, "boundinertia", 0.0)
    balance = context.flag(context.compiler, "balanceinertia")
    if least > 0.0 or balance:
        moments, axes = np.linalg.eigh(inertia)
        moments = np.maximum(moments, least)
        if balance and moments[0] + moments[1] < moments[2]:
            moments = np.full(3, moments.mean())
        inertia = (axes * moments) @ axes.T
    return Body(found.name, mass, found.com, inertia)


def _written(context: Context, name: str, node: Node) -> Body:
    source = context.source
    mass = source.value(node, "mass")
    source.text(node, "pos")
    place = context.place(node)
    if "fullinertia" in node.attributes:
        if place.rotation.tolist() != np.eye(3).tolist() or "diaginertia" in node.attributes:
            rule = "fullinertia is in the axes of the body, and all there is"
            raise source.error(node, node.attributes["fullinertia"], rule)
        xx, yy, zz, xy, xz, yz = source.values(node, "fullinertia", (0.0,) * 6)
        own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    else:
        own = np.diag(source.values(node, "diaginertia", (0.0, 0.0, 0.0)))
    turned = place.rotation @ own @ place.rotation.T
    return Body(name, mass, place.translation.copy(), turned)


def _of_geoms(context: Context, geoms: Iterable[Geom]) -> pin.Inertia:
    first, last = context.source.values(context.compiler, "inertiagrouprange", (0.0, 5.0))
    total = pin.Inertia.Zero()
    for node, frame in geoms:
        if first <= context.source.value(node, "group", 0.0) <= last:
            own = _of_geom(context, node)
            if own is not None:
                total += own.se3Action(frame)
    return total


def _of_geom(context: Context, node: Node) -> pin.Inertia | None:
    """Return the inertia of a geom in what it is in; None if it has no mass."""
    source = context.source
    weighed = "mass" in node.attributes
    weight = source.value(node, "mass" if weighed else "density", WATER)
    if weight == 0.0:
        return None
    if weight < 0.0:
        raise source.error(node, weight, "mass and density must not be negative")
    shape = context.word(node, "type", "sphere")
    if shape not in SIZES or "mesh" in node.attributes:
        raise _NotSimple(node, "mesh" if "mesh" in node.attributes else shape)
    if context.flag(node, "shellinertia"):
        raise _NotSimple(node, "shell")
    sizes, place = shape_of(context, node)
    if min(sizes) <= 0.0:
        raise source.error(node, sizes, f"a {shape} needs {SIZES[shape]} size(s) above zero")
    volume, moments = _solid(shape, sizes)
    mass = weight if weighed else weight * volume
    return pin.Inertia(mass, np.zeros(3), np.diag(mass * moments)).se3Action(place)


def shape_of(context: Context, node: Node) -> tuple[tuple[float, ...], pin.SE3]:
    """Return the sizes of a geom or site that count, and where it is.

    Raises:
        SceneError: a ``fromto`` without a length.
    """
    count = SIZES.get(context.word(node, "type", "sphere"), 0)
    sizes = context.padded(node, "size", (0.0, 0.0, 0.0))
    place = context.place(node)
    if count > 1 and "fromto" in node.attributes:
        ends = np.array(context.source.values(node, "fromto", (0.0,) * 6)).reshape(2, 3)
        along = ends[0] - ends[1]
        half = 0.5 * float(np.linalg.norm(along))
        if not half > 0.0:
            raise context.source.error(node, node.attributes["fromto"], "must have a length")
        turn = pin.Quaternion.FromTwoVectors(UP, 0.5 * along / half).matrix()
        place = pin.SE3(turn, ends.mean(axis=0))
        sizes = (sizes[0],) * (count - 1) + (half,)
    return sizes[:count], place


def _solid(shape: str, sizes: tuple[float, ...]) -> tuple[float, np.ndarray]:
    """Return the volume of a shape and its moments about its centre, for a mass of 1."""
    if shape in ("sphere", "ellipsoid"):
        x, y, z = sizes * 3 if len(sizes) == 1 else sizes
        moments = np.array((y * y + z * z, x * x + z * z, x * x + y * y)) / 5.0
        return 4.0 / 3.0 * pi * x * y * z, moments
    if shape == "box":
        x, y, z = sizes
        moments = np.array((y * y + z * z, x * x + z * z, x * x + y * y)) / 3.0
        return 8.0 * x * y * z, moments
    radius, half = sizes
    tube, caps = 2.0 * pi * radius**2 * half, 4.0 / 3.0 * pi * radius**3
    across, along = radius**2 / 4.0 + half**2 / 3.0, radius**2 / 2.0
    if shape == "cylinder":
        return tube, np.array((across, across, along))
    cap_across = 0.4 * radius**2 + half**2 + 0.75 * half * radius
    share = tube / (tube + caps)
    across = share * across + (1.0 - share) * cap_across
    along = share * along + (1.0 - share) * 0.4 * radius**2
    return tube + caps, np.array((across, across, along))
