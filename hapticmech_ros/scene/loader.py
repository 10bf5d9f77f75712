"""From a file, or a name of a shipped scene, to a validated frozen :class:`Scene`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from hapticmech_ros.errors import FileError, SceneError, SceneProblem
from hapticmech_ros.files import is_file, read_text
from hapticmech_ros.scene.contact_rules import with_mesh_paths
from hapticmech_ros.scene.document import Scene
from hapticmech_ros.scene.part import LARGEST
from hapticmech_ros.scene.rules import broken_rules
from hapticmech_ros.scene.script import with_script_path
from hapticmech_ros.share import shared
from hapticmech_ros.yaml_text import read_yaml

MODEL_SUFFIXES = (".urdf", ".xml", ".mjcf", ".sdf")
FILE_SIZE_LIMIT = 4_000_000


def load_scene(
    scene: str | os.PathLike[str], control_rate: float = 0.0, network_delay: float = 0.0
) -> Scene:
    """Return a scene from a file, or a shipped scene by its bare name (``five_bar``).

    A file is YAML, with its links or with ``model``, the file that they come from; or that file
    itself, URDF, MJCF or SDF (see ``formats``).

    Args:
        scene: path or name.
        control_rate: Hz, instead of the scene's own ``simulation.period``; 0 leaves it.
        network_delay: s, one way, instead of its ``connection.expected``; 0 leaves it.

    Raises:
        SceneError: not found, not readable, not YAML, or breaking rules; the message names file,
            key path, value and rule for every problem found.
    """
    path = find_scene(scene)
    document = _over_network(_at_rate(written_document(path), control_rate), network_delay)
    folder = path.resolve().parent
    document = with_script_path(with_mesh_paths(document, folder), folder)
    if isinstance(document, Mapping) and "model" in document:
        found: Scene = import_module("hapticmech_ros.formats").scene_of(document, path)
        return found
    return scene_from_document(document, source=str(path))


def written_document(path: Path) -> object:
    """Return what a scene's file says; of a model, that it is the scene's.

    Raises:
        SceneError: too large, not readable, or not YAML within the limits of ``yaml_text``.
    """
    if path.suffix.lower() in MODEL_SUFFIXES:
        return {"format": "hapticmech-scene/1", "model": path.name}
    try:
        return read_yaml(read_text(path, FILE_SIZE_LIMIT), str(path))
    except FileError as error:
        problem = SceneProblem(error.where, error.value, error.rule)
        raise SceneError(str(path), [problem]) from None


def _at_rate(document: object, control_rate: float) -> object:
    """Return the document with another control rate (Hz), unless that is 0."""
    if control_rate == 0.0 or not isinstance(document, Mapping):
        return document
    simulation = document.get("simulation", {})
    if not isinstance(simulation, Mapping):
        return document
    period = 1.0 / control_rate
    return {**document, "simulation": {**simulation, "period": period}}


def _over_network(document: object, network_delay: float) -> object:
    """Return the document with another expected delay (s, one way), unless that is 0."""
    if network_delay == 0.0 or not isinstance(document, Mapping):
        return document
    connection = document.get("connection", {})
    if not isinstance(connection, Mapping):
        return document
    return {**document, "connection": {**connection, "expected": network_delay}}


def scene_from_document(document: object, source: str = "<document>") -> Scene:
    """Return the scene that plain dictionaries, lists and numbers describe, validated.

    Raises:
        SceneError: lists every broken rule with its key path and value.
    """
    if not isinstance(document, Mapping):
        raise SceneError(source, [SceneProblem("<root>", document, "a scene is a mapping of keys")])
    try:
        scene = Scene.model_validate(document)
    except ValidationError as error:
        problems = [
            SceneProblem(_key_path(item["loc"]), _value(item), rule_of(item))
            for item in error.errors()
        ]
        raise SceneError(source, problems) from None
    problems = broken_rules(scene)
    if problems:
        raise SceneError(source, problems)
    return scene


def find_scene(scene: str | os.PathLike[str]) -> Path:
    """Return the file of a scene: an existing path, or ``<scenes folder>/<name>.yaml``.

    Raises:
        SceneError: neither exists; the message lists the shipped scenes.
    """
    given = Path(scene)
    if is_file(given):
        return given
    shipped = shipped_scenes()
    if str(scene) in shipped:
        return shipped[str(scene)]
    rule = f"no such file, nor a shipped scene; shipped: {sorted(shipped)}"
    raise SceneError(str(scene), [SceneProblem("scene", str(scene), rule)])


def shipped_scenes() -> dict[str, Path]:
    """Return the scenes that come with the package, by name."""
    folder = shared("config/scenes")
    if folder is None:
        return {}
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def _key_path(location: tuple[int | str, ...]) -> str:
    """Return the path as a scene's author would write it, without pydantic's names of variants."""
    parts = list(location)
    if parts[:1] == ["hand"]:
        del parts[1:2]
    elif parts[:1] == ["initial_state"] or parts[2:3] == ["geometry"]:
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
        return "unknown key"
    if kind == "missing":
        return "required key is missing"
    if kind == "finite_number":
        return "must be a finite number"
    message = message.removeprefix("Value error, ")
    return message[0].lower() + message[1:]


def document_of(scene: Scene) -> dict[str, Any]:
    """Return ``scene`` as plain dictionaries, lists and numbers (what a YAML file would say)."""
    return scene.model_dump(mode="json")
