# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From a file, or a name of a shipped scene, to a validated frozen :class:`Scene`.

A copy of a scene's file with other values, for nodes and for editing.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hapticmech_ros.errors import listed, scene_error
from hapticmech_ros.files import is_file, shared
from hapticmech_ros.scene.linkage import with_linkage
from hapticmech_ros.scene.scene import Scene, scene_from_document
from hapticmech_ros.scene.validation import with_changes, written_document


def copy_scene(
    scene: str | os.PathLike[str],
    out: Path,
    changes: Sequence[str] = (),
    expanded: bool = False,
) -> None:
    """Write a scene's file anew, with some keys set and its own files by their whole paths.

    Args:
        scene: path, or name of a shipped scene.
        out: file to make.
        changes: see :func:`~hapticmech_ros.scene.validation.with_changes`.
        expanded: whether a ``linkage`` or ``model`` is written as the links and loops that it
            stands for.

    Raises:
        SceneError: as :func:`~hapticmech_ros.loading.loader.load_scene`; or the file exists, or
            cannot be written.
    """
    load_scene(scene, changes=changes)
    path = find_scene(scene)
    document = with_changes(written_document(path), changes, str(path))
    resolve = with_links if expanded else with_own_paths
    document = _plain(resolve(document, path))
    if isinstance(document, Mapping) and "model" in document:
        model = document["model"]
        part = {"file": model} if isinstance(model, str) else dict(model)
        part["file"] = str((path.resolve().parent / part["file"]).resolve())
        document = {**document, "model": part}
    text = yaml.safe_dump(document, sort_keys=False, allow_unicode=True, default_flow_style=None)
    try:
        with out.open("x", encoding="utf-8") as stream:
            stream.write(f"# A copy of {scene}\n{text}")
    except FileExistsError:
        rule = "exists: choose another place"
        raise scene_error(str(out), "file", str(out), rule) from None
    except OSError as error:
        rule = f"cannot be written: {error.strerror}"
        raise scene_error(str(out), "file", str(out), rule) from None


def _plain(value: object) -> object:
    """Return a document with lists and numbers as YAML has them."""
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return value


def load_scene(
    scene: str | os.PathLike[str],
    control_rate: float = 0.0,
    network_delay: float = 0.0,
    changes: Sequence[str] = (),
) -> Scene:
    """Return a scene from a file, or a shipped scene by its bare name (``five_bar``).

    A file is YAML, with its links, with ``linkage``, their points, or with ``model``, the file that
    they come from; or that file itself, URDF, MJCF or SDF (see ``formats``).

    Args:
        scene: path or name.
        control_rate: Hz, instead of the scene's own ``simulation.period``; 0 leaves it.
        network_delay: s, one way, instead of its ``connection.expected``; 0 leaves it.
        changes: ``key=value`` each, instead of the file's values; see
            :func:`~hapticmech_ros.scene.validation.with_changes`.

    Raises:
        SceneError: not found, not readable, not YAML, or breaking rules; the message names file,
            key path, value and rule for every problem found.
    """
    path = find_scene(scene)
    document = with_changes(written_document(path), changes, str(path))
    document = _over_network(_at_rate(document, control_rate), network_delay)
    return scene_as_written(document, path)


def scene_as_written(document: object, path: Path) -> Scene:
    """Return the scene of a document as its file has it: with links, ``linkage`` or ``model``.

    Args:
        document: as written.
        path: of its file, beside which those are that it names.

    Raises:
        SceneError: as :func:`load_scene`.
    """
    return scene_from_document(with_links(document, path), source=str(path))


def with_links(document: object, path: Path) -> object:
    """Return a scene's document with links in place of ``linkage`` or ``model``, and whole paths.

    Args:
        document: as written.
        path: of its file, beside which those are that it names.

    Raises:
        SceneError: a linkage, or a model, that breaks rules.
    """
    document = with_own_paths(with_linkage(document, str(path)), path)
    if isinstance(document, Mapping) and "model" in document:
        from hapticmech_ros.formats import expand  # Pinocchio, which other scenes need not load

        return expand(document, path)
    return document


def with_own_paths(document: object, path: Path) -> object:
    """Return a scene's document with the meshes and scripts beside its file by their whole paths.

    Args:
        document: as written.
        path: of its file.
    """
    if not isinstance(document, Mapping):
        return document
    folder = path.resolve().parent
    found = dict(_with_whole_path(document, "hand", "scripted", folder))
    for key, part, kind in (("shapes", "geometry", "mesh"), ("hands", "hand", "scripted")):
        if isinstance(document.get(key), list | tuple):
            found[key] = [_with_whole_path(one, part, kind, folder) for one in document[key]]
    return found


def _with_whole_path(holder: Any, key: str, kind: str, folder: Path) -> Any:
    """Return a mapping with the file's path, in its part of a kind, taken from a folder."""
    part = holder.get(key) if isinstance(holder, Mapping) else None
    if not isinstance(part, Mapping) or part.get("kind") != kind:
        return holder
    file = part.get("file")
    if not isinstance(file, str) or not file:
        return holder
    return {**holder, key: {**part, "file": str(folder / file)}}


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
    found = {**document, "connection": _expecting(document.get("connection", {}), network_delay)}
    if isinstance(hands := document.get("hands"), list | tuple):
        found["hands"] = [
            {**entry, "connection": _expecting(entry["connection"], network_delay)}
            if isinstance(entry, Mapping) and "connection" in entry
            else entry
            for entry in hands
        ]
    return found


def _expecting(connection: object, delay: float) -> object:
    return {**connection, "expected": delay} if isinstance(connection, Mapping) else connection


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
    rule = f"no such file, nor a shipped scene; shipped: {listed(sorted(shipped))}"
    raise scene_error(str(scene), "scene", str(scene), rule)


def shipped_scenes() -> dict[str, Path]:
    """Return the scenes that come with the package, by name."""
    folder = shared("config/scenes")
    if folder is None:
        return {}
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}
