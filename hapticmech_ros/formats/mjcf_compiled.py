# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An MJCF file, compiled by MuJoCo in a child process with limits.

Files are not trusted: a faulty one can crash MuJoCo, or take all memory. MuJoCo gets the elements
of the file and its includes as one text, an element a line: the limits of files are checked first,
and a line in its errors is that of an element.

Elements of included files replace the ``include`` elements.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from importlib.util import find_spec
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import SceneError, nearest
from hapticmech_ros.files import exists
from hapticmech_ros.files.cage import CageError, Limits, caged
from hapticmech_ros.files.mjcf_compiler import ARRAYS, compiled
from hapticmech_ros.formats.tree import LINK_LIMIT
from hapticmech_ros.formats.xml_nodes import NODE_LIMIT, Node, Source
from hapticmech_ros.scene.part import LARGEST


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
            if exists(one / name):
                return one / name
        rule = f"no such file in {[str(one) for one in folders]}"
        raise self._source.error(node, name, rule)


# MuJoCo's library takes 0.2 GB, large meshes as much again.
LIMITS = Limits(memory=1_500_000_000, seconds=60, output=64_000_000)
INSTALL = "pip install 'hapticmech_ros[mjcf]'"
REPLICATE = "replicate"
WRITE_OUT = "is not read: give the file with its bodies written out"
SEEN = ("camera", "light")
IN_BODIES = (
    *("body", "frame", REPLICATE, "joint", "freejoint", "geom", "site", "inertial"),
    *SEEN,
)
REFERRING = ("tendon", "equality", "actuator")
# Sections that affect a mechanism. MuJoCo does not get the others, which may need missing files.
SECTIONS = (
    *("compiler", "option", "extension", "asset", "default", "worldbody", "keyframe"),
    *REFERRING,
)
# Attributes of elements that have others as well, which may need missing files.
OF_ALONE = {"key": ("name", "qpos", "qvel"), "material": ("name", "class", "rgba")}
# Advice for MuJoCo's errors.
ADVICE = {"only HINGE and SLIDE": ": write it as such joints, or hold its body by <weld>"}
# Kinds of elements by the prefix of their arrays' names.
KINDS = {
    **{kind: kind for kind in ("body", "geom", "site", "tendon", "key")},
    "jnt": "joint",
    "eq": "equality",
}


class Compiled:
    """A file compiled by MuJoCo.

    Attributes:
        source: the file.
        said: result of :func:`hapticmech_ros.files.mjcf_compiler.compiled`.
        elements: name, line in the text and type of each, by kind.

    Raises:
        SceneError: there is no MuJoCo, it refuses the file, or a number is not finite.
    """

    def __init__(self, source: Source) -> None:
        self.source = source
        if find_spec("mujoco") is None:
            rule = f"MuJoCo reads MJCF files, and is not installed: {INSTALL}"
            raise source.error(source.root, source.root.tag, rule)
        for tag, limit in (("", NODE_LIMIT), ("body", LINK_LIMIT)):
            count = _count(source.root, tag)
            if count > limit:
                rule = f"at most {limit} elements{tag and f' <{tag}>'}, replicas counted"
                raise source.error(source.root, count, rule)
        equalities = sum(len(section.children) for section in source.root.all("equality"))
        if equalities > LINK_LIMIT:
            raise source.error(source.root, equalities, f"at most {LINK_LIMIT} equalities")
        self._nodes: list[Node] = []
        text = "".join(self._written(source.root, source.root))
        item = {"text": text, "folder": str(source.path.resolve().parent)}
        try:
            (self.said,) = caged(compiled, [item], LIMITS)
        except CageError as error:
            rule = f"MuJoCo, which reads it: the file {error.rule}"
            raise source.error(source.root, source.root.tag, rule) from None
        if "refused" in self.said:
            raise self._refused(self.said["refused"])
        self.elements: dict[str, list[tuple[str, int, str]]] = self.said["elements"]
        self._arrays = {name: self._finite(name) for name in ARRAYS}

    def __getitem__(self, name: str) -> np.ndarray:
        """Return an array of the compiled model."""
        return self._arrays[name]

    def node(self, kind: str, number: int) -> Node:
        """Return an element as it is written; of the world, the outermost one."""
        line = self.elements[kind][number][1]
        if not line and kind == "joint":  # MuJoCo has no lines of <freejoint>
            body = self.node("body", int(self["jnt_bodyid"][number]))
            return next((one for one in body.walk() if one.tag == "freejoint"), body)
        return self._nodes[max(line - 1, 0)]

    def names(self, kind: str) -> list[str]:
        """Return the names of all elements of a kind, empty for those without one."""
        return [name for name, _, _ in self.elements[kind]]

    def at(self, line: int) -> Node:
        """Return the element in a line of the text."""
        return self._nodes[line - 1]

    def place(self, kind: str, number: int) -> pin.SE3:
        """Return where an element is in its body, or a body in its parent."""
        return pose(*(self[f"{kind}_{part}"][number] for part in ("pos", "quat")))

    def left_out(self) -> int:
        """Return how many elements MuJoCo drops, as they refer to a replica and to others."""
        kept = {id(self.at(line)) for line in self.said["referring"]}
        sections = [one for one in self.source.root.children if one.tag in REFERRING]
        return sum(id(child) not in kept for one in sections for child in one.children)

    def _written(self, node: Node, root: Node) -> Iterable[str]:
        """Yield the text of an element."""
        self._nodes.append(node)
        attributes = "".join(
            f" {key}={quoteattr(value)}"
            for key, value in node.attributes.items()
            if (
                key in OF_ALONE[node.tag]
                if node.tag in OF_ALONE
                else key != "material" or node.tag == "geom"
            )
        )
        yield f"{chr(10) if node is not root else ''}<{node.tag}{attributes}>"
        for child in node.children:
            if node.tag in ("worldbody", "body", "frame", REPLICATE) and child.tag not in IN_BODIES:
                raise self.source.error(child, child.tag, WRITE_OUT)
            if (
                child.tag not in SEEN
                and (node is not root or child.tag in SECTIONS)
                and (node.tag != "asset" or child.tag in ("mesh", "material"))
                and node.tag != "material"
            ):
                yield from self._written(child, root)
        yield f"</{node.tag}>"

    def _refused(self, said: str) -> SceneError:
        """Return MuJoCo's error, at the element whose line it names."""
        found = re.search(r"\bline (\d+)\s*$", said) or re.search(r"Line number=(\d+)", said)
        line = 0 if found is None else int(found[1])
        node = self._nodes[line - 1] if 0 < line <= len(self._nodes) else self.source.root
        rule = re.sub(r"^(XML )?(Error: )*", "", said.partition("\nElement")[0])
        again = re.match(r"repeated name '(.*)' in", rule)
        if again is not None:
            same = (one for one in self._nodes if one.attributes.get("name") == again[1])
            first = next((one for one in same if one.tag == node.tag and one is not node), None)
            return self.source.twice(node, again[1], first, f"MuJoCo refuses it: {rule}")
        known = {one.attributes.get("name", "") for one in self.source.root.walk()} - {""}
        word = re.search(r"unknown.*'(.+)'|'(.+)' not found", rule)
        like = "" if word is None else nearest(word[1] or word[2], known)
        like += "".join(advice for words, advice in ADVICE.items() if words in rule)
        value = node.attributes.get("name", node.tag)
        return self.source.error(node, value, f"MuJoCo refuses it: {rule}{like}")

    def _finite(self, name: str) -> np.ndarray:
        """Return an array, whose numbers are finite and of a size that a scene has.

        A range may be of any size: one beyond a scene's is no stop.
        """
        found = np.array(self.said[name], dtype=float)
        largest = np.inf if name == "jnt_range" else LARGEST
        wrong = np.argwhere(~(np.abs(found) <= largest))
        if len(wrong):
            row = int(wrong[0, 0])
            part, _, what = name.partition("_")
            kind = KINDS.get(part)
            node = self.source.root if kind is None else self.node(kind, row)
            rule = f"{what or name} must be finite, and not above {LARGEST:g} in size"
            raise self.source.error(node, self.said[name][row], rule)
        return found


def pose(position: np.ndarray, quaternion: np.ndarray) -> pin.SE3:
    """Return a frame.

    Args:
        position: (3,) m.
        quaternion: (4,) of length 1, w first.
    """
    w, x, y, z = quaternion
    return pin.XYZQUATToSE3(np.array([*position, x, y, z, w]))


def _count(node: Node, tag: str = "") -> int:
    """Return how many elements (of a kind) an element becomes, its replicas counted."""
    found = tag in ("", node.tag)
    inside = sum(_count(child, tag) for child in node.children)
    if node.tag != REPLICATE:
        return found + inside
    try:
        return found + inside * int(node.attributes.get("count", "")[:9])
    except ValueError:  # MuJoCo refuses it
        return found
