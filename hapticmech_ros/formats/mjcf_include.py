# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Includes of MJCF: the elements of other files stand in the place of what names these."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from hapticmech_ros.formats.xml_nodes import Node, Source


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
