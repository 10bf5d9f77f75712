"""The JSON Schema of scene files, so that editors complete and check them."""

from __future__ import annotations

from typing import Any

from hapticmech_ros.formats.model_part import ModelPart
from hapticmech_ros.scene.angles import allow_text
from hapticmech_ros.scene.document import Scene
from hapticmech_ros.scene.key_reference import describe


def scene_schema() -> dict[str, Any]:
    """Return the schema: a scene with its links, or with ``model`` for the file that has them."""
    found = Scene.model_json_schema()
    model = ModelPart.model_json_schema(ref_template="#/$defs/{model}")
    definitions = {**found.get("$defs", {}), **model.pop("$defs", {})}
    found["$defs"] = {**definitions, "ModelPart": model}
    found["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    file = {"type": "string", "description": "URDF, MJCF or SDF, relative to this file"}
    found["properties"]["model"] = {"anyOf": [file, {"$ref": "#/$defs/ModelPart"}]}
    required = [key for key in found.pop("required") if key != "links"]
    with_model = [key for key in required if key not in ("name", "operational_points", "hand")]
    found["oneOf"] = [
        {"required": [*required, "links"], "not": {"required": ["model"]}},
        {"required": [*with_model, "model"], "not": {"required": ["links"]}},
    ]
    allow_text(found)
    describe(found)
    found["properties"]["model"]["description"] = (
        "in place of ``links``: the file that they come from"
    )
    return found
