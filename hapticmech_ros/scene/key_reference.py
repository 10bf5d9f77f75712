# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every key of a scene file: kind, rule, unit and meaning, from the models that check them.

Meanings are those of the models' docstrings, which stand beside the fields.

The JSON Schema of scene files has the same source: editors complete and check scenes by it.
"""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from hapticmech_ros.scene.linkage import Linkage
from hapticmech_ros.scene.mechanism import ModelPart
from hapticmech_ros.scene.part import LARGEST, PATTERN, Part
from hapticmech_ros.scene.scene import Scene
from hapticmech_ros.scene.validation import allow_text

_LINE = re.compile(r"(\w+): (.*)")
_ROLE = re.compile(r":\w+:`~?([^`]*)`")
_REFERENCE = "#/$defs/"
# Longer examples are not shown.
LONGEST_EXAMPLE = 40
Examples = Mapping[tuple[str, str], str]
# Of keys that no shipped scene writes and whose default shows little; a test checks their rules.
OTHERS: dict[tuple[str, str], str] = {
    ("Scene", "description"): "Door with a latch",
    ("Coupling", "name"): "gear",
    ("Coupling", "joint"): "wheel",
    ("Coupling", "leader"): "crank",
    ("Coupling", "ratio"): "-2.5",
    ("Coupling", "offset"): "90 deg",
    ("Coupling", "polycoef"): "[0, 0.02, -0.01, 0.002, 0]",
    ("Spring", "name"): "return",
    ("Spring", "stiffness"): "150.0",
    ("Spring", "damping"): "0.5",
    ("Spring", "rest_length"): "0.08",
    ("ContactPair", "dissipation"): "0.2",
    ("InitialState", "v"): "{joint1: 0.5}",
    ("Device", "preset"): "touch",
    ("Device", "damping"): "0.1",
    ("Device", "angular_damping"): "1e-4",
    ("Device", "coulomb_friction"): "0.2",
    ("Device", "angular_coulomb_friction"): "1e-3",
    ("Device", "gravity_load"): "[0, 0, -0.4]",
    ("Device", "actuator_bandwidth"): "250.0",
    ("Device", "position_resolution"): "5e-5",
    ("Device", "angle_resolution"): "1e-3",
    ("Hand", "release_at"): "[2.0, 4.0]",
    ("Hand", "grab_at"): "[3.0]",
    ("Grip", "stiffness"): "1000.0",
    ("Grip", "damping"): "10.0",
    ("Grip", "angular_stiffness"): "0.9",
    ("Grip", "angular_damping"): "0.009",
    ("ScriptedHand", "file"): "hand.csv",
    ("Connection", "delay"): "0.02",
    ("Connection", "jitter"): "0.005",
    ("Connection", "loss"): "0.01",
    ("Connection", "seed"): "7",
    ("Connection", "expected"): "0.02",
    ("Scene", "hands"): "[{point: left}, {point: right}]",
    ("HeldPoint", "point"): "left",
    ("HeldPoint", "hand"): "{kind: arm, waypoints: [{time: 0}]}",
    ("HeldPoint", "device"): "{preset: touch}",
    ("HeldPoint", "controller"): "{grasp_ramp: 0.5}",
    ("HeldPoint", "connection"): "{expected: 0.02}",
    ("ModelPart", "file"): "robot.urdf",
    ("ModelPart", "name"): "arm",
    ("Joint", "armature"): "0.05",
    ("Sphere", "radius"): "0.02",
    ("Cylinder", "radius"): "0.01",
    ("Cylinder", "length"): "0.1",
    ("Capsule", "radius"): "0.01",
    ("Capsule", "length"): "0.1",
    ("Mesh", "file"): "cup.stl",
    ("Mesh", "scale"): "[0.001, 0.001, 0.001]",
    ("Accuracy", "tolerance"): "1e-5",
    ("Workspace", "radius"): "0.1",
    ("Workspace", "angle"): "60 deg",
    ("Compensation", "friction"): "0.8",
    ("Servo", "stiffness"): "1500.0",
    ("Servo", "angular_stiffness"): "2.0",
    ("Safety", "workspace_radius"): "0.12",
    ("Tremor", "frequency"): "9.0",
    ("Tremor", "force"): "[0.05, 0.05, 0]",
    ("Tremor", "torque"): "[0, 0, 1e-3]",
    ("Tremor", "xyz"): "[0.0005, 0, 0]",
    ("Tremor", "rotation"): "[0, 0, 0.01]",
    ("JointConstraintGains", "feedforward"): "0.5",
    ("ForceChannelGains", "mechanism_feedback"): "0.5",
    ("ForceChannelGains", "device_feedback"): "0.5",
    ("JointChange", "damping"): "0.1",
    ("JointChange", "armature"): "0.05",
    ("JointChange", "stiffness"): "2.0",
    ("JointChange", "rest"): "0.3",
    ("JointChange", "friction"): "0.02",
    ("JointChange", "effort"): "0.5",
    ("Linkage", "points"): "{A: [0, 0], B: [0.03, 0.05]}",
    ("Linkage", "ground"): "[A, D]",
    ("Linkage", "hinges"): "{A: [0, 0, 1]}",
    ("Bar", "name"): "crank",
    ("Bar", "points"): "[A, B]",
    ("Bar", "mass"): "0.2",
    ("Bar", "density"): "2.0",
    ("Bar", "radius"): "0.005",
    ("Bar", "com"): "[0.02, 0.03]",
    ("Bar", "inertia"): "1e-4",
    ("Slider", "name"): "block",
    ("Slider", "point"): "C",
    ("Slider", "along"): "[1, 0]",
    ("Slider", "on"): "crank",
    ("Slider", "mass"): "0.1",
    ("Rod", "name"): "link_rod",
    ("Rod", "points"): "[B, C]",
    ("PinJoint", "name"): "elbow",
    ("PinJoint", "damping"): "0.1",
    ("PinJoint", "armature"): "0.05",
    ("PinJoint", "friction"): "0.02",
    ("Shape", "point"): "P",
    ("OperationalPoint", "point"): "P",
    ("LinkFrame", "point"): "P",
    ("Inertia", "ixy"): "1e-5",
    ("Inertia", "ixz"): "1e-5",
    ("Inertia", "iyz"): "1e-5",
}


def meanings(part: type[Part]) -> dict[str, str]:
    """Return the meaning of each key of a part, by key: of ``Attributes`` in its docstring."""
    found: dict[str, str] = {}
    for base in reversed(part.__mro__):
        if issubclass(base, Part) and base is not Part:
            found.update(_attributes(base.__doc__ or ""))
    return {key: found[key] for key in part.model_fields if key in found}


def summary(part: type[Part]) -> str:
    """Return a part's docstring before its attributes, as paragraphs."""
    text = inspect.cleandoc(part.__doc__ or "").split("Attributes:\n")[0]
    paragraphs = re.split(r"\n\s*\n", text.strip())
    return "\n\n".join(_plain(" ".join(one.split())) for one in paragraphs)


def parts() -> dict[str, type[Part]]:
    """Return all parts that scene files are made of, by name."""
    return {part.__name__: part for part in _below(Part)}


def describe(schema: dict[str, Any]) -> None:
    """Put the meaning of each key into a JSON Schema of parts, for editors to show."""
    known = parts()
    for name, definition in (*schema.get("$defs", {}).items(), (schema.get("title"), schema)):
        if name in known:
            definition["description"] = summary(known[name])
            for key, meaning in meanings(known[name]).items():
                definition["properties"][key]["description"] = meaning


def examples(scenes: Iterable[Part]) -> dict[tuple[str, str], str]:
    """Return a value that is written in some scene, as YAML, by part and key."""
    found: dict[tuple[str, str], str] = {}
    for scene in scenes:
        _collect(scene, found)
    return found


def _collect(value: object, found: dict[tuple[str, str], str]) -> None:
    if isinstance(value, Part):
        for key in type(value).model_fields:
            inner = getattr(value, key)
            _collect(inner, found)
            if key in value.model_fields_set and not _has_parts(inner):
                shown = json.dumps(inner) if isinstance(inner, tuple | dict) else str(inner)
                plain = shown.lower() if isinstance(inner, bool) else shown
                if inner is not None and len(plain) <= LONGEST_EXAMPLE:
                    found.setdefault((type(value).__name__, key), plain)
    elif isinstance(value, tuple):
        for one in value:
            _collect(one, found)


def _has_parts(value: object) -> bool:
    inside = value if isinstance(value, tuple) else (value,)
    return any(isinstance(one, Part) for one in inside)


def key_reference(schema: Mapping[str, Any], written: Examples) -> str:
    """Return the keys of scene files as Markdown, a table for each part, as the schema has them.

    Args:
        schema: of scene files, with meanings.
        written: examples, by part and key.
    """
    whole = {**schema, "required": schema["oneOf"][0]["required"]}
    sections = [_section(str(schema["title"]), whole, written)]
    reached, at = _references(schema), 0
    while at < len(reached):
        definition = schema["$defs"][reached[at]]
        sections.append(_section(reached[at], definition, written))
        reached += [name for name in _references(definition) if name not in reached]
        at += 1
    return "\n".join(sections)


def _section(name: str, definition: Mapping[str, Any], written: Examples) -> str:
    required = definition.get("required", [])
    lines = [
        f"## {name}\n\n{definition['description']}\n",
        "| key | value | default | example | meaning |",
        "|---|---|---|---|---|",
    ]
    for key, value in definition.get("properties", {}).items():
        default = "required" if key in required else _default(value)
        text = _example(name, key, value, written)
        example = f"`{text}`" if text else ""
        meaning = _plain(str(value.get("description", "")))
        cells = f"`{key}`", _kind(value), default, example, meaning
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def _example(part: str, key: str, value: Mapping[str, Any], written: Examples) -> str:
    """Return an example for a key: from a scene, from above, or otherwise its default.

    Empty for keys whose values are parts, which have tables of their own.
    """
    hand = ("Hand", key) if part.endswith("Hand") else (part, key)
    for found in (written, OTHERS):
        for name in ((part, key), hand):
            if name in found:
                return found[name]
    default, choices = value.get("default"), value.get("enum", [])
    if "const" in value:
        return str(value["const"])
    if choices:
        return str(next(one for one in choices if one != default))
    if isinstance(default, bool):
        return str(not default).lower()
    return str(default) if isinstance(default, int | float) else ""


def _kind(value: Mapping[str, Any]) -> str:
    """Return a key's kinds of values, in words."""
    choices = value.get("anyOf") or value.get("oneOf")
    if choices:
        return " or ".join(_kind(one) for one in choices)
    if "$ref" in value:
        name = value["$ref"].removeprefix(_REFERENCE)
        return f"[{name}](#{name.lower()})"
    if "const" in value:
        return f"`{value['const']}`"
    if "enum" in value:
        return ", ".join(f"`{one}`" for one in value["enum"])
    kind = value.get("type")
    if kind in ("number", "integer"):
        return _number(value)
    if kind == "array":
        return _list(value)
    if kind == "object":
        (inner,) = value.get("patternProperties", {"": value.get("additionalProperties")}).values()
        return f"mapping of names to {_kind(inner)}"
    names = {"boolean": "`true` or `false`", "null": "`null`", "string": "text"}
    if value.get("pattern") == PATTERN:
        return "[angle](#angles)"
    return "name" if "pattern" in value else names[str(kind)]


def _number(value: Mapping[str, Any]) -> str:
    bounds = []
    for key, sign in (
        ("exclusiveMinimum", ">"),
        ("minimum", "≥"),
        ("exclusiveMaximum", "<"),
        ("maximum", "≤"),
    ):
        bound = value.get(key)
        if bound is not None and abs(bound) < LARGEST:
            bounds.append(f"{sign} {bound:g}")
    word = "whole number" if value["type"] == "integer" else "number"
    return " ".join([word, " and ".join(bounds)]).strip()


def _list(value: Mapping[str, Any]) -> str:
    fixed = value.get("prefixItems")
    if fixed:
        return f"list of {len(fixed)}: {_kind(fixed[0])}"
    least = " (at least one)" if value.get("minItems") else ""
    return f"list{least}: {_kind(value['items'])}"


def _default(value: Mapping[str, Any]) -> str:
    default = value.get("default")
    if isinstance(default, Mapping):
        return "its defaults"
    if default is None or default in ("", []):
        return "none"
    return f"`{str(default).lower() if isinstance(default, bool) else default}`"


def _references(value: object) -> list[str]:
    """Return the names of the parts that a schema's properties refer to, each once, in order."""
    found: list[str] = []
    if isinstance(value, Mapping):
        if "$ref" in value:
            found.append(str(value["$ref"]).removeprefix(_REFERENCE))
        for key, inner in value.items():
            # The discriminator names the same parts again.
            if key not in ("$defs", "discriminator"):
                found += [name for name in _references(inner) if name not in found]
    elif isinstance(value, list):
        for inner in value:
            found += [name for name in _references(inner) if name not in found]
    return found


def _attributes(docstring: str) -> Iterator[tuple[str, str]]:
    """Yield key and meaning of each entry below ``Attributes:``."""
    _, _, entries = inspect.cleandoc(docstring).partition("Attributes:\n")
    for entry in re.split(r"\n(?=    \w)", entries.rstrip()):
        found = _LINE.fullmatch(" ".join(entry.split()))
        if found is not None:
            yield found[1], _plain(found[2])


def _plain(text: str) -> str:
    """Return a docstring's text as Markdown."""
    return _ROLE.sub(r"`\1`", text).replace("``", "`")


def _below(part: type[Part]) -> Iterator[type[Part]]:
    for inner in part.__subclasses__():
        yield inner
        yield from _below(inner)


def scene_schema() -> dict[str, Any]:
    """Return the schema: a scene with its links, their points, or the file that has them."""
    found = Scene.model_json_schema()
    definitions = dict(found.get("$defs", {}))
    for part in (ModelPart, Linkage):
        schema = part.model_json_schema(ref_template="#/$defs/{model}")
        definitions |= {**schema.pop("$defs", {}), part.__name__: schema}
    found["$defs"] = definitions
    found["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    file = {"type": "string", "description": "URDF, MJCF or SDF, relative to this file"}
    found["properties"]["model"] = {"anyOf": [file, {"$ref": "#/$defs/ModelPart"}]}
    found["properties"]["linkage"] = {"$ref": "#/$defs/Linkage"}
    for name in ("OperationalPoint", "LinkFrame", "Shape"):
        _allow_point(definitions[name])
    required = [key for key in found.pop("required") if key != "links"]
    with_model = [key for key in required if key not in ("name", "operational_points", "hand")]
    ways = {"links": required, "model": with_model, "linkage": required}
    found["oneOf"] = [
        # Links that are given in one way forbid the others.
        {
            "required": [*required, way],
            "not": {"anyOf": [{"required": [other]} for other in ways if other != way]},
        }
        for way, required in ways.items()
    ]
    allow_text(found)
    describe(found)
    found["properties"]["model"]["description"] = (
        "in place of ``links``: the file that they come from"
    )
    found["properties"]["linkage"]["description"] = (
        "in place of ``links``: the points that they go through"
    )
    return found


def _allow_point(part: dict[str, Any]) -> None:
    """Let a part name a point of a linkage in place of ``link``."""
    part["properties"]["point"] = {
        "type": "string",
        "description": "of the scene's ``linkage``, in place of ``link`` and ``origin``",
    }
    part["required"] = [key for key in part["required"] if key != "link"]
    part["anyOf"] = [{"required": ["link"]}, {"required": ["point"]}]
