# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the links, joints and frames of an SDFormat model are: each relative to another.

Parts of models in models are those of one, by names such as arm::hand::finger.

Includes of SDFormat: the model of another file stands where the element that names it is.
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import nearest
from hapticmech_ros.files import exists
from hapticmech_ros.formats.loops import BALL
from hapticmech_ros.formats.model import WORLD
from hapticmech_ros.formats.xml_nodes import Node, Source

# Files that include each other, and includes of a file and of those that it includes.
DEEPEST, INCLUDE_LIMIT = 10, 100
# Versions of the format in which axes are those of the model.
OF_MODEL = ("1.0", "1.2", "1.3", "1.4")
SCHEME = "model://"
FRAME = "use_parent_model_frame"


def open_includes(source: Source) -> None:
    """Put models of included files where these are included, with the include's name and pose.

    A file is looked for from the folder of the file that includes it: a path, or the folder of a
    model, which is there or beside that folder. Nothing else is searched, and no network. A world's
    include without a file, such as its sun, stays an ``include``.

    Raises:
        SceneError: no such file, no model in it, too many, or files that include each other;
            names file and line.
    """
    _Includes(source).open()


class _Includes:
    def __init__(self, source: Source) -> None:
        self._source, self._count = source, 0

    def open(self) -> None:
        root, path = self._source.root, self._source.path
        for scope in (*root.all("world"), *root.all("model")):
            self._open(scope, (path,), root.attributes.get("version", ""))

    def _open(self, scope: Node, files: tuple[Path, ...], version: str, depth: int = 1) -> None:
        """Open the includes of a world or model, and of the models in it."""
        for place, child in enumerate(scope.children):
            if child.tag == "include":
                is_optional = scope.tag == "world"
                if not is_optional or self._found(child, files[-1].parent) is not None:
                    scope.children[place] = self._model(child, files, depth)
            elif child.tag == "model":
                self._open(child, files, version, depth + 1)
            elif child.tag == "joint" and len(files) > 1:
                for axis in _without_frame(child):
                    text = "1" if version.strip() in OF_MODEL else "0"
                    axis.children.append(Node(FRAME, {}, axis.line, text=text, file=axis.file))

    def _model(self, node: Node, files: tuple[Path, ...], depth: int) -> Node:
        source = self._source
        if node.attributes.get("merge", "false").strip() in ("true", "1"):
            raise source.error(node, "merge", "an included model is kept as one: leave merge out")
        self._count += 1
        if self._count > INCLUDE_LIMIT:
            raise source.error(node, self._count, f"at most {INCLUDE_LIMIT} includes")
        uri, folder = node.first("uri"), files[-1].parent
        if uri is None or not uri.text.strip():
            raise source.error(node, node.attributes.get("name"), "an include needs a <uri>")
        path = self._found(node, folder)
        if path is None:
            rule = (
                f"no such file, nor a folder with a model.sdf, in {folder}, nor for {SCHEME} beside"
                " it; nothing else is searched"
            )
            raise source.error(uri, uri.text.strip(), rule)
        if path.resolve() in {file.resolve() for file in files}:
            raise source.error(uri, uri.text.strip(), "files include each other in a circle")
        if len(files) > DEEPEST:
            rule = f"at most {DEEPEST} files that include each other"
            raise source.error(uri, uri.text.strip(), rule)
        found = Source(path, source, depth).root
        models = found.all("model")
        if found.tag != "sdf" or len(models) != 1:
            rule = "an included file must be <sdf> with one <model>"
            raise source.error(uri, uri.text.strip(), rule)
        (model,) = models
        self._open(model, (*files, path), found.attributes.get("version", ""), depth + 1)
        return _placed(model, node)

    def _found(self, node: Node, folder: Path) -> Path | None:
        """Return the file that an include names; None if there is none."""
        uri = node.first("uri")
        written = "" if uri is None else uri.text.strip()
        named = written.removeprefix(SCHEME)
        if not named or "://" in named:
            return None
        for one in (folder, folder.parent) if named != written else (folder,):
            found = one / named
            if exists(found) and found.is_dir():
                found = found / "model.sdf"
            if exists(found):
                return found
        return None


def _placed(model: Node, include: Node) -> Node:
    """Return a model with the name, pose, and whether it moves, that its include gives it."""
    attributes, children = dict(model.attributes), list(model.children)
    for key in ("name", "placement_frame"):
        given = include.first(key)
        if given is not None:
            attributes[key] = given.text.strip()
    for key in ("pose", "static"):
        given = include.first(key)
        if given is not None:
            children = [given, *(child for child in children if child.tag != key)]
    known = ("uri", "name", "placement_frame", "pose", "static")
    children += [child for child in include.children if child.tag not in known]
    return replace(model, attributes=attributes, children=children)


def _without_frame(joint: Node) -> Iterator[Node]:
    """Yield the axes of a joint that name no frame."""
    for tag in ("axis", "axis2"):
        for axis in joint.all(tag):
            if axis.first(FRAME) is None:
                yield axis


# How many frames may be attached to each other.
DEEP = 100


@dataclass
class Frames:
    """The frames of a model.

    Attributes:
        source: its file.
        poses: in the world, as far as computed.
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
        """Record the frame and the pose in it of a link, joint, frame or model.

        Raises:
            SceneError: a name that occurs twice.
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
        """Return the frame of an element's pose, empty if it names none, and the pose.

        Raises:
            SceneError: a frame or a format of rotations that is not supported.
        """
        written = node.first("pose")
        if written is None:
            return "", pin.SE3.Identity()
        if written.attributes.get("frame", ""):
            rule = "frames of SDFormat 1.6 and before are not read: use relative_to"
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
        """Return the name of the frame that a frame, joint or model is fixed in."""
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


HERE = "__model__"
# Attributes and elements that name links, joints and frames of their model.
NAMING = {"relative_to", "attached_to", "expressed_in"}
NAMING_ELEMENTS = {
    "parent",
    "child",
    "gearbox_reference_body",
    f"{BALL}_body_A",
    f"{BALL}_body_B",
}
NAMED = {"link", "joint", "frame"}
# Characters of the names of models that are in each other; every name in them begins so.
PREFIX_LIMIT = 200


@dataclass(frozen=True, slots=True)
class Scope:
    """The model that something is in.

    Attributes:
        prefix: of all names in it.
        canonical: link that moves its frame; empty if it has none.
    """

    prefix: str
    canonical: str

    @property
    def here(self) -> str:
        """The name of its frame."""
        return self.prefix + HERE


def opened(source: Source, model: Node, prefix: str = "") -> Iterator[tuple[Node, Scope]]:
    """Yield the elements of a model and of the models in it, with names from outside.

    A model in it comes as an element of that kind, with its frame's name and its pose alone.

    Raises:
        SceneError: a model in it is placed by another frame than its own, or its name is too long.
    """
    scope = Scope(prefix, _canonical(source, model, prefix))
    for node in model.children:
        if node.tag != "model":
            yield (_renamed(node, prefix) if prefix else node), scope
            continue
        inner = f"{prefix}{source.text(node, 'name')}::"
        if len(inner) > PREFIX_LIMIT:
            rule = f"names of models in each other have at most {PREFIX_LIMIT} characters"
            raise source.error(node, inner, rule)
        if "placement_frame" in node.attributes:
            rule = "a model is placed by its own frame"
            raise source.error(node, node.attributes["placement_frame"], rule)
        placed = [_renamed(pose, prefix) if prefix else pose for pose in node.all("pose")]
        yield replace(node, attributes={"name": inner + HERE}, children=placed), scope
        yield from opened(source, node, inner)


def _canonical(source: Source, model: Node, prefix: str) -> str:
    """Return the link that a model names as the one that moves its frame; else its first."""
    if "canonical_link" in model.attributes:
        return prefix + source.text(model, "canonical_link")
    first = model.first("link")
    if first is not None:
        return prefix + source.text(first, "name")
    for inner in model.all("model"):
        found = _canonical(source, inner, f"{prefix}{source.text(inner, 'name')}::")
        if found:
            return found
    return ""


def _renamed(node: Node, prefix: str) -> Node:
    """Return an element of a model with its name and those that it refers to as from outside."""
    attributes = dict(node.attributes)
    naming = NAMING | ({"name"} if node.tag in NAMED else set())
    if node.tag == "mimic":
        naming = {"joint"}
    for key in naming & attributes.keys():
        attributes[key] = _outside(attributes[key], prefix)
    text = _outside(node.text, prefix) if node.tag in NAMING_ELEMENTS else node.text
    children = [_renamed(child, prefix) for child in node.children]
    return replace(node, attributes=attributes, text=text, children=children)


def _outside(name: str, prefix: str) -> str:
    name = name.strip()
    return name if name in ("", WORLD) else prefix + name
