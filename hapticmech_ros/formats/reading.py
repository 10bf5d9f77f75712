# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scene whose links come from a file: ``model: robot.urdf`` beside keys that no such file has."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import pinocchio as pin
from pydantic import ValidationError

from hapticmech_ros.errors import SceneError, SceneProblem, listed, nearest, scene_error
from hapticmech_ros.formats.mjcf import read_mjcf
from hapticmech_ros.formats.mjcf_compiled import open_includes
from hapticmech_ros.formats.model import WORLD, Document, Imported, Model, Note, Rgba, origin_of
from hapticmech_ros.formats.sdf import read_sdf
from hapticmech_ros.formats.sdf_frames import open_includes as open_sdf_includes
from hapticmech_ros.formats.shapes import (
    KINDS,
    document_of_shape,
    notes_of_shapes,
    used,
    with_shapes,
)
from hapticmech_ros.formats.stops import with_metrics, with_start, with_stops
from hapticmech_ros.formats.tree import LINK_LIMIT, NO_POSITION, to_scene
from hapticmech_ros.formats.urdf import read_urdf
from hapticmech_ros.formats.xml_nodes import Source
from hapticmech_ros.mechanism.model import se3
from hapticmech_ros.scene.contacts import Shape
from hapticmech_ros.scene.mechanism import ModelPart, Origin
from hapticmech_ros.scene.validation import problems_of, written_document

# Readers of files, by outermost element.
READERS = {"robot": read_urdf, "mujoco": read_mjcf, "sdf": read_sdf}
# A joint of MJCF has elements of that name wherever it is driven or sensed.
LIMITS = dict.fromkeys(("link", "body", "model", "default"), LINK_LIMIT)
LIMITS["joint"] = 10 * LINK_LIMIT
WIDER = "model: {{joints: {{{}: {{locked: false, limits: null}}}}}} lets it move"
# Words in the names of frames and links that people hold, the best first.
HELD_WORDS = (
    *("tcp", "end_?effector", "eef", "ee", "tool", "grasp", "pinch", "attachment", "flange"),
    *("gripper", "hand"),
)
# Without a hand in the scene, the hand pushes with zero wrench.
NO_HAND: Document = {"kind": "constant_wrench"}


def read_model(path: Path, free_base: bool = False, name: str = "") -> Imported:
    """Return the model in a URDF, MJCF or SDF file.

    Args:
        path: of the file; its outermost element determines the format.
        free_base: whether bodies that no joint carries float; they are the world otherwise.
        name: of the model, in an SDF file with several.

    Raises:
        SceneError: cannot be read, or breaks a rule of its format or of ours.
    """
    source = Source(path)
    reader = READERS.get(source.root.tag)
    if reader is None:
        rule = f"must be one of {listed(sorted(READERS))}: URDF, MJCF or SDF"
        raise source.error(source.root, source.root.tag, rule)
    if reader is read_mjcf:
        open_includes(source)
    elif reader is read_sdf:
        open_sdf_includes(source)
    _refuse_many(source)
    if reader is not read_sdf and name:
        raise source.error(source.root, name, "only an SDF file has several models to name")
    model: Model = read_sdf(source, name) if reader is read_sdf else reader(source)
    return to_scene(model, str(path), free_base)


def _refuse_many(source: Source) -> None:
    """Refuse a file that is too large for a scene before converting it."""
    counts = Counter(node.tag for node in source.root.walk())
    for tag, limit in LIMITS.items():
        if counts[tag] > limit:
            raise source.error(source.root, counts[tag], f"at most {limit} elements <{tag}>")


class LeftOut(NamedTuple):
    """Parts of a scene's model file that the scene lacks.

    Attributes:
        notes: kinds of elements.
        shapes: names of those that contacts of the scene could name.
    """

    notes: tuple[Note, ...] = ()
    shapes: tuple[str, ...] = ()


def left_out(path: Path) -> LeftOut:
    """Return the parts of a scene's model file that the scene lacks; nothing without one.

    Raises:
        SceneError: see :func:`read_model`.
    """
    document = written_document(path)
    if not isinstance(document, Mapping) or "model" not in document:
        return LeftOut()
    _, imported = _read(document["model"], path)
    there = used(document, imported)
    notes = sorted((*imported.notes, *notes_of_shapes(imported, there)), key=lambda one: one.rank)
    return LeftOut(tuple(notes), tuple(_unused(imported, there)))


def _unused(imported: Imported, there: Collection[str]) -> Iterator[str]:
    """Yield the names of shapes that contacts of the scene could name, and do not."""
    for name, solid in imported.shapes.items():
        if solid.kind in KINDS and name not in there:
            yield name


class DrawnShape(NamedTuple):
    """A shape that is drawn.

    Attributes:
        shape: as in a scene.
        colour: red, green, blue and opacity, 0 to 1, if the file has one.
    """

    shape: Shape
    colour: Rgba | None


def drawn_shapes(path: Path) -> tuple[DrawnShape, ...]:
    """Return the drawn shapes of a scene's model file; nothing without one.

    They are its visual shapes (in MJCF the geoms that MuJoCo's viewer draws), or, without any, the
    collision shapes, in both cases without those that the scene has. Unreadable ones are left out:
    they do not affect the mechanism.

    Raises:
        SceneError: see :func:`read_model`.
    """
    document, found = written_document(path), []
    if not isinstance(document, Mapping) or "model" not in document:
        return ()
    _, imported = _read(document["model"], path)
    there = used(document, imported)
    touching = [imported.shapes[name] for name in there]
    solids = {
        f"visual_{number}_of_file": solid
        for number, solid in enumerate(imported.visuals, 1)
        if not any(solid is one for one in touching)
    }
    if not imported.visuals:
        solids = {name: imported.shapes[name] for name in _unused(imported, there)}
    for name, solid in solids.items():
        with suppress(SceneError, ValidationError):
            shape = Shape.model_validate(document_of_shape(name, solid, imported))
            found.append(DrawnShape(shape, solid.colour))
    return tuple(found)


def _named(error: SceneError, links: list[Document], imported: Imported, file: str) -> SceneError:
    """Return an error that names links by their names, and where the file has them."""
    problems = []
    joints = [
        link["joint"]["name"] for link in imported.document["links"] if link["joint"].get("locked")
    ]
    locked = {
        name: f"at {imported.where[name]}: {WIDER.format(name)}"
        for name in joints
        if name in imported.where
    }
    for problem in error.problems:
        found = re.match(r"links\[(\d+)\]", problem.key_path)
        if found is not None:
            rest = problem.key_path[found.end() :]
            link = links[int(found[1])]
            kind, name = "link", link["name"]
            if rest.startswith(".joint."):
                kind, name, rest = "joint", link["joint"]["name"], rest.removeprefix(".joint")
            line = imported.where.get(name)
            place = "" if line is None else f"{line}: "
            if line is not None and file != error.source:
                place = f"{file}, {place}"
            path = f"{place}{kind} {name}{rest}"
            problems.append(replace(problem, key_path=path))
        else:
            rule = problem.rule
            if problem.key_path.startswith("couplings[") and problem.value in locked:
                rule += f", {locked[str(problem.value)]}"
            problems.append(replace(problem, rule=rule))
    return SceneError(error.source, problems)


def expand(document: Mapping[str, Any], source: Path) -> Document:
    """Return a scene's document with ``model`` replaced by the contents of that file.

    The document's own keys override the file. Names of the file refer to the links and joints made
    from them. Defaults: the point held is the frame or link that is named as in
    :data:`HELD_WORDS`, else the tip of the longest branch; the hand does not push,
    joints whose zero is beyond a stop start there, and stops get a stiffness (see ``with_stops``).

    Args:
        document: as written.
        source: its file; ``model.file`` is relative to it.

    Raises:
        SceneError: see :func:`read_model`; or something breaks a rule, which is named by its link,
            not by a number that no file has.
    """
    part, imported = _read(document["model"], source)
    found: Document = {"hand": NO_HAND, **imported.document}
    own = _in_links({k: v for k, v in document.items() if k != "model"}, imported)
    if "links" in own:
        rule = "links come from the model: give one or the other"
        raise scene_error(str(source), "links", own["links"], rule)
    own = with_shapes(own, imported, str(source))
    for key in ("closures", "couplings"):
        if key in own and key in found:
            own[key] = [*found[key], *_list(own[key])]
    _begin_at_keyframe(own, imported, str(source))
    if "initial_state" in found:
        own["initial_state"] = _merged(found["initial_state"], own.get("initial_state", {}))
    found |= own
    found["links"] = [_changed(link, part, imported) for link in found["links"]]
    _refuse_unknown(part, imported, source)
    _refuse_absent(own, imported, str(source))
    place = _held_place(imported)
    if "operational_points" not in found and place:
        found["operational_points"] = [_placed({"name": "tip_point", "link": place}, imported)]
    try:
        return with_stops(with_start(with_metrics(found)), str(source))
    except SceneError as error:
        file = str(source.parent / part.file)
        raise _named(error, found["links"], imported, file) from None


def _held_place(imported: Imported) -> str:
    """Return the file's frame or link at which a person would hold it; empty without any."""
    moving = [name for name, (link, _) in imported.places.items() if link != WORLD]
    for word in HELD_WORDS:
        word_in = re.compile(rf"(?<![a-z]){word}(?![a-z])")
        for name in moving:
            if word_in.search(name.lower()):
                return name
    return imported.tips[0] if imported.tips else ""


def _read(written: object, source: Path) -> tuple[ModelPart, Imported]:
    """Return the ``model`` of a scene's document, and the model in its file."""
    given = {"file": written} if isinstance(written, str) else written
    try:
        part = ModelPart.model_validate(given)
    except ValidationError as error:
        raise SceneError(str(source), problems_of(error, "model")) from None
    return part, read_model(source.parent / part.file, part.base == "free", part.name)


def _begin_at_keyframe(own: Document, imported: Imported, source: str) -> None:
    """Replace a keyframe's name by its state; the scene's own values override it.

    Raises:
        SceneError: no such keyframe.
    """
    state = own.get("initial_state")
    if not isinstance(state, Mapping) or "keyframe" not in state:
        return
    name = state["keyframe"]
    if not isinstance(name, str) or name not in imported.keyframes:
        rule = (
            f"must be one of the model's keyframes, {listed(map(repr, sorted(imported.keyframes)))}"
        )
        rule += nearest(name, imported.keyframes)
        raise scene_error(source, "initial_state.keyframe", name, rule)
    rest = {key: value for key, value in state.items() if key != "keyframe"}
    for part, held in zip("qv", imported.keyframes[name], strict=True):
        given = rest.get(part, {})
        if isinstance(given, Mapping):
            rest[part] = {**held, **given}
    own["initial_state"] = rest


def _merged(state: Document, own: object) -> object:
    """Return a file's initial state, overridden by the scene's."""
    if not isinstance(own, Mapping) or not isinstance(own.get("q", {}), Mapping):
        return own
    return {**own, "q": {**state["q"], **own.get("q", {})}}


def _list(value: object) -> list[Any]:
    return list(value) if isinstance(value, list | tuple) else [value]


def _in_links(document: Document, imported: Imported) -> Document:
    """Return the document with the file's names of bodies, frames and joints as the scene's."""
    found = dict(document)
    for key in ("closures", "springs"):
        if key in found:
            found[key] = [_with_ends(item, imported) for item in _list(found[key])]
    for key in ("operational_points", "shapes"):
        if key in found:
            found[key] = [_placed(item, imported) for item in _list(found[key])]
    state = found.get("initial_state")
    if isinstance(state, Mapping):
        found["initial_state"] = {
            part: {imported.joints.get(name, name): value for name, value in values.items()}
            if isinstance(values, Mapping)
            else values
            for part, values in state.items()
        }
    return found


def _with_ends(item: object, imported: Imported) -> object:
    if not isinstance(item, Mapping):
        return item
    return {
        key: _placed(value, imported) if key in ("a", "b") else value for key, value in item.items()
    }


def _placed(item: object, imported: Imported) -> object:
    """Return something with ``link`` and ``origin`` moved from the file's frame to a link's."""
    if not isinstance(item, Mapping) or not isinstance(item.get("link"), str):
        return item
    if item["link"] not in imported.places:
        return item
    link, place = imported.places[item["link"]]
    origin = _transform(item.get("origin", {}))
    if origin is None:
        return item
    moved = dict(item) | {"link": link}
    if item["link"] != link or not place.isIdentity(0.0):
        moved["origin"] = origin_of(place * origin)
    return moved


def _changed(link: Document, part: ModelPart, imported: Imported) -> Document:
    """Return a link with the scene's changes to its joint."""
    for name, change in part.joints.items():
        if imported.joints.get(name, name) == link["joint"]["name"]:
            given = change.model_dump(exclude_unset=True)
            joint = {k: v for k, v in {**link["joint"], **given}.items() if v is not None}
            return {**link, "joint": joint}
    return link


def _refuse_unknown(part: ModelPart, imported: Imported, source: Path) -> None:
    known = {*imported.joints, *imported.joints.values()}
    problems = [
        SceneProblem(
            f"model.joints.{name}",
            name,
            f"joint {name!r} {imported.absent[name]}"
            if name in imported.absent
            else f"must be one of {listed(sorted(imported.joints))}"
            f"{nearest(name, imported.joints)}",
        )
        for name in part.joints
        if name not in known
    ]
    if problems:
        raise SceneError(str(source), problems)


def _refuse_absent(own: Document, imported: Imported, source: str) -> None:
    """Refuse values for joints that the file has and the scene has not."""
    said = []
    state = own.get("initial_state")
    if isinstance(state, Mapping):
        for part in "qv":
            values = state.get(part)
            names = values if isinstance(values, Mapping) else ()
            said += [(f"initial_state.{part}.{name}", name) for name in names]
    for number, one in enumerate(_list(own.get("couplings", []))):
        ends = one if isinstance(one, Mapping) else {}
        said += [(f"couplings[{number}].{key}", ends.get(key)) for key in ("joint", "leader")]
    known = {*imported.joints, *imported.joints.values()}
    problems = [
        SceneProblem(key, name, f"joint {name!r} {imported.absent[name]}: {NO_POSITION}")
        for key, name in said
        if isinstance(name, str) and name in imported.absent and name not in known
    ]
    if problems:
        raise SceneError(source, problems)


def _transform(origin: object) -> pin.SE3 | None:
    """Return a written origin; None if invalid, which validation then reports."""
    try:
        return se3(Origin.model_validate(origin))
    except ValidationError:
        return None
