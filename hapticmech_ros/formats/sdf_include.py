# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Includes of SDFormat: the model of another file stands where the element that names it is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

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
    model, which is there or beside that folder. Nothing else is searched, and no network. What a
    world includes and is not there, such as its sun, stays an ``include``.

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
        """Open what is included in a world or model, and in the models in it."""
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
            try:
                found = one / named
                if found.is_dir():
                    found = found / "model.sdf"
                if found.exists():
                    return found
            except (OSError, ValueError):  # too long a name, or one with a zero byte
                continue
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
    """Yield the axes of a joint that do not say whose axes they are in."""
    for tag in ("axis", "axis2"):
        for axis in joint.all(tag):
            if axis.first(FRAME) is None:
                yield axis
