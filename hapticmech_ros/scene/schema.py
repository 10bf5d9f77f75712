# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The JSON Schema of scene files, so that editors complete and check them."""

from __future__ import annotations

from typing import Any

from hapticmech_ros.scene.angles import allow_text
from hapticmech_ros.scene.key_reference import describe
from hapticmech_ros.scene.linkage import Linkage
from hapticmech_ros.scene.model_part import ModelPart
from hapticmech_ros.scene.scene import Scene


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
    found["oneOf"] = [
        {"required": [*required, way], "not": {"anyOf": _others(way)}}
        for way, required in (
            ("links", required),
            ("model", with_model),
            ("linkage", required),
        )
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


def _others(way: str) -> list[dict[str, Any]]:
    """Return what a scene whose links are given in one way must not have."""
    return [{"required": [other]} for other in ("links", "model", "linkage") if other != way]


def _allow_point(part: dict[str, Any]) -> None:
    """Let a part say a point of a linkage in place of ``link``."""
    part["properties"]["point"] = {
        "type": "string",
        "description": "of the scene's ``linkage``, in place of ``link`` and ``origin``",
    }
    part["required"] = [key for key in part["required"] if key != "link"]
    part["anyOf"] = [{"required": ["link"]}, {"required": ["point"]}]
