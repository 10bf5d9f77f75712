# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rules of shapes and contacts that concern more than one value of a scene."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from hapticmech_ros.errors import FileError, SceneProblem, nearest
from hapticmech_ros.files import check_file, is_file
from hapticmech_ros.scene.contacts import ContactPair, Shape
from hapticmech_ros.scene.document import SceneDocument

# What coal's reader accepts, broken files included: one of PLY with an empty face ends the process.
MESH_SUFFIXES = (".stl", ".obj", ".dae", ".off")
MESH_SIZE_LIMIT = 32_000_000


def broken_contact_rules(scene: SceneDocument) -> Iterator[SceneProblem]:
    """Yield every rule of shapes and contacts that ``scene`` breaks."""
    yield from _names_of_contacts(scene)
    yield from _shapes(scene)
    shapes = {shape.name: shape for shape in scene.shapes}
    for index, contact in enumerate(scene.contacts):
        yield from _pair(scene, f"contacts[{index}]", contact, shapes)
        yield from _law(f"contacts[{index}]", contact)


def with_mesh_paths(document: object, folder: Path) -> object:
    """Return a scene's document with relative paths of meshes taken from ``folder``."""
    if not isinstance(document, Mapping) or not isinstance(document.get("shapes"), list | tuple):
        return document
    return {**document, "shapes": [_with_path(shape, folder) for shape in document["shapes"]]}


def _with_path(shape: object, folder: Path) -> object:
    geometry = shape.get("geometry") if isinstance(shape, Mapping) else None
    if not isinstance(shape, Mapping) or not isinstance(geometry, Mapping):
        return shape
    file = geometry.get("file")
    if geometry.get("kind") != "mesh" or not isinstance(file, str) or not file:
        return shape
    return {**shape, "geometry": {**geometry, "file": str(folder / file)}}


def _names_of_contacts(scene: SceneDocument) -> Iterator[SceneProblem]:
    groups = (
        ("shapes[{}].name", [shape.name for shape in scene.shapes]),
        ("contacts[{}].name", [contact.name for contact in scene.contacts]),
    )
    for key, names in groups:
        for index, name in enumerate(names):
            if name in names[:index]:
                yield SceneProblem(key.format(index), name, "names must be unique")


def _shapes(scene: SceneDocument) -> Iterator[SceneProblem]:
    links = {link.name for link in scene.links}
    for index, shape in enumerate(scene.shapes):
        if shape.link != "world" and shape.link not in links:
            rule = f"unknown frame: must be 'world' or one of {sorted(links)}"
            rule += nearest(shape.link, links)
            yield SceneProblem(f"shapes[{index}].link", shape.link, rule)
        if shape.geometry.kind == "mesh":
            yield from _mesh_file(f"shapes[{index}].geometry.file", shape.geometry.file)


def _mesh_file(key: str, file: str) -> Iterator[SceneProblem]:
    """Yield what is wrong with a mesh's file before it is read."""
    path = Path(file)
    if not is_file(path):
        yield SceneProblem(key, file, "no such file")
    elif path.suffix.lower() not in MESH_SUFFIXES:
        yield SceneProblem(key, file, f"a mesh's file must end in one of {MESH_SUFFIXES}")
    else:
        try:
            check_file(path, MESH_SIZE_LIMIT)
        except FileError as error:
            yield SceneProblem(key, file, f"a mesh's file {error.rule} ({error.value})")


def _pair(
    scene: SceneDocument, key: str, contact: ContactPair, shapes: Mapping[str, Shape]
) -> Iterator[SceneProblem]:
    """Yield what is wrong with the two shapes that a contact joins."""
    unknown = [side for side in ("a", "b") if getattr(contact, side) not in shapes]
    for side in unknown:
        name = getattr(contact, side)
        rule = f"unknown shape: must be one of {sorted(shapes)}{nearest(name, shapes)}"
        yield SceneProblem(f"{key}.{side}", name, rule)
    if unknown:
        return
    a, b = shapes[contact.a], shapes[contact.b]
    if _carrier(scene, a.link) == _carrier(scene, b.link):
        rule = "a contact joins shapes that move against each other, not on one body"
        yield SceneProblem(f"{key}.b", contact.b, rule)
    elif a.geometry.kind == b.geometry.kind == "half_space":
        rule = "two half-spaces do not touch in points: one of the two must be bounded"
        yield SceneProblem(f"{key}.b", contact.b, rule)


def _law(key: str, contact: ContactPair) -> Iterator[SceneProblem]:
    """Yield a coefficient that the contact's law has not."""
    law, other = contact.law, "dissipation" if contact.law == "kelvin_voigt" else "damping"
    value = getattr(contact, other)
    if value:
        yield SceneProblem(f"{key}.{other}", value, f"must be 0 with the law {law}")


def _carrier(scene: SceneDocument, link: str) -> str:
    """Return the first link towards the world that a joint moves; ``world`` if none does."""
    links = {one.name: one for one in scene.links}
    for _ in scene.links:
        held = links.get(link)
        if held is None or not (held.joint.type == "fixed" or held.joint.locked):
            return link
        link = held.parent
    return link
