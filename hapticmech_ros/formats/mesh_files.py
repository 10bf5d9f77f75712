# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the meshes are that a file names: by path, or in a package or model that has a name."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from hapticmech_ros.errors import FileError
from hapticmech_ros.files import is_file, open_file
from hapticmech_ros.formats.xml_nodes import Node, Source

# By scheme: variables with folders that hold packages, and where in these.
PLACES = {
    "package": (("AMENT_PREFIX_PATH", "share"), ("ROS_PACKAGE_PATH", "")),
    "model": (("GZ_SIM_RESOURCE_PATH", ""), ("SDF_PATH", "")),
}
# Of a package.xml; its name stands near its beginning.
MANIFEST_SIZE = 64_000
FOLDERS_SHOWN = 12
_NAME = re.compile(rb"<name>\s*([^<>\s]+)\s*</name>")


def find_mesh(source: Source, node: Node, name: str, folder: Path) -> Path:
    """Return the file of a mesh.

    ``package://p/...`` and ``model://p/...`` are in a folder called p, or whose ``package.xml``
    says that name: one of those above the file that names it, one next to these, or one in the
    folders that ``PLACES`` has.

    Args:
        source: file that names the mesh.
        node: its element, for errors.
        name: as written.
        folder: what relative paths are from.

    Raises:
        SceneError: no such file; says where it was searched for.
    """
    scheme, separator, rest = name.partition("://")
    if not separator:
        return _in_folder(source, node, name, folder)
    if scheme == "file":
        return _in_folder(source, node, unquote(rest), folder)
    if scheme not in PLACES:
        rule = f"a mesh is a path, file://, {'://, '.join(PLACES)}://"
        raise source.error(node, name, rule)
    package, _, inside = rest.partition("/")
    places = list(_places(scheme, source.path))
    for place in places:
        for found in _packages(place, package):
            if is_file(found / inside):
                return found / inside
    variables = " and ".join(variable for variable, _ in PLACES[scheme])
    rule = f"no such file in a folder or package {package!r} in {_folders_shown(places)} ({variables})"
    raise source.error(node, name, rule)


def _in_folder(source: Source, node: Node, name: str, folder: Path) -> Path:
    found = folder / name
    if not name or not is_file(found):
        raise source.error(node, name, f"no such file in {_folders_shown([found.parent])}")
    return found


def _places(scheme: str, path: Path) -> Iterator[Path]:
    """Yield folders in which packages may be: those above a file, then those of the variables."""
    yield from dict.fromkeys((*path.absolute().parents, *path.resolve().parents))
    for variable, inside in PLACES[scheme]:
        for one in os.environ.get(variable, "").split(os.pathsep):
            if one:
                yield Path(one) / inside


def _packages(place: Path, package: str) -> Iterator[Path]:
    if place.name == package or _said_name(place) == package:
        yield place
    yield place / package


def _said_name(place: Path) -> str:
    """Return the name in a folder's ``package.xml``; empty without."""
    try:
        with open_file(place / "package.xml") as file:
            found = _NAME.search(file.read(MANIFEST_SIZE))
    except (FileError, OSError):
        return ""
    return found[1].decode(errors="replace") if found is not None else ""


def _folders_shown(places: list[Path]) -> str:
    shown = [str(place) for place in places[:FOLDERS_SHOWN]]
    more = len(places) - len(shown)
    return f"{shown}" + (f" and {more} more" if more else "")
