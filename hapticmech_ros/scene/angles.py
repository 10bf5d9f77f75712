# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Angles as text: ``90 deg``, ``-pi/2``, ``2*pi/3``, where a scene's key is an angle in rad."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

_NUMBER = r"[0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?"
_DEGREES = rf"([-+]?{_NUMBER}) *deg"
_PI = rf"([-+]?)(?:({_NUMBER})\*)?pi(?:/({_NUMBER}))?"
# What may be written for an angle, beside a number.
PATTERN = rf"^ *(?:{_DEGREES}|{_PI}) *$"
_TEXT = re.compile(PATTERN)
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


def angle_of(text: str) -> float | None:
    """Return the angle (rad) that a text is; None if it is none."""
    found = _TEXT.match(text)
    if found is None:
        return None
    degrees, sign, times, parts = found.groups()
    if degrees is not None:
        return math.radians(float(degrees))
    divisor = float(parts or 1.0)
    if divisor == 0.0:
        return None
    return math.copysign(float(times or 1.0) * math.pi / divisor, -1.0 if sign == "-" else 1.0)


def with_angles(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a scene's document with numbers, rad, in place of angles as text.

    What is text elsewhere, or no angle, stays for validation to refuse.

    Args:
        document: with its links.
    """
    joints = [link["joint"] for link in _mappings(document.get("links")) if _has(link, "joint")]
    turning = {joint.get("name") for joint in joints if joint.get("type") == "revolute"}
    found = {key: _walk(value) for key, value in document.items()}
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
    for holder in (found, *_mappings(found.get("hands"))):
        if _has(holder, "device") and _has(holder["device"], "workspace"):
            _replace(holder["device"]["workspace"], "angle")
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


def _walk(value: object) -> Any:
    """Return a copy, with the angles of ``rpy`` and ``rotation`` as numbers."""
    if isinstance(value, Mapping):
        copy = {key: _walk(inner) for key, inner in value.items()}
        for key in ("rpy", "rotation"):
            if isinstance(copy.get(key), list):
                copy[key] = [_number(one) for one in copy[key]]
        return copy
    if isinstance(value, list | tuple):
        return [_walk(one) for one in value]
    return value


def _replace(mapping: dict[str, Any], *keys: str) -> None:
    for key in keys:
        if key in mapping:
            mapping[key] = _number(mapping[key])


def _number(value: object) -> object:
    angle = angle_of(value) if isinstance(value, str) else None
    return value if angle is None else angle


def _has(mapping: Mapping[str, Any], key: str) -> bool:
    """Return whether there is a mapping below a key."""
    return isinstance(mapping.get(key), Mapping)


def _mappings(value: object) -> list[Any]:
    """Return the mappings in a list; none of what is no list."""
    items = value if isinstance(value, list | tuple) else ()
    return [one for one in items if isinstance(one, Mapping)]
