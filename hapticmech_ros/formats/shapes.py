# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes that a file has for collisions: a scene has those of them that its contacts name.

Meshes are named by path, or in a package or model that has a name.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any
from urllib.parse import unquote

import pinocchio as pin

from hapticmech_ros.errors import FileError, SceneError, SceneProblem
from hapticmech_ros.files import is_file, open_file
from hapticmech_ros.formats.model import (
    Document,
    Imported,
    Names,
    Note,
    Rgba,
    Solid,
    clean,
    origin_of,
)
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

    ``package://p/...`` and ``model://p/...`` are in a folder called p, or whose ``package.xml`` has
    that name: one of those above the file that names it, one next to these, or one in the folders
    that ``PLACES`` has.

    Args:
        source: file that names the mesh.
        node: its element, for errors.
        name: as written.
        folder: of relative paths.

    Raises:
        SceneError: no such file; names the folders searched.
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
    rule = (
        f"no such file in a folder or package {package!r} in {_folders_shown(places)} ({variables})"
    )
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


# A scene's shapes.
KINDS = ("sphere", "box", "cylinder", "capsule", "half_space", "mesh")
NAMES_SHOWN = 20
NAMEABLE = "no effect unless a contact of a scene file names it"
OTHER = f"a scene's shapes are {', '.join(KINDS)}"


def named(solids: Sequence[Solid]) -> dict[str, Solid]:
    """Return shapes by the names that they have in a scene.

    That is the file's name where only one shape has it; else ``<body>_<name>``, and
    ``<body>_collision`` without one; further ones end in ``_2``, ``_3``.
    """
    called = [clean(solid.name) if solid.name else "" for solid in solids]
    counts, names = Counter(called), Names()
    alone = [bool(name) and counts[name] == 1 for name in called]
    found = {k: names.new(called[k]) for k in range(len(solids)) if alone[k]}
    for k, solid in enumerate(solids):
        if not alone[k]:
            found[k] = names.new(f"{solid.body}_{solid.name or 'collision'}")
    return {found[k]: solid for k, solid in enumerate(solids)}


def with_shapes(document: Document, imported: Imported, source: str) -> Document:
    """Return a scene's document with the shapes of its model that contacts name.

    Shapes that the scene has itself go before the model's of that name.

    Args:
        document: of the scene.
        imported: its model.
        source: of the scene, for errors.

    Raises:
        SceneError: no such shape, or an invalid one in the file, or its mesh is missing.
    """
    contacts = document.get("contacts")
    if not isinstance(contacts, list | tuple):
        return document
    own, written = _own(document), document.get("shapes", [])
    names = _by_either_name(imported)
    problems = [
        SceneProblem(
            f"contacts[{index}].{side}",
            name,
            f"unknown shape: the scene file has {_shown(own)}, the model {_shown(imported.shapes)}",
        )
        for index, side, name in _ends(contacts)
        if name not in own and name not in names
    ]
    if problems:
        raise SceneError(source, problems)
    found = dict(document)
    found["contacts"] = [_renamed(contact, own, names) for contact in contacts]
    added = [
        document_of_shape(name, imported.shapes[name], imported)
        for name in used(document, imported)
    ]
    if added and isinstance(written, list | tuple):
        found["shapes"] = [*written, *added]
    return found


def used(document: Mapping[str, Any], imported: Imported) -> list[str]:
    """Return the model's shapes that a document's contacts name, by name, in the file's order."""
    contacts, own = document.get("contacts"), _own(document)
    if not isinstance(contacts, list | tuple):
        return []
    names = _by_either_name(imported)
    ends = {names.get(name) for _, _, name in _ends(contacts) if name not in own}
    return [name for name in imported.shapes if name in ends and name not in own]


def notes_of_shapes(imported: Imported, without: Collection[str] = ()) -> list[Note]:
    """Return notes of a model's shapes, except those in a scene."""
    left = [solid for name, solid in imported.shapes.items() if name not in without]
    counts = Counter((s.what if s.kind in KINDS else f"{s.what}: {s.kind}") for s in left)
    plain = {solid.what for solid in left}
    return [
        Note(what, count, NAMEABLE if what in plain else OTHER) for what, count in counts.items()
    ]


# Of shapes in URDF and SDF: names of their sizes, there and in scenes; and how many numbers.
SIZES = {
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "box": {"size": 3},
}


def solid_of(
    source: Source,
    node: Node,
    link: str,
    place: Callable[[], pin.SE3],
    read: Callable[[Source, Node, str, Callable[[], pin.SE3]], tuple[pin.SE3, Document]],
    kinds: Mapping[str, str] = MappingProxyType({}),
) -> Solid:
    """Return a <collision> or <visual> of a link, of URDF or SDF.

    Args:
        source: the file.
        node: the element.
        link: that it is in.
        place: returns the element's frame in the link's.
        read: returns a shape of a kind: its frame in the link's, and the scene's document of it.
        kinds: the scene's kinds of shapes, where the file has other names for them.
    """
    geometry = node.first("geometry")
    shape = geometry.children[0] if geometry is not None and geometry.children else node
    kind = "nothing" if shape is node else kinds.get(shape.tag, shape.tag)
    name = node.attributes.get("name", "").strip()
    return Solid(name, link, kind, "collision", partial(read, source, shape, kind, place))


def rgba(text: str) -> Rgba | None:
    """Return a colour, or None if it is none: that affects no mechanism."""
    try:
        red, green, blue, *opacity = (min(max(float(part), 0.0), 1.0) for part in text.split())
    except ValueError:
        return None
    return red, green, blue, opacity[0] if opacity else 1.0


def sized(
    source: Source, node: Node, kind: str, read: Callable[[str, int], Sequence[float]]
) -> Document:
    """Return a shape of :data:`SIZES`.

    Args:
        source: the file.
        node: its element.
        kind: of shape.
        read: returns so many numbers by the size's name.

    Raises:
        SceneError: a size that is not above zero.
    """
    found = {key: [float(x) for x in read(key, count)] for key, count in SIZES[kind].items()}
    sizes = [size for part in found.values() for size in part]
    if min(sizes) <= 0.0:
        raise source.error(node, sizes, "sizes must be above zero")
    return {"kind": kind, **{key: x if kind == "box" else x[0] for key, x in found.items()}}


def not_zero(source: Source, node: Node, scale: Sequence[float]) -> list[float]:
    """Return the scale of a mesh, which may mirror it, but not flatten it.

    Raises:
        SceneError: it does.
    """
    if not all(scale):
        raise source.error(node, list(scale), "a scale must not be zero")
    return [float(part) for part in scale]


def refused_kind(source: Source, node: Node, kind: str) -> SceneError:
    """Return the error of a shape that no scene has."""
    return source.error(node, kind, OTHER)


def _own(document: Mapping[str, Any]) -> set[str]:
    shapes = document.get("shapes")
    if not isinstance(shapes, list | tuple):
        return set()
    names = [shape.get("name") for shape in shapes if isinstance(shape, Mapping)]
    return {name for name in names if isinstance(name, str)}


def _ends(contacts: Iterable[object]) -> Iterator[tuple[int, str, str]]:
    """Yield index, side and shape of contacts' shapes, where that is a name."""
    for index, contact in enumerate(contacts):
        for side in ("a", "b"):
            name = contact.get(side) if isinstance(contact, Mapping) else None
            if isinstance(name, str):
                yield index, side, name


def _by_either_name(imported: Imported) -> dict[str, str]:
    """Return names of shapes in the scene by these, and by the file's own."""
    shapes = list(imported.shapes.items())
    own = {solid.name: name for name, solid in reversed(shapes) if solid.name}
    return own | {name: name for name in imported.shapes}


def _renamed(contact: object, own: Collection[str], names: Mapping[str, str]) -> object:
    if not isinstance(contact, Mapping):
        return contact
    ends = {side: name for _, side, name in _ends([contact]) if name not in own}
    return {**contact, **{side: names[name] for side, name in ends.items()}}


def document_of_shape(name: str, solid: Solid, imported: Imported) -> Document:
    """Return a shape of a model as a scene has it; of no link, it is in the world.

    Raises:
        SceneError: an invalid shape in the file, or its mesh is missing.
    """
    place, geometry = solid.read()
    link, own = imported.places.get(solid.body, ("world", pin.SE3.Identity()))
    return {"name": name, "link": link, "origin": origin_of(own * place), "geometry": geometry}


def _shown(names: Collection[str]) -> str:
    shown = sorted(names)[:NAMES_SHOWN]
    more = len(names) - len(shown)
    return f"{shown}" + (f" and {more} more, which scene check lists" if more else "")
