# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Includes of MJCF, and replicas: what an element names or repeats stands in its place.

``replicate`` is written out, with what refers to names in it, as MuJoCo's compiler does: replica k
is turned by k times ``euler``, and offset from the one before in that one's axes; names end in its
number. Equalities, tendons and actuators whose names are all in it are replicated with it; those
with some in it and some not are left out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from hapticmech_ros.formats.mjcf_classes import Context
from hapticmech_ros.formats.xml_nodes import NODE_LIMIT, Node, Source

REPLICATE = "replicate"
LEFT_OUT = "reference from a replica to what is not in it"
WHY = {LEFT_OUT: "left out, as by MuJoCo's compiler"}
SECTIONS = ("tendon", "equality", "actuator")
# Elements with names, by the kind that a name is of.
KINDS = {
    **{tag: tag for tag in ("body", "joint", "geom", "site", "camera", "light")},
    "freejoint": "joint",
}
# Attributes that refer to names, by the kind of what they name.
REFERENCES = {
    **{f"{kind}{n}": kind for kind in ("body", "joint", "geom", "site") for n in ("", "1", "2")},
    "tendon": "tendon",
    "tendon1": "tendon",
    "tendon2": "tendon",
    "jointinparent": "joint",
    "sidesite": "site",
    "refsite": "site",
    "cranksite": "site",
    "slidersite": "site",
}
# Kind and name.
Named = tuple[str, str]


def open_replicas(context: Context, notes: Counter[str]) -> None:
    """Put frames with replicas in the place of every ``replicate`` of a file.

    Args:
        context: the file, its includes opened.
        notes: to count what is left out in.

    Raises:
        SceneError: a count that is no whole number or too large; names line and value.
    """
    _Replicas(context, notes).open()


class _Replicas:
    def __init__(self, context: Context, notes: Counter[str]) -> None:
        self._context, self._source, self._notes = context, context.source, notes
        self._size = sum(1 for _ in self._source.root.walk())

    def open(self) -> None:
        for world in self._source.root.all("worldbody"):
            # The innermost first: what is outside replicates what they have become.
            inner = [node for node in world.walk() if _has_replicate(node)]
            for node in reversed(inner):
                node.children[:] = [
                    found
                    for child in node.children
                    for found in (self._opened(child) if child.tag == REPLICATE else [child])
                ]

    def _opened(self, node: Node) -> list[Node]:
        source = self._source
        (number,) = source.numbers(node, source.text(node, "count"), 1, "count")
        count = int(number)
        if count != number or count < 0:
            raise source.error(node, number, "count must be a whole number, not below 0")
        names = {
            (KINDS[part.tag], part.attributes["name"].strip())
            for part in node.walk()
            if part.tag in KINDS and part.attributes.get("name", "").strip()
        }
        self._grow(node, count, sum(1 for _ in node.walk()))
        offset = np.array(source.values(node, "offset", (0.0, 0.0, 0.0)))
        euler = np.array(source.values(node, "euler", (0.0, 0.0, 0.0)))
        separator, position = node.attributes.get("sep", ""), np.zeros(3)
        suffixes = [f"{separator}{k:0{len(str(count))}d}" for k in range(count)]
        frames = []
        for k, suffix in enumerate(suffixes):
            turned = {"euler": " ".join(repr(float(angle)) for angle in k * euler)}
            rotation = self._context.rotation(replace(node, attributes=turned))
            attributes = {"pos": _text(position), "quat": _quaternion(rotation)}
            if "childclass" in node.attributes:
                attributes["childclass"] = node.attributes["childclass"]
            inside = [_with_suffix(child, names, suffix) for child in node.children]
            frames.append(replace(node, tag="frame", attributes=attributes, children=inside))
            position = position + rotation @ offset
        self._replicate_references(names, suffixes)
        return frames

    def _grow(self, node: Node, count: int, size: int) -> None:
        self._size += count * size
        if self._size > NODE_LIMIT:
            rule = f"at most {NODE_LIMIT} elements, replicas counted"
            raise self._source.error(node, self._size, rule)

    def _replicate_references(self, names: set[Named], suffixes: list[str]) -> None:
        """Replicate what refers to names; tendons first, as others refer to them."""
        names = set(names)
        for tag in SECTIONS:
            for section in self._source.root.all(tag):
                found: list[Node] = []
                for child in section.children:
                    given = _references(child)
                    inside = given & names
                    if not inside:
                        found.append(child)
                    elif inside < given:
                        self._notes[LEFT_OUT] += 1
                    else:
                        self._grow(child, len(suffixes), sum(1 for _ in child.walk()))
                        if tag == "tendon" and "name" in child.attributes:
                            names.add(("tendon", child.attributes["name"].strip()))
                        found += [_copy(child, names, suffix) for suffix in suffixes]
                section.children[:] = found


def _has_replicate(node: Node) -> bool:
    return any(child.tag == REPLICATE for child in node.children)


def _references(node: Node) -> set[Named]:
    """Return what an element and those in it refer to."""
    return {
        (REFERENCES[key], value.strip())
        for part in node.walk()
        for key, value in part.attributes.items()
        if key in REFERENCES
    }


def _with_suffix(node: Node, names: set[Named], suffix: str) -> Node:
    """Return a copy of a part of a body, names with the suffix."""
    attributes = dict(node.attributes)
    if node.tag in KINDS and (KINDS[node.tag], attributes.get("name", "").strip()) in names:
        attributes["name"] = attributes["name"].strip() + suffix
    children = [_with_suffix(child, names, suffix) for child in node.children]
    return replace(node, attributes=attributes, children=children)


def _copy(node: Node, names: set[Named], suffix: str) -> Node:
    """Return a copy of what refers to a replica, and its name, with the suffix."""
    attributes: Mapping[str, str] = {
        key: value.strip() + suffix
        if key == "name" or (REFERENCES.get(key), value.strip()) in names
        else value
        for key, value in node.attributes.items()
    }
    children = [_copy(child, names, suffix) for child in node.children]
    return replace(node, attributes=dict(attributes), children=children)


def _text(vector: np.ndarray) -> str:
    return " ".join(repr(float(x)) for x in vector)


def _quaternion(rotation: np.ndarray) -> str:
    x, y, z, w = pin.Quaternion(rotation).coeffs()
    return _text(np.array((w, x, y, z)))


def open_includes(source: Source) -> None:
    """Put the elements of included files, without their outermost, where these are included.

    A file is named from the main file's folder, else from that of the file that includes it, and
    included once at most. All files together are within the limits of one.

    Raises:
        SceneError: no such file, a second time, or too much; names file and line.
    """
    _Includes(source).open()


class _Includes:
    def __init__(self, source: Source) -> None:
        self._source = source
        self._seen = {source.path.resolve()}

    def open(self) -> None:
        pending = [(self._source.root, 1, self._source.path.parent)]
        while pending:
            node, depth, folder = pending.pop()
            opened = list(self._opened(node.children, depth, folder))
            node.children[:] = [child for child, _ in opened]
            pending += [(child, depth + 1, where) for child, where in opened if child.children]

    def _opened(
        self, children: list[Node], depth: int, folder: Path
    ) -> Iterator[tuple[Node, Path]]:
        """Yield elements, and the folders of their files."""
        for child in children:
            if child.tag != "include":
                yield child, folder
                continue
            included = self._read(child, depth, folder)
            # Deeper by one, so that files cannot include each other for ever.
            inner = included.path.parent
            yield from self._opened(included.root.children, depth + 1, inner)

    def _read(self, node: Node, depth: int, folder: Path) -> Source:
        name = self._source.text(node, "file")
        if node.children:
            raise self._source.error(node, name, "an include has nothing in it")
        path = self._find(node, name, folder)
        if path.resolve() in self._seen:
            raise self._source.error(node, name, "a file is included once at most")
        self._seen.add(path.resolve())
        found = Source(path, self._source, depth)
        if not found.root.children:
            raise self._source.error(node, name, "an included file must not be empty")
        return found

    def _find(self, node: Node, name: str, folder: Path) -> Path:
        folders = dict.fromkeys((self._source.path.parent, folder))
        for one in folders:
            try:
                if (one / name).exists():
                    return one / name
            except (OSError, ValueError):  # too long a name, or one with a zero byte
                continue
        rule = f"no such file in {[str(one) for one in folders]}"
        raise self._source.error(node, name, rule)
