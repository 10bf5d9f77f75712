# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Gazebo's tags in URDF: joints that close loops, links without gravity, springs of joints."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import pinocchio as pin

from hapticmech_ros.formats.cuts import reversed_joint
from hapticmech_ros.formats.loops import left_open
from hapticmech_ros.formats.model import LEFT_OPEN, WORLD, Body, Coupling, Joint, Note
from hapticmech_ros.formats.sdf import read_joints
from hapticmech_ros.formats.xml_nodes import Node, Source

TAG = "gazebo"
# Elements of a link, and whether gravity acts where they are true.
GRAVITY = {"gravity": True, "turnGravityOff": False}
FLAGS = {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}
# Elements of a joint.
SPRING = ("springStiffness", "springReference")


@dataclass
class GazeboTags:
    """What Gazebo's tags say.

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
            notes: kinds of what is not read, to add to.

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
        poses = _at_zero(self.hinges, self.bodies)
        nodes = self.nodes.values()
        hinges, self.couplings = read_joints(source, nodes, poses, self.bodies, notes)
        for hinge in hinges:
            turned = hinge.child == WORLD or (
                hinge.child not in carried
                and hinge.child in bodies
                and hinge.child in _above(hinge.parent, carried)
            )
            self.hinges.append(reversed_joint(hinge) if turned else hinge)
            carried.setdefault(self.hinges[-1].child, self.hinges[-1].parent)

    def _is_of(self, source: Source, tag: Node, part: Node) -> bool:
        """Return whether an element says something of a link or joint that is read."""
        name = tag.attributes.get("reference", "").strip()
        said = (part.attributes.get("value") or part.text).strip()
        if part.tag in GRAVITY and name in self.bodies:
            if said.lower() not in FLAGS:
                raise source.error(part, said, f"must be one of {sorted(FLAGS)}")
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


def _at_zero(hinges: Sequence[Joint], bodies: Collection[str]) -> dict[str, pin.SE3]:
    """Return where links are with all joints at zero, those of circles left out."""
    below: dict[str, list[Joint]] = {}
    for hinge in hinges:
        below.setdefault(hinge.parent, []).append(hinge)
    carried = {hinge.child for hinge in hinges}
    poses = {name: pin.SE3.Identity() for name in (WORLD, *bodies) if name not in carried}
    waiting = list(poses)
    while waiting:
        parent = waiting.pop()
        for hinge in below.get(parent, []):
            if hinge.child not in poses:
                poses[hinge.child] = poses[parent] * hinge.in_parent * hinge.of_child
                waiting.append(hinge.child)
    return poses


def _above(name: str, carried: Mapping[str, str]) -> set[str]:
    """Return the links that carry a link, directly or not."""
    found: set[str] = set()
    while name in carried and name not in found:
        found.add(name)
        name = carried[name]
    return found | {name}
