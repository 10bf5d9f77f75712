# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Documents of scenes: read from files, and validated."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from hapticmech_ros.errors import FileError, SceneError, SceneProblem
from hapticmech_ros.scene.angles import with_angles
from hapticmech_ros.scene.document import SceneDocument
from hapticmech_ros.scene.part import LARGEST
from hapticmech_ros.scene.rules import broken_rules
from hapticmech_ros.yaml_text import document_in

Kind = TypeVar("Kind", bound=SceneDocument)
UNKNOWN_KEY = "unknown key"
MODEL_SUFFIXES = (".urdf", ".xml", ".mjcf", ".sdf")


def written_document(path: Path) -> object:
    """Return what a scene's file says; of a model, that it is the scene's.

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
    """Return what plain dictionaries, lists and numbers describe; it keeps every rule.

    Args:
        kind: of document.
        document: as written.
        source: of it, for errors.

    Raises:
        SceneError: lists every broken rule with its key path and value.
    """
    if not isinstance(document, Mapping):
        raise SceneError(source, [SceneProblem("<root>", document, "a scene is a mapping of keys")])
    try:
        scene = kind.model_validate(with_angles(document))
    except ValidationError as error:
        raise SceneError(source, problems_of(error)) from None
    problems = broken_rules(scene)
    if problems:
        raise SceneError(source, problems)
    return scene


def problems_of(error: ValidationError, key: str = "") -> list[SceneProblem]:
    """Return what is wrong with a part of a scene.

    Args:
        error: of its validation.
        key: of the part; empty if it is the scene.
    """
    prefix = (key,) if key else ()
    return [
        SceneProblem(_key_path((*prefix, *item["loc"])), _value(item), rule_of(item))
        for item in error.errors()
        # Of a list whose items are refused pydantic says that it is too short as well.
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
    """Return what was read; for a missing key pydantic gives the whole mapping around it."""
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
