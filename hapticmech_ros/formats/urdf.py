# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""URDF: links, joints, inertias, limits and forces in joints; a scene file adds the loops.

Gazebo's tags in URDF: joints that close loops, links without gravity, springs of joints.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import listed, nearest
from hapticmech_ros.formats import loops
from hapticmech_ros.formats.cuts import reversed_joint
from hapticmech_ros.formats.loops import BALL, ball_constraint, left_open
from hapticmech_ros.formats.model import (
    DRAWN,
    DRIVEN,
    FOREIGN,
    GEAR,
    LEFT_OPEN,
    ROTOR,
    ROTOR_ELSEWHERE,
    SENSED,
    UNKNOWN,
    WHY_ELSEWHERE,
    WORLD,
    Body,
    Coupling,
    Document,
    Joint,
    Model,
    Note,
    Point,
    Rgba,
    Solid,
    from_z,
)
from hapticmech_ros.formats.sdf import read_joints
from hapticmech_ros.formats.sdf_frames import HERE
from hapticmech_ros.formats.shapes import (
    SIZES,
    find_mesh,
    not_zero,
    refused_kind,
    rgba,
    sized,
    solid_of,
)
from hapticmech_ros.formats.xml_nodes import Node, Source

TAG = "gazebo"
# Elements of a link, and whether gravity acts where they are true.
GRAVITY = {"gravity": True, "turnGravityOff": False}
FLAGS = {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}
# Elements of a joint.
SPRING = ("springStiffness", "springReference")


@dataclass
class GazeboTags:
    """Contents of Gazebo's tags.

    Attributes:
        hinges: those of URDF with their springs, and joints of theirs.
        couplings: of these.
        bodies: of URDF, carried where gravity is off; and those without mass that joints need.
        nodes: elements of their joints by name.
        lost: loops that are left open.
    """

    hinges: list[Joint]
    bodies: dict[str, Body]
    couplings: list[Coupling] = field(default_factory=list)
    nodes: dict[str, Node] = field(default_factory=dict)
    lost: list[Note] = field(default_factory=list)

    def read(
        self,
        source: Source,
        tags: Sequence[Node],
        joints: Mapping[str, Node],
        notes: Counter[str],
    ) -> None:
        """Read the tags.

        Args:
            source: the file.
            tags: its elements ``gazebo``.
            joints: elements of URDF's joints by name.
            notes: kinds of elements that are not read, to add to.

        Raises:
            SceneError: a joint breaks a rule of SDFormat, or a value is none.
        """
        for tag in tags:
            rest = [
                part
                for part in tag.children
                if not self._is_joint(source, part, joints) and not self._is_of(source, tag, part)
            ]
            lost, rest = left_open(rest, self.bodies)
            self.lost += lost
            notes[TAG] += bool(rest) or not tag.children
        if not self.nodes:
            return
        bodies, carried = set(self.bodies), {hinge.child: hinge.parent for hinge in self.hinges}
        # Where links are with all joints at zero.
        places = {name: (HERE, pin.SE3.Identity()) for name in self.bodies}
        for hinge in reversed(self.hinges):
            places[hinge.child] = (hinge.parent, hinge.in_parent * hinge.of_child)
        nodes = self.nodes.values()
        hinges, self.couplings = read_joints(source, nodes, places, self.bodies, notes)
        for hinge in hinges:
            turned = hinge.child == WORLD or (
                hinge.child not in carried
                and hinge.child in bodies
                and hinge.child in _above(hinge.parent, carried)
            )
            self.hinges.append(reversed_joint(hinge) if turned else hinge)
            carried.setdefault(self.hinges[-1].child, self.hinges[-1].parent)

    def _is_of(self, source: Source, tag: Node, part: Node) -> bool:
        """Return whether an element of a link or joint is read."""
        name = tag.attributes.get("reference", "").strip()
        said = (part.attributes.get("value") or part.text).strip()
        if part.tag in GRAVITY and name in self.bodies:
            if said.lower() not in FLAGS:
                raise source.error(part, said, f"must be one of {listed(sorted(FLAGS))}")
            acts = FLAGS[said.lower()] == GRAVITY[part.tag]
            self.bodies[name] = replace(self.bodies[name], gravcomp=float(not acts))
            return True
        if part.tag not in SPRING:
            return False
        for number, hinge in enumerate(self.hinges):
            if hinge.name == name and hinge.type in ("revolute", "prismatic"):
                (value,) = source.numbers(part, said, 1, part.tag)
                stiff = part.tag == SPRING[0]
                self.hinges[number] = (
                    replace(hinge, stiffness=value) if stiff else replace(hinge, rest=value)
                )
                return True
        return False

    def _is_joint(self, source: Source, part: Node, joints: Mapping[str, Node]) -> bool:
        """Return whether an element is a joint, which is read, or noted as one that is not."""
        if part.tag != "joint" or part.attributes.get("type", "").strip() == "gearbox":
            return False
        name = source.text(part, "name")
        if name in joints or name in self.nodes:
            rule = "names of joints must be unique"
            raise source.twice(part, name, joints.get(name) or self.nodes.get(name), rule)
        ends = [found.text.strip() for end in ("parent", "child") for found in part.all(end)]
        if all(end in self.bodies or end == WORLD for end in ends):
            self.nodes[name] = part
        else:
            why = f"it joins {' and '.join(ends)}, which are not both links of this file"
            self.lost.append(Note(f"{LEFT_OPEN}: {name}", 1, why))
        return True


def _above(name: str, carried: Mapping[str, str]) -> set[str]:
    """Return the links that carry a link, directly or not."""
    found: set[str] = set()
    while name in carried and name not in found:
        found.add(name)
        name = carried[name]
    return found | {name}


def placement_in(source: Source, node: Node | None) -> pin.SE3:
    """Return the transform of an element's xyz and rpy; the identity without."""
    xyz = source.values(node, "xyz", (0.0, 0.0, 0.0))
    rpy = source.values(node, "rpy", (0.0, 0.0, 0.0))
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz))


def _shape_of(
    source: Source, shape: Node, kind: str, place: Callable[[], pin.SE3]
) -> tuple[pin.SE3, Document]:
    if kind in SIZES:
        return place(), sized(
            source,
            shape,
            kind,
            lambda key, count: source.numbers(shape, source.text(shape, key), count, key),
        )
    if kind != "mesh":
        raise refused_kind(source, shape, kind)
    file = find_mesh(source, shape, source.text(shape, "filename"), source.path.parent)
    scale = not_zero(source, shape, source.values(shape, "scale", (1.0, 1.0, 1.0)))
    return place(), {"kind": kind, "file": str(file), "scale": scale}


JOINT_TYPES = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "fixed": "fixed",
    "floating": "free",
    "planar": "planar",
}
WHY = {
    "visual": DRAWN,
    "safety_controller": "a virtual mechanism has no controller of its own",
    "calibration": "a virtual mechanism needs none",
    "transmission": "joints are moved by forces, not through motors; drake:rotor_inertia is read",
    "material": DRAWN,
    "gazebo": FOREIGN,
    "ros2_control": "a virtual mechanism has no controller of its own",
    "effort limit": DRIVEN,
    "velocity limit": DRIVEN,
    "limit left out": "the joint has no stops, like a continuous one",
    "sensor": SENSED,
    ROTOR_ELSEWHERE: WHY_ELSEWHERE,
    **loops.WHY,
}
LINK_KNOWN = {"inertial", "collision"}
FIRST_NUMBERS = (1.0, 0.0, 0.0)
# Limits are often written as the largest number there is.
ANY = math.inf


def read_urdf(source: Source) -> Model:
    """Return the model in a URDF file.

    Raises:
        SceneError: it breaks a rule; names line, element, value and rule.
    """
    notes: Counter[str] = Counter()
    links, joints = _by_name(source, "link"), _by_name(source, "joint")
    others = [one for one in source.root.children if one.tag not in ("link", "joint", TAG)]
    bodies = {name: _body(source, name, node, notes) for name, node in links.items()}
    hinges = [_hinge(source, name, node, notes) for name, node in joints.items()]
    pairs = zip(joints.values(), hinges, strict=True)
    couplings = [one for node, hinge in pairs for one in _mimic(source, node, hinge)]
    for hinge in hinges:
        for name in (hinge.parent, hinge.child):
            # The world need not be written down.
            if name not in bodies and name != WORLD:
                rule = f"joint {hinge.name!r} needs this link{nearest(name, bodies)}"
                raise source.error(joints[hinge.name], name, rule)
    # Drake's frames, fixed in links.
    points = [
        Point(_name(node), node.attributes["link"], placement_in(source, node))
        for node in others
        if node.tag == "frame" and _name(node) and node.attributes.get("link") in bodies
    ]
    loop_joints = [ball_constraint(source, node, bodies) for node in others if node.tag == BALL]
    gazebo = GazeboTags(_with_rotors(source, hinges, notes), bodies)
    gazebo.read(source, source.root.all(TAG), joints, notes)
    read = {point.name for point in points}
    others = [node for node in others if node.tag != BALL and _name(node) not in read]
    lost, others = left_open(others, {*bodies, *read})
    notes.update(node.tag for node in others)
    hinges, couplings = loops.settled(gazebo.hinges, [*couplings, *gazebo.couplings], notes)
    found = [Note(what, count, WHY.get(what, UNKNOWN)) for what, count in notes.items() if count]
    return Model(
        source.root.attributes.get("name") or source.path.stem,
        bodies,
        hinges,
        loop_joints,
        couplings,
        points,
        _solids(source, links, "collision"),
        notes=[*gazebo.lost, *lost, *found],
        where={
            (kind, name): source.where(node)
            for kind, nodes in (("link", links), ("joint", {**joints, **gazebo.nodes}))
            for name, node in nodes.items()
        },
        visuals=_solids(source, links, "visual"),
    )


def _by_name(source: Source, tag: str) -> dict[str, Node]:
    """Return the links or joints of a file, by their names."""
    found: dict[str, Node] = {}
    for node in source.root.all(tag):
        name = source.text(node, "name")
        if name in found:
            raise source.twice(node, name, found[name], f"names of {tag}s must be unique")
        found[name] = node
    return found


def _solids(source: Source, links: Mapping[str, Node], tag: str) -> list[Solid]:
    """Return the shapes of links for collisions, or those that are drawn."""
    colours, found = _colours(source), []
    for link, node in links.items():
        for part in node.all(tag):
            place = partial(placement_in, source, part.first("origin"))
            solid = solid_of(source, part, link, place, _shape_of)
            found.append(replace(solid, colour=_colour(part.first("material"), colours)))
    return found


def _colours(source: Source) -> dict[str, Rgba | None]:
    """Return the colours of named materials, which a file may define anywhere."""
    materials = [one for one in source.root.walk() if one.tag == "material"]
    return {
        one.attributes.get("name", ""): _colour(one, {})
        for one in materials
        if one.first("color") is not None
    }


def _colour(material: Node | None, named: Mapping[str, Rgba | None]) -> Rgba | None:
    """Return the colour of a material, its own or that of its name."""
    if material is None:
        return None
    own = material.first("color")
    if own is None:
        return named.get(material.attributes.get("name", ""))
    return rgba(own.attributes.get("rgba", ""))


def _name(node: Node) -> str:
    return node.attributes.get("name", "").strip() if node.tag == "frame" else ""


def _with_rotors(source: Source, hinges: Sequence[Joint], notes: Counter[str]) -> list[Joint]:
    """Return joints with the rotors that Drake's tags give them: ``drake:rotor_inertia``.

    In a transmission's actuator, with ``drake:gear_ratio``; the reflected inertia is the ratio
    squared times the rotor's own.
    """
    alone = {hinge.name for hinge in hinges if hinge.type in ("revolute", "prismatic")}
    added: dict[str, float] = {}
    for transmission in source.root.all("transmission"):
        named = [joint.attributes.get("name", "") for joint in transmission.all("joint")]
        for actuator in transmission.all("actuator"):
            inertia = source.value(actuator.first(ROTOR), "value", 0.0)
            ratio = source.value(actuator.first(GEAR), "value", 1.0)
            if inertia == 0.0:
                continue
            if len(named) == 1 and named[0] in alone:
                added[named[0]] = added.get(named[0], 0.0) + ratio * ratio * inertia
            else:
                notes[ROTOR_ELSEWHERE] += 1
    return [replace(one, armature=added.get(one.name, 0.0)) for one in hinges]


def _body(source: Source, name: str, node: Node, notes: Counter[str]) -> Body:
    notes.update(part.tag for part in node.children if part.tag not in LINK_KNOWN)
    inertial = node.first("inertial")
    if inertial is None:
        return Body(name)
    mass, inertia = inertial.first("mass"), inertial.first("inertia")
    if mass is None or inertia is None:
        raise source.error(inertial, name, "an <inertial> needs <mass> and <inertia>")
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    xx, xy, xz, yy, yz, zz = (source.value(inertia, name) for name in names)
    own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    place = placement_in(source, inertial.first("origin"))
    turned = place.rotation @ own @ place.rotation.T
    return Body(name, source.value(mass, "value"), place.translation.copy(), turned)


def _hinge(source: Source, name: str, node: Node, notes: Counter[str]) -> Joint:
    kind = source.text(node, "type")
    if kind not in JOINT_TYPES:
        raise source.error(node, kind, f"type must be one of {listed(sorted(JOINT_TYPES))}")
    known = {"origin", "parent", "child", "axis", "limit", "dynamics", "mimic"}
    notes.update(part.tag for part in node.children if part.tag not in known)
    parent, child = (_link_of(source, node, end) for end in ("parent", "child"))
    dynamics = node.first("dynamics")
    moving = kind in ("revolute", "continuous", "prismatic")
    axis = _axis(source, node) if moving or kind == "planar" else np.array((0.0, 0.0, 1.0))
    level = pin.SE3.Identity()
    if kind == "planar":
        level, axis = from_z(axis), np.array((0.0, 0.0, 1.0))
    return Joint(
        name,
        JOINT_TYPES[kind],
        parent,
        child,
        placement_in(source, node.first("origin")) * level,
        level.inverse(),
        axis,
        source.value(dynamics, "damping", 0.0),
        source.value(dynamics, "friction", 0.0) if moving else 0.0,
        limits=_limits(source, node, kind, notes),
    )


def _link_of(source: Source, node: Node, end: str) -> str:
    found = node.first(end)
    if found is None:
        raise source.error(node, node.attributes.get("name"), f"needs <{end} link=.../>")
    return source.text(found, "link")


def _axis(source: Source, node: Node) -> np.ndarray:
    written = node.first("axis")
    return source.unit(written, source.values(written, "xyz", FIRST_NUMBERS), "an axis")


def _limits(
    source: Source, node: Node, kind: str, notes: Counter[str]
) -> tuple[float, float] | None:
    limit = node.first("limit")
    if limit is not None:
        for attribute in ("effort", "velocity"):
            if source.value(limit, attribute, 0.0, ANY) > 0.0:
                notes[f"{attribute} limit"] += 1
    if kind not in ("revolute", "prismatic"):
        return None
    if limit is None:
        notes["limit left out"] += 1
        return None
    if not {"lower", "upper"} & set(limit.attributes):
        notes["limit left out"] += 1
        return None
    lower, upper = (source.value(limit, key, 0.0, ANY) for key in ("lower", "upper"))
    if lower > upper:
        raise source.error(limit, (lower, upper), "lower must not be above upper")
    return lower, upper


def _mimic(source: Source, node: Node, hinge: Joint) -> list[Coupling]:
    mimic = node.first("mimic")
    if mimic is None:
        return []
    name, leader = hinge.name, source.text(mimic, "joint")
    if hinge.type not in ("revolute", "prismatic", "fixed"):
        raise source.error(mimic, name, "only a joint of one coordinate can mimic another")
    if leader == name:
        raise source.error(mimic, name, "a joint mimics another one, not itself")
    ratio, offset = source.value(mimic, "multiplier", 1.0), source.value(mimic, "offset", 0.0)
    return [Coupling(f"{name}_mimics_{leader}", name, leader, ratio, offset)]
