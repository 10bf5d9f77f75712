# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A copy of a scene's file with other values, for nodes and for editing."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import yaml

from hapticmech_ros.errors import SceneError, SceneProblem
from hapticmech_ros.loading.loader import find_scene, load_scene, with_links, with_own_paths
from hapticmech_ros.scene.changes import with_changes
from hapticmech_ros.scene.validation import written_document


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
        changes: see :func:`~hapticmech_ros.scene.changes.with_changes`.
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
        raise SceneError(str(out), [SceneProblem("file", str(out), rule)]) from None
    except OSError as error:
        rule = f"cannot be written: {error.strerror}"
        raise SceneError(str(out), [SceneProblem("file", str(out), rule)]) from None


def _plain(value: object) -> object:
    """Return a document with lists and numbers as YAML has them."""
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return value
