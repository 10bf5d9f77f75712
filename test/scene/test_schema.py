# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The JSON Schema of scene files: what validation takes, and ``model`` beside it."""

import json
import re
from pathlib import Path
from typing import Annotated, get_args

import pytest
from pydantic import TypeAdapter

from commands import ran
from hapticmech_ros import load_scene
from hapticmech_ros.errors import SceneError
from hapticmech_ros.files.yaml_text import read_yaml
from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.key_reference import examples, meanings, parts, scene_schema
from hapticmech_ros.scene.mechanism import JointType, ModelPart
from hapticmech_ros.scene.part import angle_of
from hapticmech_ros.scene.validation import written_document

PAGE = (Path(__file__).parents[2] / "docs" / "scene-keys.md").read_text(encoding="utf-8")


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
    assert set(schema["properties"]) == {*Scene.model_fields, "model", "linkage"}
    assert schema["additionalProperties"] is False
    assert set(schema["$defs"]["ModelPart"]["properties"]) == set(ModelPart.model_fields)


def test_every_reference_leads_somewhere():
    schema = scene_schema()
    found = set(refs(schema))
    assert {name.removeprefix("#/$defs/") for name in found} <= set(schema["$defs"])
    assert "#/$defs/Link" in found


def test_a_scene_has_links_or_a_model_or_a_linkage():
    with_links, with_model, with_linkage = scene_schema()["oneOf"]
    assert {"format", "name", "links", "operational_points", "hand"} == set(with_links["required"])
    assert set(with_model["required"]) == {"format", "model"}
    assert {*with_links["required"], "linkage"} - {"links"} == set(with_linkage["required"])


def test_shipped_scenes_use_its_keys():
    keys = set(scene_schema()["properties"])
    for name, path in shipped_scenes().items():
        written = written_document(path)
        assert set(written) <= keys
        assert load_scene(name).name == written["name"]


def test_the_command_prints_it():
    assert json.loads(ran("scene", "schema")) == json.loads(json.dumps(scene_schema()))


def test_every_key_of_every_part_has_a_meaning_that_editors_show():
    schema = scene_schema()
    described = {"Scene": schema, **schema["$defs"]}
    for name, part in parts().items():
        assert set(meanings(part)) == set(part.model_fields), name
    for name, definition in described.items():
        assert definition["description"], name
        for key, value in definition["properties"].items():
            assert value.get("description"), f"{name}.{key}"


def test_the_page_of_keys_is_the_models():
    shown = ran("scene", "schema", "--markdown")
    assert shown in PAGE
    # Each part once, and nothing that leads nowhere.
    titles = re.findall(r"^## (\w+)$", shown, re.MULTILINE)
    assert len(set(titles)) == len(titles)
    parts_told = {title.lower() for title in titles} - {"scene"}
    assert set(re.findall(r"\(#(\w+)\)", shown)) == parts_told | {"angles"}


def test_examples_of_the_page_are_values_that_scenes_take():
    scenes = [load_scene(name) for name in shipped_scenes()]
    found = examples(scenes)
    assert len(found) > 60
    joints = {scene.name: [link.joint for link in scene.links] for scene in scenes}
    names = {joint.name for one in joints.values() for joint in one}
    assert found["Joint", "name"] in names
    assert found["Joint", "type"] in get_args(JointType)
    assert (("Scene", "links")) not in found


GAINS = "controller.joint_constraint={}"


@pytest.mark.parametrize(
    ("key", "borne", "refused", "row"),
    [
        ("simulation.period", "0.1", "0.1001", "number > 0 and ≤ 0.1"),
        ("perception.s_off", "5e-2", "1.0", "number > 0 and < 1"),
        ("simulation.substeps", "1", "0", "whole number ≥ 1 and ≤ 1000"),
    ],
)
def test_rules_of_the_page_are_those_that_refuse(key, borne, refused, row):
    """The bound that the page tells of a number is the one at which it is refused."""
    load_scene("two_link", changes=[f"{key}={borne}", GAINS])
    with pytest.raises(SceneError, match=re.escape(key)):
        load_scene("two_link", changes=[f"{key}={refused}", GAINS])
    assert f"| `{key.split('.')[1]}` | {row} |" in PAGE


def test_every_key_has_an_example_that_it_accepts():
    """Keys whose values are parts of their own have tables of their own instead."""
    known, name, seen = {**parts(), "Scene": Scene}, "", 0
    for line in PAGE.splitlines():
        name = line.removeprefix("## ") if line.startswith("## ") else name
        found = re.fullmatch(r"\| `(\w+)` \| (.*) \| .* \| (?:`([^`]*)`)? \| .* \|", line)
        if found is None or name not in known:
            continue
        key, kind, example = found.groups()
        seen += 1
        assert example or "](#" in kind.replace("(#angles)", ""), f"{name}.{key}"
        if example:
            field = known[name].model_fields.get(key)
            if field is None:  # the model of a scene, which is read before
                continue
            value = read_yaml(example, key)
            if isinstance(value, str) and "(#angles)" in kind:
                value = angle_of(value)
            TypeAdapter(Annotated[field.annotation, field]).validate_python(value)
    assert seen > 250
