# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Documents of scenes: read from files, and validated.

A scene's keys set from outside its file: ``controller.joint_constraint.stiffness=500``.

Angles as text: ``90 deg``, ``-pi/2``, ``2*pi/3``, where a scene's key is an angle in rad.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from hapticmech_ros.errors import FileError, SceneError, SceneProblem, listed, nearest, scene_error
from hapticmech_ros.files.yaml_text import document_in, read_yaml
from hapticmech_ros.scene.document import SceneDocument
from hapticmech_ros.scene.part import LARGEST, PATTERN, read_angle
from hapticmech_ros.scene.rules import broken_rules

# Keys that are angles, by part; of joints only those that turn.
ANGLES = {
    ("Origin", "rpy"),
    ("Waypoint", "rotation"),
    ("Workspace", "angle"),
    ("JointLimits", "lower"),
    ("JointLimits", "upper"),
    ("Joint", "rest"),
    ("Coupling", "offset"),
    ("InitialState", "q"),
}


def with_angles(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a scene's document with numbers, rad, in place of angles as text.

    Text elsewhere, or no angle, stays for validation to refuse.

    Args:
        document: with its links.
    """
    joints = [link["joint"] for link in _mappings(document.get("links")) if _has(link, "joint")]
    turning = {joint.get("name") for joint in joints if joint.get("type") == "revolute"}
    found = deepcopy(dict(document))
    for link in _mappings(found.get("links")):
        if _has(link, "joint") and link["joint"].get("name") in turning:
            _replace(link["joint"], "rest")
            if _has(link["joint"], "limits"):
                _replace(link["joint"]["limits"], "lower", "upper")
    for coupling in _mappings(found.get("couplings")):
        if coupling.get("joint") in turning:
            _replace(coupling, "offset")
    if _has(found, "initial_state") and _has(found["initial_state"], "q"):
        start = found["initial_state"]["q"]
        _replace(start, *(name for name in start if name in turning))
    return found


def allow_text(schema: dict[str, Any]) -> None:
    """Let a JSON Schema of scenes take angles as text where they may be written."""
    for part, key in ANGLES:
        properties = schema["$defs"][part]["properties"]
        properties[key] = _or_text(properties[key])


def _or_text(value: dict[str, Any]) -> dict[str, Any]:
    if "prefixItems" in value:
        return {**value, "prefixItems": [_or_text(one) for one in value["prefixItems"]]}
    if "patternProperties" in value:
        inner = {name: _or_text(one) for name, one in value["patternProperties"].items()}
        return {**value, "patternProperties": inner}
    about = ("default", "description", "title")
    rest = {name: one for name, one in value.items() if name in about}
    kind = {name: one for name, one in value.items() if name not in about}
    choices = kind.get("anyOf") or kind.get("oneOf") or [kind]
    return {**rest, "anyOf": [*choices, {"type": "string", "pattern": PATTERN}]}


def _replace(mapping: dict[str, Any], *keys: str) -> None:
    for key in keys:
        if key in mapping:
            mapping[key] = read_angle(mapping[key])


def _has(mapping: Mapping[str, Any], key: str) -> bool:
    """Return whether there is a mapping below a key."""
    return isinstance(mapping.get(key), Mapping)


def _mappings(value: object) -> list[Any]:
    """Return the mappings in a list; none of another value."""
    items = value if isinstance(value, list | tuple) else ()
    return [one for one in items if isinstance(one, Mapping)]


_STEP = re.compile(r"([^.\[\]]+)|\[(\d+)\]")


def with_changes(document: object, changes: Sequence[str], source: str) -> object:
    """Return a scene's document with some keys set; the document stays as it is.

    Args:
        document: as written; if not a mapping it is returned, for validation to refuse.
        changes: ``key=value`` each. A key is a path of names; an item of a list is found by its
            ``name``, or its place in brackets. A value is YAML.
        source: of the scene, for errors.

    Raises:
        SceneError: no ``=``, a path that leads nowhere, or a value that is not YAML.
    """
    for change in changes:
        if isinstance(document, Mapping) and change.strip():
            key, sign, written = change.partition("=")
            key = key.strip()
            if not sign or not key:
                raise scene_error(source, "set", change, "must be key=value")
            try:
                value = read_yaml(written, f"the value of {key}")
            except FileError as error:
                raise scene_error(source, key, written, str(error)) from None
            document = _set(document, list(_steps(key, source)), value, key, source)
    return document


def _steps(key: str, source: str) -> Iterator[str | int]:
    at = 0
    for found in _STEP.finditer(key):
        between = key[at : found.start()]
        if between != ("" if found[2] is not None or at == 0 else "."):
            break
        yield found[1] if found[2] is None else int(found[2])
        at = found.end()
    if at != len(key):
        rule = "must be names with dots between them, and places of lists in brackets"
        raise scene_error(source, "set", key, rule)


def _set(value: Any, steps: list[str | int], new: object, key: str, source: str) -> Any:
    """Return a copy with the value at the end of a path replaced."""
    if not steps:
        return new
    step, *rest = steps
    if isinstance(value, list | tuple):
        place = _place(value, step, key, source)
        return [*value[:place], _set(value[place], rest, new, key, source), *value[place + 1 :]]
    if isinstance(step, int) or not (value is None or isinstance(value, Mapping)):
        raise scene_error(source, key, step, "leads nowhere: there is no mapping or list")
    inside = {} if value is None else value
    return {**inside, step: _set(inside.get(step), rest, new, key, source)}


def _place(items: Sequence[Any], step: str | int, key: str, source: str) -> int:
    names = [item.get("name") if isinstance(item, Mapping) else None for item in items]
    if isinstance(step, int):
        if step < len(items):
            return step
        raise scene_error(source, key, step, f"must be a place from 0 to {len(items) - 1}")
    if step in names:
        return names.index(step)
    known = [name for name in names if name is not None]
    rule = f"must be one of {listed(known)}, or a place in brackets{nearest(step, known)}"
    raise scene_error(source, key, step, rule)


Kind = TypeVar("Kind", bound=SceneDocument)
UNKNOWN_KEY = "unknown key"
MODEL_SUFFIXES = (".urdf", ".xml", ".mjcf", ".sdf")


def written_document(path: Path) -> object:
    """Return the document in a scene's file; for a model's file, a scene with that model.

    Raises:
        SceneError: too large, not readable, or not YAML within the limits of ``yaml_text``.
    """
    if path.suffix.lower() in MODEL_SUFFIXES:
        return {"format": "hapticmech-scene/1", "model": path.name}
    try:
        return document_in(str(path))
    except FileError as error:
        raise SceneError.of_file(error) from None


def validated(kind: type[Kind], document: object, source: str) -> Kind:
    """Return the document that plain dictionaries, lists and numbers describe; it keeps every rule.

    Args:
        kind: of document.
        document: as written.
        source: of it, for errors.

    Raises:
        SceneError: lists every broken rule with its key path and value.
    """
    if not isinstance(document, Mapping):
        raise scene_error(source, "<root>", document, "a scene is a mapping of keys")
    try:
        scene = kind.model_validate(with_angles(document))
    except ValidationError as error:
        raise SceneError(source, problems_of(error)) from None
    problems = broken_rules(scene)
    if problems:
        raise SceneError(source, problems)
    return scene


def problems_of(error: ValidationError, key: str = "") -> list[SceneProblem]:
    """Return the problems of a part of a scene.

    Args:
        error: of its validation.
        key: of the part; empty if it is the scene.
    """
    prefix = (key,) if key else ()
    return [
        SceneProblem(_key_path((*prefix, *item["loc"])), _value(item), rule_of(item))
        for item in error.errors()
        # Pydantic reports a list with refused items as too short as well.
        if item["type"] != "too_short" or len(item["input"]) < item["ctx"]["min_length"]
    ]


def _key_path(location: tuple[int | str, ...]) -> str:
    """Return the path as a scene's author would write it, without pydantic's names of variants."""
    parts = list(location)
    if parts[:1] == ["hand"]:
        del parts[1:2]
    elif (
        (parts[:1] == ["hands"] and parts[2:3] == ["hand"])
        or parts[:1] == ["initial_state"]
        or parts[2:3] == ["geometry"]
    ):
        del parts[3:4]
    path = ""
    for part in parts:
        if isinstance(part, int):
            path += f"[{part}]"
        else:
            path += f".{part}" if path else part
    return path or "<root>"


def _value(item: ErrorDetails) -> object:
    """Return the value read; for a missing key pydantic gives the whole mapping around it."""
    if item["type"] == "missing" and isinstance(item["input"], Mapping):
        return None
    return item["input"]


def rule_of(item: ErrorDetails) -> str:
    """Return the rule that a value breaks, in our words where pydantic's are not a user's."""
    kind, message = item["type"], item["msg"]
    bounds = item.get("ctx", {})
    if bounds.get("le") == LARGEST or bounds.get("ge") == -LARGEST:
        return f"must not be above {LARGEST:g} in size"
    if kind == "extra_forbidden":
        return UNKNOWN_KEY
    if kind == "missing":
        return "required key is missing"
    if kind == "finite_number":
        return "must be a finite number"
    message = message.removeprefix("Value error, ")
    return message[0].lower() + message[1:]
