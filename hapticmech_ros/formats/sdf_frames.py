# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the links, joints and frames of an SDFormat model are: each relative to another."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import nearest
from hapticmech_ros.formats.model import WORLD
from hapticmech_ros.formats.sdf_nested import HERE, Scope
from hapticmech_ros.formats.xml_nodes import Node, Source

# How many frames may be attached to each other.
DEEP = 100


@dataclass
class Frames:
    """The frames of a model.

    Attributes:
        source: its file.
        poses: in the world, as far as they were asked for.
        scopes: the models that links, joints, frames and models are in.
        canonical: by name of a model's frame, the link that moves it; empty if there is none.
        nodes: elements of all of these by name; joints, frames: those of a kind.
    """

    source: Source
    placed: dict[str, tuple[str, pin.SE3]] = field(default_factory=dict)
    poses: dict[str, pin.SE3] = field(default_factory=dict)
    scopes: dict[str, Scope] = field(default_factory=dict)
    canonical: dict[str, str] = field(default_factory=dict)
    nodes: dict[str, Node] = field(default_factory=dict)
    joints: dict[str, Node] = field(default_factory=dict)
    frames: dict[str, Node] = field(default_factory=dict)

    def place(self, node: Node, scope: Scope) -> None:
        """Note where a link, joint, frame or model is said to be: in what other, and how.

        Raises:
            SceneError: a name that is there twice.
        """
        name = self.source.text(node, "name")
        if name in self.placed or name in (WORLD, HERE):
            rule = "names of links, joints, frames must be unique"
            raise self.source.twice(node, name, self.nodes.get(name), rule)
        self.nodes[name] = node
        relative, pose = self.written(node)
        if not relative and node.tag == "joint":
            relative = self.end_name(node, "child")
        elif not relative:
            attached = node.attributes.get("attached_to", "") if node.tag == "frame" else ""
            relative = attached or scope.here
        self.placed[name] = (relative, pose)
        self.scopes[name] = scope
        self.canonical[scope.here] = scope.canonical
        if node.tag in ("joint", "frame"):
            named = self.joints if node.tag == "joint" else self.frames
            named[name] = node

    def written(self, node: Node) -> tuple[str, pin.SE3]:
        """Return what an element's pose is relative to, empty if it does not say, and the pose.

        Raises:
            SceneError: a frame or a format of rotations that is not supported.
        """
        written = node.first("pose")
        if written is None:
            return "", pin.SE3.Identity()
        if written.attributes.get("frame", ""):
            rule = "frames of SDFormat 1.6 and before are not read: say relative_to"
            raise self.source.error(written, written.attributes["frame"], rule)
        if written.attributes.get("rotation_format", "euler_rpy") != "euler_rpy":
            rule = "rotations must be euler_rpy"
            raise self.source.error(written, written.attributes["rotation_format"], rule)
        values = self.source.numbers(written, written.text or "0 0 0 0 0 0", 6, "a pose")
        turn = np.array(values[3:])
        if written.attributes.get("degrees", "false") in ("true", "1"):
            turn = np.deg2rad(turn)
        pose = pin.SE3(pin.rpy.rpyToMatrix(*turn), np.array(values[:3]))
        return written.attributes.get("relative_to", ""), pose

    def end_name(self, joint: Node, end: str) -> str:
        """Return the name in an element of a joint, such as its parent's.

        Raises:
            SceneError: the element is missing.
        """
        found = joint.first(end)
        name = found.text.strip() if found is not None else ""
        if not name:
            raise self.source.error(joint, joint.attributes.get("name"), f"needs a <{end}>")
        return name

    def pose(self, name: str, node: Node) -> pin.SE3:
        """Return where something is in the world.

        Args:
            name: of it.
            node: element that names it, for errors.

        Raises:
            SceneError: an unknown frame, or frames in a circle.
        """
        chain: dict[str, None] = {}  # in order
        name = first = self._known(name)
        while name not in self.poses:
            if name not in self.placed:
                rule = f"no such link, joint or frame{nearest(name, self.placed)}"
                raise self.source.error(node, name, rule)
            if name in chain:
                rule = "poses are relative to each other in a circle"
                raise self.source.error(node, list(chain)[:5], rule)
            chain[name] = None
            name = self._known(self.placed[name][0])
        for one in reversed(chain):
            relative, pose = self.placed[one]
            self.poses[one] = self.poses[self._known(relative)] * pose
        return self.poses[first]

    def within(self, node: Node, link: str) -> pin.SE3:
        """Return where an element of a link is in it."""
        relative, place = self.written(node)
        if not relative:
            return place
        return self.pose(link, node).actInv(self.pose(relative, node) * place)

    def body_of(self, name: str, node: Node, bodies: Container[str]) -> str:
        """Return the link that a frame of the file is fixed in; ``world`` if none is.

        Args:
            name: of the frame.
            node: its element, for errors.
            bodies: names of links.

        Raises:
            SceneError: no such frame, or a circle of them.
        """
        seen: set[str] = set()
        while name not in bodies and name != WORLD:
            if name in seen or len(seen) > DEEP:
                rule = f"frames are attached to each other in a circle, or more than {DEEP} deep"
                raise self.source.error(node, name, rule)
            seen.add(name)
            name = self._carrier(name, node) or WORLD
        return name

    def _carrier(self, name: str, node: Node) -> str:
        """Return what a frame, joint or model is fixed in."""
        if name in self.joints:
            return self.end_name(self.joints[name], "child")
        if name in self.frames:
            attached = self.frames[name].attributes.get("attached_to", "")
            return attached or self.scopes[name].canonical
        model = self._known(name)
        if model not in self.canonical:
            rule = f"no such link, joint or frame{nearest(name, self.placed)}"
            raise self.source.error(node, name, rule)
        return self.canonical[model]

    def _known(self, name: str) -> str:
        """Return a name; that of its frame, if it is a model's."""
        model = f"{name}::{HERE}"
        return model if model in self.placed and name not in self.placed else name
