"""The JSON Schema of scene files: what validation takes, and ``model`` beside it."""

import json

from typer.testing import CliRunner

from hapticmech_ros import load_scene
from hapticmech_ros.cli import app
from hapticmech_ros.formats.model_part import ModelPart
from hapticmech_ros.scene import Scene, shipped_scenes
from hapticmech_ros.scene.schema import scene_schema
from hapticmech_ros.scene.validation import written_document


def refs(value):
    """Yield every reference in a schema."""
    if isinstance(value, dict):
        if "$ref" in value:
            yield value["$ref"]
        for part in value.values():
            yield from refs(part)
    elif isinstance(value, list):
        for part in value:
            yield from refs(part)


def test_it_has_the_keys_of_a_scene_and_the_model():
    schema = scene_schema()
    assert set(schema["properties"]) == {*Scene.model_fields, "model"}
    assert schema["additionalProperties"] is False
    assert set(schema["$defs"]["ModelPart"]["properties"]) == set(ModelPart.model_fields)


def test_every_reference_leads_somewhere():
    schema = scene_schema()
    found = set(refs(schema))
    assert {name.removeprefix("#/$defs/") for name in found} <= set(schema["$defs"])
    assert "#/$defs/Link" in found


def test_a_scene_has_links_or_a_model():
    with_links, with_model = scene_schema()["oneOf"]
    assert {"format", "name", "links", "operational_points", "hand"} == set(with_links["required"])
    assert set(with_model["required"]) == {"format", "model"}


def test_shipped_scenes_use_its_keys():
    keys = set(scene_schema()["properties"])
    for name, path in shipped_scenes().items():
        written = written_document(path)
        assert set(written) <= keys
        assert load_scene(name).name == written["name"]


def test_the_command_prints_it():
    found = CliRunner().invoke(app, ["scene", "schema"])
    assert found.exit_code == 0, found.output
    assert json.loads(found.output) == json.loads(json.dumps(scene_schema()))
