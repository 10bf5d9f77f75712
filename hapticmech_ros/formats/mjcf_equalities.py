# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Equalities of MJCF: connect and weld are closures, those of two joints or a tendon couplings.

One of a single joint locks it.

Keyframes are named states, in the coordinates that a scene has.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial

from hapticmech_ros.errors import nearest
from hapticmech_ros.formats.mjcf_classes import Context, settings
from hapticmech_ros.formats.model import WORLD, Coupling, Joint, Keyframe, LoopJoint, State
from hapticmech_ros.formats.xml_nodes import Node, Source

Place = tuple[str, pin.SE3]
# rad or m, between two places that are one.
SAME = 1e-9
INACTIVE = "inactive equality of a joint or tendon"
WHY_INACTIVE = "say locked joints and couplings in a scene file"
LOCK, FOLLOWS = "an equality without joint2", "follows a joint that is locked"
NOT_BACK = (
    "joint1 is locked, joint2 not: leave the equality out, and lock joint2 where it holds it by a"
    " joint equality without joint2"
)


@dataclass
class Equalities:
    """The equality constraints of a file.

    Args:
        context: the file.
        poses: bodies in the world where the file draws them, which is at the joints' ``ref``.
        sites: sites in their bodies.
        refs: positions of joints where the file draws them; joints that have one coordinate.
        hinges: joints.
        notes: to count in what is not read.
    """

    context: Context
    poses: Mapping[str, pin.SE3]
    sites: Mapping[str, Place]
    refs: Mapping[str, float]
    hinges: Iterable[Joint]
    notes: Counter[str]
    loop_joints: list[LoopJoint] = field(default_factory=list)
    couplings: list[Coupling] = field(default_factory=list)
    locks: dict[str, float] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)
    _nodes: dict[str, Node] = field(default_factory=dict)

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
            elif node.tag not in ("joint", "tendon"):
                rule = "an equality must be connect, weld, joint or tendon"
                raise self.context.source.error(node, node.tag, rule)
            elif not active:
                self.notes[INACTIVE] += 1
            elif node.tag == "tendon":
                self._nodes[name] = node
                self.couplings.append(self._held_tendon(full, name))
            elif full.attributes.get("joint2", "").strip():
                self._nodes[name] = node
                self.couplings.append(self._coupled(full, name))
            else:
                joint = self.context.source.text(full, "joint1")
                at = self._ref(full, joint) + self._polycoef(full)[0]
                self._lock(full, joint, at, LOCK)
        self._settle()

    def locked(self) -> list[Joint]:
        """Return the joints, those that equalities lock with stops that leave no travel."""
        return [
            replace(hinge, limits=(self.locks[hinge.name],) * 2)
            if hinge.name in self.locks
            else hinge
            for hinge in self.hinges
        ]

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

    def _lock(self, node: Node, joint: str, at: float, reason: str) -> None:
        before = self._held().get(joint, at)
        if abs(before - at) > SAME:
            rule = f"{joint} is locked at {before:g} already: leave one of the two out"
            raise self.context.source.error(node, at, rule)
        self.locks.setdefault(joint, at)
        self.reasons.setdefault(joint, reason)

    def _held(self) -> dict[str, float]:
        """Return where joints are locked, by their stops or by equalities."""
        stops = {hinge.name: hinge.limits for hinge in self.hinges if hinge.limits is not None}
        still = {name: lower for name, (lower, upper) in stops.items() if lower == upper}
        return {**still, **self.locks}

    def _settle(self) -> None:
        """Lock what follows joints that are locked: nothing is left to couple there."""
        before = -1
        while before != len(self.couplings):
            before, held = len(self.couplings), self._held()
            for one in [one for one in self.couplings if one.leader in held]:
                self.couplings.remove(one)
                p = Polynomial(one.polycoef or (one.offset, one.ratio))
                at = float(p(held[one.leader]))
                self._lock(self._nodes[one.name], one.joint, at, FOLLOWS)
        for one in self.couplings:
            if one.joint in held:
                raise self.context.source.error(self._nodes[one.name], one.joint, NOT_BACK)

    def _coupled(self, node: Node, name: str) -> Coupling:
        """Return q1 - ref1 = p(q2 - ref2) as q1 = a polynomial of q2."""
        joint = self.context.source.text(node, "joint1")
        leader = self.context.source.text(node, "joint2")
        offset, ratio, *bent = self._polycoef(node)
        here, there = self._ref(node, joint), self._ref(node, leader)
        if not any(bent):
            return Coupling(name, joint, leader, ratio, offset + here - ratio * there)
        moved = Polynomial((offset + here, ratio, *bent))(Polynomial((-there, 1.0)))
        coefficients = np.zeros(5)
        coefficients[: moved.coef.size] = moved.coef
        return Coupling(name, joint, leader, 0.0, 0.0, tuple(coefficients.tolist()))

    def _polycoef(self, node: Node) -> tuple[float, ...]:
        return self.context.padded(node, "polycoef", (0.0, 1.0, 0.0, 0.0, 0.0))

    def _ref(self, node: Node, joint: str) -> float:
        if joint not in self.refs:
            rule = f"must be a hinge or slide joint of the file{nearest(joint, self.refs)}"
            kinds = {hinge.name: hinge.type for hinge in self.hinges}
            if kinds.get(joint) in ("spherical", "free"):
                kind = "ball" if kinds[joint] == "spherical" else "free"
                rule = (
                    f"is a {kind} joint, and only hinge and slide joints can be coupled or locked:"
                    " write it as such joints, or hold its body by <weld>"
                )
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
        longer = self._polycoef(node)[0]
        drawn = [self._ref(one, joint) for one, joint in zip(ends[0], joints, strict=True)]
        ratio = -shares[1] / shares[0]
        offset = drawn[0] - ratio * drawn[1] + longer / shares[0]
        return Coupling(name, joints[0], joints[1], ratio, offset)


# Numbers of a joint in qpos and in qvel.
_POSITIONS = {"revolute": 1, "prismatic": 1, "spherical": 4, "free": 7}
_RATES = {"revolute": 1, "prismatic": 1, "spherical": 3, "free": 6}


def read_keyframes(
    source: Source, hinges: Sequence[Joint], start: Mapping[str, State]
) -> dict[str, Keyframe]:
    """Return the file's keyframes by name; those without one are called by their place, from 0.

    Args:
        source: the file.
        hinges: its joints, in its order.
        start: where joints are that a keyframe without ``qpos`` says nothing of; 0 if left out.

    Raises:
        SceneError: a name twice, or another number of numbers than the joints have.
    """
    found: dict[str, Keyframe] = {}
    nodes = [key for section in source.root.all("keyframe") for key in section.all("key")]
    moving = [hinge for hinge in hinges if hinge.type in _POSITIONS]
    for place, node in enumerate(nodes):
        name = node.attributes.get("name", "").strip() or str(place)
        if name in found:
            raise source.error(node, name, "names of keyframes must be unique")
        found[name] = _keyframe(source, node, moving, start)
    return found


def _keyframe(
    source: Source, node: Node, moving: Sequence[Joint], start: Mapping[str, State]
) -> Keyframe:
    q: dict[str, State] = dict(start)
    if "qpos" in node.attributes:
        for hinge, part in _parts(source, node, "qpos", moving, _POSITIONS):
            q[hinge.name] = _position(hinge.type, part)
    v: dict[str, State] = {}
    if "qvel" in node.attributes:
        for hinge, part in _parts(source, node, "qvel", moving, _RATES):
            v[hinge.name] = _rate(hinge.type, part, q.get(hinge.name))
    return Keyframe(q, v)


def _parts(
    source: Source, node: Node, key: str, moving: Sequence[Joint], sizes: Mapping[str, int]
) -> Iterator[tuple[Joint, tuple[float, ...]]]:
    """Yield joints with their numbers."""
    count = sum(sizes[hinge.type] for hinge in moving)
    numbers = source.numbers(node, node.attributes[key], count, key)
    at = 0
    for hinge in moving:
        yield hinge, numbers[at : at + sizes[hinge.type]]
        at += sizes[hinge.type]


def _position(kind: str, numbers: tuple[float, ...]) -> State:
    """Return a joint's position: quaternions end with w instead of beginning with it."""
    if kind in ("revolute", "prismatic"):
        return numbers[0]
    *place, w, x, y, z = numbers
    return [*place, *_unit(x, y, z, w)]


def _rate(kind: str, numbers: tuple[float, ...], position: State | None) -> State:
    """Return a joint's rates: a free one's velocity is in its own axes, not the world's."""
    if kind in ("revolute", "prismatic"):
        return numbers[0]
    if kind == "spherical" or not isinstance(position, Sequence):
        return list(numbers)
    rotation = pin.Quaternion(np.array(position[3:])).matrix()
    return [*(float(x) for x in rotation.T @ np.array(numbers[:3])), *numbers[3:]]


def _unit(*quaternion: float) -> list[float]:
    size = float(np.linalg.norm(quaternion))
    # As MuJoCo does with one that says nothing.
    return [x / size for x in quaternion] if size > 0.0 else [0.0, 0.0, 0.0, 1.0]
