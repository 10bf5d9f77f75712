# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scene's keys set from outside its file: ``controller.joint_constraint.stiffness=500``."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from hapticmech_ros.errors import FileError, SceneError, SceneProblem, nearest
from hapticmech_ros.yaml_text import read_yaml

_STEP = re.compile(r"([^.\[\]]+)|\[(\d+)\]")


def with_changes(document: object, changes: Sequence[str], source: str) -> object:
    """Return a scene's document with some keys set; the document stays as it is.

    Args:
        document: as written; what is no mapping is returned, for validation to refuse.
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
                raise _refused(source, "set", change, "must be key=value")
            try:
                value = read_yaml(written, f"the value of {key}")
            except FileError as error:
                raise _refused(source, key, written, str(error)) from None
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
        raise _refused(source, "set", key, rule)


def _set(value: Any, steps: list[str | int], new: object, key: str, source: str) -> Any:
    """Return a copy with the value at the end of a path replaced."""
    if not steps:
        return new
    step, *rest = steps
    if isinstance(value, list | tuple):
        place = _place(value, step, key, source)
        return [*value[:place], _set(value[place], rest, new, key, source), *value[place + 1 :]]
    if isinstance(step, int) or not (value is None or isinstance(value, Mapping)):
        raise _refused(source, key, step, "leads nowhere: there is neither a mapping nor a list")
    inside = {} if value is None else value
    return {**inside, step: _set(inside.get(step), rest, new, key, source)}


def _place(items: Sequence[Any], step: str | int, key: str, source: str) -> int:
    names = [item.get("name") if isinstance(item, Mapping) else None for item in items]
    if isinstance(step, int):
        if step < len(items):
            return step
        raise _refused(source, key, step, f"must be a place from 0 to {len(items) - 1}")
    if step in names:
        return names.index(step)
    known = [name for name in names if name is not None]
    rule = f"must be one of {known}, or a place in brackets{nearest(step, known)}"
    raise _refused(source, key, step, rule)


def _refused(source: str, key: str, value: object, rule: str) -> SceneError:
    return SceneError(source, [SceneProblem(key, value, rule)])
