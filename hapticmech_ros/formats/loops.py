# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Loops in tags of other programs: Drake's ball constraints, and those that are left open.

Joints that mimic others are couplings, but where one of the two does not move.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import nearest
from hapticmech_ros.formats.model import (
    LEFT_OPEN,
    WORLD,
    Coupling,
    Joint,
    LoopJoint,
    Note,
    clean,
    from_z,
    origin_of,
)
from hapticmech_ros.formats.xml_nodes import Node, Source

IN_FIXED = "mimic in a fixed joint"
OF_FIXED = "mimic of a joint that does not move"
WHY = {
    IN_FIXED: "a fixed joint cannot follow",
    OF_FIXED: "the joint is fixed where its leader holds it",
}


def settled(
    hinges: Sequence[Joint], couplings: Sequence[Coupling], notes: Counter[str]
) -> tuple[list[Joint], list[Coupling]]:
    """Return hinges and couplings, with joints that mimic a fixed joint fixed themselves.

    Such a joint is at multiplier · 0 + offset; joints that mimic it are fixed as well. A mimic in a
    fixed joint has no effect.
    """
    found = {hinge.name: hinge for hinge in hinges}
    moving = [one for one in couplings if found[one.joint].type != "fixed"]
    notes[IN_FIXED] += len(couplings) - len(moving)
    followers: dict[str, list[Coupling]] = {}
    for one in moving:
        followers.setdefault(one.leader, []).append(one)
    still = [(hinge.name, 0.0) for hinge in hinges if hinge.type == "fixed"]
    held = {}
    while still:
        leader, position = still.pop()
        for one in followers.get(leader, []):
            held[one.joint] = one.ratio * position + one.offset
            still.append((one.joint, held[one.joint]))
    notes[OF_FIXED] += len(held)
    for name, position in held.items():
        found[name] = _fixed(found[name], position)
    return list(found.values()), [one for one in moving if one.joint not in held]


def _fixed(hinge: Joint, position: float) -> Joint:
    """Return a joint of one coordinate held where it is at a position."""
    moved = pin.SE3.Identity()
    if hinge.type == "revolute":
        moved.rotation = pin.AngleAxis(position, hinge.axis).matrix()
    else:
        moved.translation = np.asarray(position * hinge.axis)
    place = hinge.in_parent * moved
    still = replace(hinge, damping=0.0, friction=0.0, stiffness=0.0, rest=0.0, armature=0.0)
    return replace(still, type="fixed", in_parent=place, limits=None)


BALL = "drake:ball_constraint"
# Names of elements, and of files of plugins, that join two links.
_JOINING = re.compile("constraint|loop|bushing|weld", re.IGNORECASE)
_PLUGIN = re.compile("attach|detach|constraint|loop|weld", re.IGNORECASE)
_STIFFNESS = "drake:bushing_torque_stiffness"
_HINGES = ("revolute", "continuous", "hinge")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


def ball_constraint(source: Source, node: Node, bodies: Collection[str]) -> LoopJoint:
    """Return the closure of a Drake ball constraint in a URDF or SDF file.

    Args:
        source: the file.
        node: its element.
        bodies: names of links.

    Raises:
        SceneError: an element is missing, or there is no such link.
    """
    ends = []
    for body, point in (("body_A", "p_AP"), ("body_B", "p_BQ")):
        parts = [node.first(f"{BALL}_{tag}") for tag in (body, point)]
        if parts[0] is None or parts[1] is None:
            rule = f"needs <{BALL}_{body}> and <{BALL}_{point}>"
            raise source.error(node, node.tag, rule)
        name, at = _said(parts[0]), pin.SE3.Identity()
        if name not in bodies and name != WORLD:
            raise source.error(parts[0], name, f"no such link{nearest(name, bodies)}")
        at.translation = np.array(source.numbers(parts[1], _said(parts[1]), 3, "a point"))
        ends.append((name, at))
    return LoopJoint("ball_constraint", "spherical", ends[0], ends[1])


def left_open(nodes: Sequence[Node], links: Collection[str]) -> tuple[list[Note], list[Node]]:
    """Return notes of loops in elements that are not read, and the other elements.

    Args:
        nodes: elements that are not read.
        links: names of links and frames.
    """
    notes, others = [], []
    for node in nodes:
        note = _open(node, links)
        if note is None:
            others.append(node)
        else:
            notes.append(note)
    return notes, others


def _open(node: Node, links: Collection[str]) -> Note | None:
    """Return the note of a loop if an element joins two links by its names."""
    if node.tag == "plugin":
        words = node.attributes.get("filename", "") + node.attributes.get("name", "")
        joins = _PLUGIN.search(words)
    else:
        joins = _JOINING.search(node.tag)
    if not joins:
        return None
    ends: dict[str, Node] = {}
    points = []
    for part in node.walk():
        for written in (part.text, *part.attributes.values()):
            name = written.strip()
            if part is not node and (name in links or name == WORLD):
                ends.setdefault(name, part)
        points += [one for one in (_numbers(_said(part)),) if one]
    if len(ends) != 2:
        return None
    name = node.attributes.get("name", "").strip() or node.tag
    closure: dict[str, object] = {"name": clean(name), "kind": _kind(node)}
    turn = _turn(node) if closure["kind"] == "revolute" else pin.SE3.Identity()
    for k, (side, (link, part)) in enumerate(zip("ab", ends.items(), strict=True)):
        own = _numbers(part.attributes.get("xyz", ""))
        at = own or (points[k] if len(points) == 2 and "bushing" not in node.tag else None)
        rpy = _numbers(part.attributes.get("rpy", "")) or [0.0] * 3
        place = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(at or [0.0] * 3)) * turn
        closure[side] = {"link": link}
        if not place.isIdentity(0.0):
            closure[side] = {"link": link, "origin": origin_of(place)}
    # Flow style of YAML.
    written = re.sub(r'"([A-Za-z_]\w*)"', r"\1", json.dumps([closure], ensure_ascii=False))
    what = f"{LEFT_OPEN}: {name} between {' and '.join(ends)}"
    return Note(what, 1, f"<{node.tag}> is not read: write closures: {written}")


def _kind(node: Node) -> str:
    """Return the kind of closure that an element is most like."""
    kind = node.attributes.get("type", "").strip()
    words = f"{node.tag} {kind} {node.attributes.get('filename', '')}"
    stiff = node.first(_STIFFNESS)
    if stiff is not None:
        held = [bool(one) for one in _numbers(_said(stiff)) or [1.0] * 3]
        return "revolute" if held == [True, True, False] else "weld" if any(held) else "spherical"
    if kind in _HINGES:
        return "revolute"
    return "weld" if re.search("weld|fix|attach|detach", words, re.IGNORECASE) else "spherical"


def _turn(node: Node) -> pin.SE3:
    """Return the rotation of z to the axis of an element; none without one."""
    axis = node.first("axis")
    along = _numbers(axis.attributes.get("xyz", "")) if axis is not None else None
    return from_z(np.array(along)) if along is not None and any(along) else pin.SE3.Identity()


def _said(node: Node) -> str:
    """Return a name or value as URDF or as SDF has it."""
    attributes = node.attributes
    return (attributes.get("name") or attributes.get("value") or node.text).strip()


def _numbers(written: str) -> list[float] | None:
    """Return the three numbers in a text, or None if it is something else."""
    parts = written.split(maxsplit=3)
    if len(parts) != 3 or not all(_NUMBER.fullmatch(part) for part in parts):
        return None
    found = [float(part) for part in parts]
    return found if np.isfinite(found).all() else None
