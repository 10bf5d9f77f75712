# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Equalities of MJCF: connect and weld are closures, joints and tendons of two are couplings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import nearest
from hapticmech_ros.formats.mjcf_classes import Context, settings
from hapticmech_ros.formats.model import WORLD, Coupling, LoopJoint
from hapticmech_ros.formats.xml_nodes import Node

Place = tuple[str, pin.SE3]


@dataclass
class Equalities:
    """The equality constraints of a file.

    Args:
        context: the file.
        poses: bodies in the world where the file draws them, which is at the joints' ``ref``.
        sites: sites in their bodies.
        refs: positions of joints where the file draws them; joints that have one coordinate.
    """

    context: Context
    poses: Mapping[str, pin.SE3]
    sites: Mapping[str, Place]
    refs: Mapping[str, float]
    loop_joints: list[LoopJoint] = field(default_factory=list)
    couplings: list[Coupling] = field(default_factory=list)

    def read(self) -> None:
        """Read them all.

        Raises:
            SceneError: an equality that cannot be a closure.
        """
        general = settings(self.context.source.root, "equality").children
        for count, node in enumerate(general):
            full = self._full(node)
            name = node.attributes.get("name") or f"{node.tag}{count}"
            active = self.context.flag(full, "active", "true")
            if node.tag == "connect":
                self.loop_joints.append(
                    LoopJoint(name, "spherical", *self._connected(full), active)
                )
            elif node.tag == "weld":
                self.loop_joints.append(LoopJoint(name, "weld", *self._welded(full), active))
            elif node.tag == "joint":
                if active:
                    self.couplings.append(self._coupled(full, name))
            elif node.tag == "tendon":
                if active:
                    self.couplings.append(self._held_tendon(full, name))
            else:
                rule = "an equality must be connect, weld, joint or tendon"
                raise self.context.source.error(node, node.tag, rule)

    def _full(self, node: Node) -> Node:
        """Return an equality with the defaults of all equalities, which are under that name."""
        general = self.context.full(replace(node, tag="equality"))
        return replace(general, tag=node.tag)

    def _by_sites(self, node: Node) -> bool:
        given = ("site1" in node.attributes, "site2" in node.attributes)
        if any(given) and ("body1" in node.attributes or not all(given)):
            rule = "needs site1 and site2, or body1 and perhaps body2"
            raise self.context.source.error(node, sorted(node.attributes), rule)
        return all(given)

    def _site(self, node: Node, key: str) -> Place:
        name = self.context.source.text(node, key)
        if name not in self.sites:
            raise self.context.source.error(node, name, "no such site")
        return self.sites[name]

    def _bodies(self, node: Node) -> tuple[str, str]:
        one = self.context.source.text(node, "body1")
        other = node.attributes.get("body2", WORLD).strip()
        for name in (one, other):
            if name not in self.poses:
                rule = f"no such body{nearest(name, self.poses)}"
                raise self.context.source.error(node, name, rule)
        return one, other

    def _connected(self, node: Node) -> tuple[Place, Place]:
        if self._by_sites(node):
            return self._site(node, "site1"), self._site(node, "site2")
        one, other = self._bodies(node)
        self.context.source.text(node, "anchor")
        here, there = pin.SE3.Identity(), pin.SE3.Identity()
        here.translation = np.array(self.context.source.values(node, "anchor", (0.0,) * 3))
        there.translation = self.poses[other].actInv(self.poses[one].act(here.translation))
        return (one, here), (other, there)

    def _welded(self, node: Node) -> tuple[Place, Place]:
        if self._by_sites(node):
            return self._site(node, "site1"), self._site(node, "site2")
        one, other = self._bodies(node)
        relative = self.poses[one].actInv(self.poses[other])
        given = self.context.source.values(node, "relpose", (0.0,) * 7)
        if any(given[3:]):
            w, x, y, z = given[3:]
            turn = pin.Quaternion(w, x, y, z)
            turn.normalize()
            anchor = np.array(self.context.source.values(node, "anchor", (0.0,) * 3))
            relative = pin.SE3(turn.matrix(), np.array(given[:3]) - turn.matrix() @ anchor)
        return (one, relative), (other, pin.SE3.Identity())

    def _coupled(self, node: Node, name: str) -> Coupling:
        joint = self.context.source.text(node, "joint1")
        leader = node.attributes.get("joint2", "").strip()
        offset, ratio, *bent = self.context.padded(node, "polycoef", (0.0, 1.0, 0.0, 0.0, 0.0))
        if not leader or any(bent):
            rule = "a joint equality needs joint2 and a straight line: polycoef='a b 0 0 0'"
            raise self.context.source.error(node, node.attributes.get("polycoef"), rule)
        offset += self._ref(node, joint) - ratio * self._ref(node, leader)
        return Coupling(name, joint, leader, ratio, offset)

    def _ref(self, node: Node, joint: str) -> float:
        if joint not in self.refs:
            rule = f"must be a hinge or slide joint of the file{nearest(joint, self.refs)}"
            raise self.context.source.error(node, joint, rule)
        return self.refs[joint]

    def _held_tendon(self, node: Node, name: str) -> Coupling:
        """Return a tendon of two joints, a q_a + b q_b, that keeps the length it is drawn with."""
        source = self.context.source
        called = source.text(node, "tendon1")
        rule = "a tendon equality needs a fixed tendon of two joints, and no tendon2"
        tendons = [t for t in settings(source.root, "tendon").children if t.tag == "fixed"]
        ends = [t.all("joint") for t in tendons if t.attributes.get("name", "").strip() == called]
        if "tendon2" in node.attributes or len(ends) != 1 or len(ends[0]) != 2:
            raise source.error(node, called, rule)
        joints = [source.text(one, "joint") for one in ends[0]]
        shares = [source.value(one, "coef") for one in ends[0]]
        if not shares[0]:
            raise source.error(ends[0][0], 0.0, "coef must not be zero")
        longer = self.context.padded(node, "polycoef", (0.0, 1.0, 0.0, 0.0, 0.0))[0]
        drawn = [self._ref(one, joint) for one, joint in zip(ends[0], joints, strict=True)]
        ratio = -shares[1] / shares[0]
        offset = drawn[0] - ratio * drawn[1] + longer / shares[0]
        return Coupling(name, joints[0], joints[1], ratio, offset)
