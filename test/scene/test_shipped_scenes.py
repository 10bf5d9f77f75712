# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shipped scenes load, close, freeze, and survive being written out and read again."""

import json

import numpy as np
import pytest
from pydantic import ValidationError
from ruamel.yaml import YAML

from hapticmech_ros import Simulator
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.loading import load_scene, shipped_scenes
from hapticmech_ros.scene import document_of, scene_from_document

SCENES = sorted(shipped_scenes())


@pytest.mark.parametrize("name", SCENES)
def test_round_trip_through_plain_data_json_and_yaml(name, tmp_path):
    scene = load_scene(name)
    document = document_of(scene)
    assert scene.name == name
    assert scene_from_document(document) == scene
    assert scene_from_document(json.loads(json.dumps(document))) == scene
    path = tmp_path / "again.yaml"
    YAML(typ="safe", pure=True).dump(document, path)
    assert load_scene(path) == scene


def test_scenes_are_frozen():
    scene = load_scene("five_bar")
    with pytest.raises(ValidationError, match="frozen"):
        scene.name = "other"
    with pytest.raises(ValidationError, match="frozen"):
        scene.links[0].inertial.mass = 2.0
    with pytest.raises(TypeError):
        scene.links[0] = scene.links[-1]


@pytest.mark.parametrize("name", SCENES)
def test_scenes_start_closed_and_describe_themselves(name):
    scene = load_scene(name)
    assert scene.description
    # Assembly promises 1e-12 m.
    assert Simulator(scene).initial_state().closure_error <= 1e-12


def test_defaults_are_written_out():
    document = document_of(load_scene("two_link"))
    assert document["closures"] == []
    assert document["controller"]["joint_constraint"]["stiffness"] == 2000.0


def test_a_scene_is_found_by_path_too(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(shipped_scenes()["two_link"].read_text(encoding="utf-8"), encoding="utf-8")
    assert load_scene(path) == load_scene(str(path)) == load_scene("two_link")


def test_an_unknown_operational_point_lists_those_there_are():
    with pytest.raises(InvalidInputError, match="tip") as caught:
        load_scene("five_bar").operational_point("tip")
    assert caught.value.value == "tip"
    assert caught.value.rule == "must be one of handle"


def test_numbers_may_be_written_without_a_point(planar):
    planar["links"][0]["inertial"]["mass"] = 1
    scene = scene_from_document(planar)
    assert scene == load_scene("five_bar")
    assert isinstance(scene.links[0].inertial.mass, float)


def test_positions_of_a_joint_may_be_a_list_of_one(planar):
    planar["initial_state"]["q"]["joint1"] = [1.9]
    listed = Simulator(scene_from_document(planar)).initial_state()
    plain = Simulator(load_scene("five_bar")).initial_state()
    assert np.array_equal(listed.q, plain.q)
