# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""XML files as plain nodes that remember their lines: bounded, no entities, numbers checked.

expat takes them apart in this process, as it does for Python's own libraries.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from hapticmech_ros.errors import FileError, SceneError, scene_error
from hapticmech_ros.files import read_file
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene.part import LARGEST

FILE_SIZE_LIMIT = 8_000_000
NODE_LIMIT = 200_000
DEPTH_LIMIT = 200
ATTRIBUTE_LIMIT = 100
# A declaration at the start, before which files may have blank lines; its text, and encoding.
_DECLARATION = re.compile(r"(?:\xef\xbb\xbf)?(\s*)(<\?xml\s[^<>?]*\?>)")
_ENCODING = re.compile(r"encoding\s*=\s*[\"']([^\"']*)[\"']")
_BLANK = re.compile(r"(?:\xef\xbb\xbf)?\s*<\?\s+xml\s")
_SHOWN = re.compile(r"[^\r\n]")
# Parts that are no markup, up to the end of the text if they lack their own.
_APART = re.compile(r"(?s:<!--.*?(?:-->|\Z)|<!\[CDATA\[.*?(?:\]\]>|\Z)|<\?.*?(?:\?>|\Z))")


@dataclass(slots=True)
class Node:
    """An element.

    Attributes:
        tag: its name.
        attributes: as written.
        line: where it begins.
        children: elements in it.
        text: in it.
        file: that it is in, if not the main one.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Node] = field(default_factory=list)
    text: str = ""
    file: Path | None = None

    def all(self, tag: str) -> list[Node]:
        """Return the children of a kind."""
        return [child for child in self.children if child.tag == tag]

    def first(self, tag: str) -> Node | None:
        """Return the first child of a kind, or None."""
        return next((child for child in self.children if child.tag == tag), None)

    def walk(self) -> Iterator[Node]:
        """Yield this element and all in it, as they are written."""
        pending = [self]
        while pending:
            node = pending.pop()
            yield node
            pending += reversed(node.children)


class Source:
    """An XML file, and the errors that name it.

    Args:
        path: of the file.
        within: file that includes it, whose limits it shares.
        depth: how many elements of that it is in.

    Attributes:
        path: of the file.
        root: its outermost element.

    Raises:
        SceneError: cannot be read, too large, too deep, or not XML; entities are refused.
    """

    def __init__(self, path: Path, within: Source | None = None, depth: int = 0) -> None:
        self.path = path
        self._depth, self._file = depth, None if within is None else path
        # Its limits are for it and all files that it includes.
        self._outermost: Source = self if within is None else within._outermost
        self._bytes = self._elements = 0
        try:
            self.root = self._nodes(self._read())
        except FileError as error:
            raise SceneError.of_file(error) from None

    def error(self, node: Node | None, value: object, rule: str) -> SceneError:
        """Return the error of something in the file."""
        where = "file" if node is None else f"line {node.line}, <{node.tag}>"
        file = self.path if node is None else node.file or self.path
        return scene_error(str(file), where, value, rule)

    def where(self, node: Node) -> str:
        """Return the line and tag of an element, and its file if that is an included one."""
        file = f"{node.file}, " if node.file is not None else ""
        return f"{file}line {node.line}, <{node.tag}>"

    def twice(self, node: Node, name: str, first: Node | None, rule: str) -> SceneError:
        """Return the error of a name that an element before has as well, if it is known."""
        also = "" if first is None else f": {self.where(first)} has it too"
        return self.error(node, name, rule + also)

    def text(self, node: Node, attribute: str, default: str | None = None) -> str:
        """Return an attribute; required where there is no default.

        Raises:
            SceneError: a required attribute is missing.
        """
        found = node.attributes.get(attribute, default)
        if found is None or (default is None and not found.strip()):
            raise self.error(node, found, f"needs {attribute}=...")
        return found.strip()

    def numbers(
        self,
        node: Node,
        written: str,
        count: int,
        what: str = "value",
        largest: float = LARGEST,
    ) -> tuple[float, ...]:
        """Return so many finite numbers that are written one after the other.

        Raises:
            SceneError: not so many numbers, or not finite.
        """
        parts = written.split(maxsplit=count)
        try:
            if "_" in written:
                raise ValueError
            found = tuple(float(part) for part in parts)
        except ValueError:
            rule = f"{what} must be {count} number(s)"
            raise self.error(node, written, rule) from None
        if len(found) != count or not all(math.isfinite(value) for value in found):
            raise self.error(node, written, f"{what} must be {count} finite number(s)")
        if any(abs(value) > largest for value in found):
            raise self.error(node, written, f"{what} must not be above {largest:g} in size")
        return found

    def values(
        self,
        node: Node | None,
        attribute: str,
        default: Sequence[float],
        largest: float = LARGEST,
    ) -> tuple[float, ...]:
        """Return the numbers in an attribute, or the default; as many as the default has."""
        if node is None or attribute not in node.attributes:
            return tuple(default)
        return self.numbers(node, node.attributes[attribute], len(default), attribute, largest)

    def value(
        self,
        node: Node | None,
        attribute: str,
        default: float | None = None,
        largest: float = LARGEST,
    ) -> float:
        """Return the number in an attribute; required where there is no default."""
        if node is not None and default is None:
            self.text(node, attribute)
        return self.values(node, attribute, (0.0 if default is None else default,), largest)[0]

    def inside(
        self,
        node: Node | None,
        tag: str,
        default: Sequence[float],
        largest: float = LARGEST,
    ) -> tuple[float, ...]:
        """Return the numbers in an element's own element, or the default; as many as it has."""
        found = None if node is None else node.first(tag)
        if found is None:
            return tuple(default)
        return self.numbers(found, found.text, len(default), tag, largest)

    def unit(self, node: Node | None, vector: Sequence[float], what: str) -> Array:
        """Return a vector (3,) with a length of 1.

        Raises:
            SceneError: it is zero.
        """
        found = np.array(vector)
        size = float(np.linalg.norm(found))
        if not size > 0.0:
            raise self.error(node, found.tolist(), f"{what} must not be zero")
        return np.asarray(found / size)

    def _read(self) -> bytes:
        found = read_file(self.path, FILE_SIZE_LIMIT)
        self._outermost._bytes += len(found)
        if self._outermost._bytes > FILE_SIZE_LIMIT:
            rule = f"at most {FILE_SIZE_LIMIT} bytes, included files counted"
            raise self.error(None, self._outermost._bytes, rule)
        return found

    def _nodes(self, data: bytes) -> Node:
        """Return the outermost element, with all that are in it, and count them.

        Raises:
            FileError: not XML, too large or too deep; entities are refused.
        """
        file, outermost = str(self.path), self._outermost
        above, texts = [Node("", {}, 0)], [[""]]
        # As text in which a character is a byte, whatever the file's encoding is.
        text, encoding = _as_parsers_take_it(data.decode("latin-1"))
        parser = expat.ParserCreate(encoding)

        def start(tag: str, attributes: dict[str, str]) -> None:
            outermost._elements += 1
            line = parser.CurrentLineNumber
            deep = len(above) + self._depth
            where = f"line {line}, <{tag}>"
            if outermost._elements > NODE_LIMIT:
                rule = f"at most {NODE_LIMIT} elements"
                raise FileError(file, outermost._elements, rule, where)
            if deep > DEPTH_LIMIT:
                raise FileError(file, deep, f"at most {DEPTH_LIMIT} elements in each other", where)
            if len(attributes) > ATTRIBUTE_LIMIT:
                rule = f"at most {ATTRIBUTE_LIMIT} attributes"
                raise FileError(file, len(attributes), rule, where)
            node = Node(tag, attributes, line, file=self._file)
            above[-1].children.append(node)
            above.append(node)
            texts.append([])

        def end(_tag: str) -> None:
            above.pop().text = "".join(texts.pop())

        def characters(text: str) -> None:
            texts[-1].append(text)

        def entity(name: str, *_rest: object) -> None:
            raise FileError(file, name, "entities are not read")

        parser.StartElementHandler = start
        parser.EndElementHandler = end
        parser.CharacterDataHandler = characters
        parser.EntityDeclHandler = entity
        parser.buffer_text = True
        try:
            parser.Parse(text.encode("latin-1"), True)
        except expat.ExpatError as error:
            said, rule = expat.errors.messages[error.code], "not valid XML"
            if _BLANK.match(text):
                rule += ": its declaration must begin with <?xml, without a blank before xml"
            raise FileError(file, said, rule, f"line {error.lineno}") from None
        except (ValueError, LookupError) as error:  # an unknown encoding
            raise FileError(file, str(error), "not valid XML") from None
        return above[0].children[0]


def _as_parsers_take_it(text: str) -> tuple[str, str | None]:
    """Return a text that expat parses like libxml and TinyXML, with the same lines.

    Comments with two hyphens in them are blank; so is a declaration after blank lines, or one that
    calls UTF-8 ``utf8``. Also return the encoding that such a declaration gave.
    """
    encoding, start = None, _DECLARATION.match(text)
    if start is not None:
        given = _ENCODING.search(start[2])
        named = given[1] if given is not None else ""
        is_alias = named.lower() == "utf8"
        if start[1] or is_alias:
            encoding = "UTF-8" if is_alias else named or None
            text = text[: start.start(2)] + _SHOWN.sub(" ", start[2]) + text[start.end() :]
    return _APART.sub(_accepted, text), encoding


def _accepted(found: re.Match[str]) -> str:
    """Return a part that is no markup; blanks for a comment that expat refuses."""
    part = found[0]
    is_comment = part.startswith("<!--") and part.endswith("-->")
    # The last hyphen of a comment such as <!-- a ---> counts too.
    return _SHOWN.sub(" ", part) if is_comment and "--" in part[4:-2] else part
