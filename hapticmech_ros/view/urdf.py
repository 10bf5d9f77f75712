# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""URDF text of a scene's tree, for RViz, robot_state_publisher and other readers of URDF.

URDF has trees only: closures are named in a comment and left open. It has no spherical joint
either: three hinges about x, y and z replace it, with links without mass between them. ``free`` is
URDF's ``floating``. A locked joint is a fixed one, where the scene's initial state has it. URDF
cannot describe rotors (``armature``): they are left out. Numbers are written so that reading them
gives the same bits.

Joint states are in robot_state_publisher's form: a URDF joint has one number. A spherical joint is
three hinges there, about x, y and z in turn. URDF's planar and floating joints have no single
number and are left out: their frames come by tf alone.
"""

from __future__ import annotations

from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.model import placement_of
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Link
from hapticmech_ros.view import palette
from hapticmech_ros.view.placement import Placer
from hapticmech_ros.view.shapes import LINK_DIAMETER, Shape, capsule, joint_shape, sphere

HINGES = ("x", "y", "z")
# Closer to a right angle than this (cosine) the first and third hinge are one: the third is put 0.
_ALIGNED = 1e-9


class JointStates:
    """Names, positions and rates of one mechanism's URDF joints.

    Attributes:
        names: of the joints.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._parts: list[tuple[str, slice, slice]] = []
        names: list[str] = []
        tree = mechanism.tree
        for index, (joint, kind) in enumerate(zip(tree.joint_names, tree.joint_types, strict=True)):
            if kind in ("revolute", "prismatic"):
                names.append(joint)
            elif kind == "spherical":
                names += [hinge_name(joint, axis) for axis in HINGES]
            else:
                continue
            self._parts.append((kind, tree.position_slice(index), tree.velocity_slice(index)))
        self.names = tuple(names)

    def at(self, q: Array) -> Array:
        """Return the positions, rad or m, at q (nq,); passive joints included.

        Args:
            q: (nq,) configuration.
        """
        found: list[float] = []
        for kind, part, _ in self._parts:
            if kind == "spherical":
                found += hinge_angles(pin.Quaternion(q[part]).matrix())
            else:
                found.append(float(q[part.start]))
        return np.array(found)

    def rates(self, q: Array, v: Array) -> Array:
        """Return the rates of the positions, rad/s or m/s, at q (nq,) and v (nv,).

        Args:
            q: (nq,) configuration.
            v: (nv,) rates, rad/s or m/s.
        """
        found: list[float] = []
        for kind, part, moving in self._parts:
            if kind == "spherical":
                found += hinge_rates(pin.Quaternion(q[part]).matrix(), v[moving])
            else:
                found.append(float(v[moving.start]))
        return np.array(found)


def hinge_name(joint: str, axis: str) -> str:
    """Return the name of one of the three hinges that replace a spherical joint."""
    return f"{joint}_{axis}"


def hinge_angles(rotation: Array) -> tuple[float, float, float]:
    """Return a, b, c (rad) with ``rotation`` (3, 3) = R_x(a) R_y(b) R_z(c), -π/2 <= b <= π/2.

    Args:
        rotation: (3, 3) of a spherical joint; axes of the carried link to those before the joint.
    """
    level = float(np.hypot(rotation[0, 0], rotation[0, 1]))
    b = float(np.arctan2(rotation[0, 2], level))
    if level < _ALIGNED:
        return float(np.arctan2(rotation[2, 1], rotation[1, 1])), b, 0.0
    a = float(np.arctan2(-rotation[1, 2], rotation[2, 2]))
    return a, b, float(np.arctan2(-rotation[0, 1], rotation[0, 0]))


def hinge_rates(rotation: Array, angular: Array) -> tuple[float, float, float]:
    """Return da/dt, db/dt, dc/dt (rad/s) of :func:`hinge_angles`.

    Where first and third hinge are in line, as far as the hinges can follow.

    Args:
        rotation: (3, 3) of a spherical joint; axes of the carried link to those before the joint.
        angular: (3,) angular velocity of the carried link relative to the one before, its axes.
    """
    _, b, c = hinge_angles(rotation)
    across = np.array((np.cos(c), -np.sin(c), 0.0)) @ angular
    along = np.array((np.sin(c), np.cos(c), 0.0)) @ angular
    level = float(np.hypot(rotation[0, 0], rotation[0, 1]))
    if level < _ALIGNED:
        return float(angular[2] / np.sin(b)), float(along), 0.0
    first = float(across) / np.cos(b)
    return first, float(along), float(angular[2]) - first * np.sin(b)


# URDF requires limits where the scene has none: m, N and m/s that are never reached.
_NO_LIMIT = "1e6"
_TYPES = {
    "revolute": "continuous",
    "prismatic": "prismatic",
    "fixed": "fixed",
    "free": "floating",
    "planar": "planar",
}
_COLOURS = {"link": palette.LINK, "joint": palette.JOINT}


def urdf_of(mechanism: Mechanism) -> str:
    """Return the URDF text of the mechanism's tree; its root link is ``world``."""
    scene = mechanism.scene
    robot = Element("robot", name=scene.name)
    robot.append(ElementTree.Comment(f" {_remark(scene)} "))
    for name, colour in _COLOURS.items():
        material = SubElement(robot, "material", name=name)
        SubElement(material, "color", rgba=_numbers(colour))
    SubElement(robot, "link", name="world")
    limbs: dict[str, list[Array]] = {}
    for name, end in Placer(mechanism).limbs:
        limbs.setdefault(name, []).append(end)
    for link in scene.links:
        _add_link(robot, link, limbs.get(link.name, []), mechanism.length)
        _add_joints(robot, link, scene)
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"


def _remark(scene: Scene) -> str:
    if not scene.closures:
        return f"Made from the scene {scene.name}."
    loops = ", ".join(f"{c.name} ({c.kind}: {c.a.link} to {c.b.link})" for c in scene.closures)
    return (
        f"Made from the scene {scene.name}. URDF has no loops, so this tree leaves these closures "
        f"out: {loops}."
    )


def _add_link(robot: Element, link: Link, ends: list[Array], unit: float) -> None:
    element = SubElement(robot, "link", name=link.name)
    inertial = SubElement(element, "inertial")
    SubElement(inertial, "origin", xyz=_numbers(link.inertial.com), rpy="0 0 0")
    SubElement(inertial, "mass", value=repr(link.inertial.mass))
    moments = link.inertial.inertia.model_dump()
    SubElement(inertial, "inertia", {key: repr(value) for key, value in moments.items()})
    thick = LINK_DIAMETER * unit
    limbs = [part for end in ends for part in capsule(np.zeros(3), end, thick, palette.LINK)]
    for shape in limbs or [sphere(np.zeros(3), thick, palette.LINK)]:
        _add_visual(element, shape, "link")
    axis = np.array(link.joint.axis) / np.linalg.norm(link.joint.axis)
    for shape in joint_shape(link.joint, pin.SE3.Identity(), axis, unit):
        _add_visual(element, shape, "joint")


def _add_visual(link: Element, shape: Shape, material: str) -> None:
    visual = SubElement(link, "visual")
    rpy = pin.rpy.matrixToRpy(shape.pose.rotation)
    SubElement(visual, "origin", _origin(shape.pose.translation, rpy))
    geometry = SubElement(visual, "geometry")
    width, _, length = shape.size
    if shape.kind == "cylinder":
        SubElement(geometry, "cylinder", radius=repr(0.5 * width), length=repr(length))
    elif shape.kind == "sphere":
        SubElement(geometry, "sphere", radius=repr(0.5 * width))
    else:
        SubElement(geometry, "box", size=_numbers(shape.size))
    SubElement(visual, "material", name=material)


def _add_joints(robot: Element, link: Link, scene: Scene) -> None:
    joint, parent = link.joint, link.parent
    place = _origin(joint.origin.xyz, joint.origin.rpy)
    if joint.locked:
        pose = placement_of(scene, joint)
        place = _origin(pose.translation, pin.rpy.matrixToRpy(pose.rotation))
        _add_joint(robot, joint.name, "fixed", parent, link.name, place)
    elif joint.type == "spherical":
        for axis, direction in zip(HINGES, np.eye(3), strict=True):
            child = link.name if axis == HINGES[-1] else f"{link.name}_{axis}"
            if child != link.name:
                SubElement(robot, "link", name=child)
            name = hinge_name(joint.name, axis)
            _add_joint(robot, name, "continuous", parent, child, place, _numbers(direction))
            parent, place = child, {}
    else:
        simple = joint.type in ("revolute", "prismatic")
        axis = _numbers(joint.axis) if simple else "0 0 1" if joint.type == "planar" else ""
        kind = _TYPES[joint.type]
        element = _add_joint(robot, joint.name, kind, parent, link.name, place, axis)
        if joint.type == "prismatic":
            limits = {"lower": f"-{_NO_LIMIT}", "upper": _NO_LIMIT}
            SubElement(element, "limit", limits, effort=_NO_LIMIT, velocity=_NO_LIMIT)
        if joint.damping:
            SubElement(element, "dynamics", damping=repr(joint.damping))


def _add_joint(
    robot: Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    place: dict[str, str],
    axis: str = "",
) -> Element:
    element = SubElement(robot, "joint", name=name, type=kind)
    SubElement(element, "parent", link=parent)
    SubElement(element, "child", link=child)
    if place:
        SubElement(element, "origin", place)
    if axis:
        SubElement(element, "axis", xyz=axis)
    return element


def _origin(xyz: object, rpy: object) -> dict[str, str]:
    return {"xyz": _numbers(xyz), "rpy": _numbers(rpy)}


def _numbers(values: object) -> str:
    return " ".join(repr(float(value)) for value in np.asarray(values))
