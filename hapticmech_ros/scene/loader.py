"""From a YAML file, or a name of a shipped scene, to a validated frozen :class:`Scene`."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from hapticmech_ros.errors import SceneError, SceneProblem
from hapticmech_ros.scene.document import Scene
from hapticmech_ros.scene.rules import broken_rules

PACKAGE = "hapticmech_ros"
FILE_SIZE_LIMIT = 4_000_000


def load_scene(scene: str | os.PathLike[str]) -> Scene:
    """Load a scene from a YAML file, or a shipped scene by its bare name (``five_bar``).

    Raises:
        SceneError: not found, not readable, not YAML, or breaking rules; the message names file,
            key path, value and rule for every problem found.
    """
    path = find_scene(scene)
    if path.stat().st_size > FILE_SIZE_LIMIT:
        problem = SceneProblem("file", path.stat().st_size, f"at most {FILE_SIZE_LIMIT} bytes")
        raise SceneError(str(path), [problem])
    try:
        document = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    except MarkedYAMLError as error:
        mark = error.problem_mark
        where = f"line {mark.line + 1}" if mark is not None else "file"
        raise SceneError(
            str(path), [SceneProblem(where, error.problem, "not valid YAML")]
        ) from None
    except (OSError, UnicodeDecodeError, YAMLError) as error:
        raise SceneError(str(path), [SceneProblem("file", str(error), "cannot be read")]) from None
    return scene_from_document(document, source=str(path))


def scene_from_document(document: object, source: str = "<document>") -> Scene:
    """Validate a scene given as plain dictionaries, lists and numbers.

    Raises:
        SceneError: lists every broken rule with its key path and value.
    """
    if not isinstance(document, Mapping):
        raise SceneError(source, [SceneProblem("<root>", document, "a scene is a mapping of keys")])
    try:
        scene = Scene.model_validate(document)
    except ValidationError as error:
        problems = [
            SceneProblem(_key_path(item["loc"]), item["input"], _rule(item["type"], item["msg"]))
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
    if given.is_file():
        return given
    shipped = shipped_scenes()
    if str(scene) in shipped:
        return shipped[str(scene)]
    rule = f"no such file, nor a shipped scene; shipped: {sorted(shipped)}"
    raise SceneError(str(scene), [SceneProblem("scene", str(scene), rule)])


def shipped_scenes() -> dict[str, Path]:
    """Return the scenes that come with the package, by name."""
    for folder in _scene_folders():
        if folder.is_dir():
            return {path.stem: path for path in sorted(folder.glob("*.yaml"))}
    return {}


def _scene_folders() -> list[Path]:
    """Return where scenes may be: the source tree, this prefix's share, ament prefixes' shares."""
    here = Path(__file__).resolve()
    share = Path("share") / PACKAGE / "config" / "scenes"
    folders = [here.parents[2] / "config" / "scenes"]
    # lib/pythonX.Y/site-packages/hapticmech_ros/scene/loader.py: five levels below the prefix.
    folders += [parent / share for parent in here.parents[3:7]]
    folders.append(Path(sys.prefix) / share)
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    folders += [Path(prefix) / share for prefix in prefixes if prefix]
    return folders


def _key_path(location: tuple[int | str, ...]) -> str:
    path = ""
    for part in location:
        if isinstance(part, int):
            path += f"[{part}]"
        elif part not in ("constant_wrench", "spring_damper") or not path.endswith("hand"):
            path += f".{part}" if path else part
    return path or "<root>"


def _rule(kind: str, message: str) -> str:
    if kind == "extra_forbidden":
        return "unknown key"
    if kind == "missing":
        return "required key is missing"
    if kind == "finite_number":
        return "must be a finite number"
    return message[0].lower() + message[1:]


def document_of(scene: Scene) -> dict[str, Any]:
    """Return ``scene`` as plain dictionaries, lists and numbers (what a YAML file would say)."""
    return scene.model_dump(mode="json")
