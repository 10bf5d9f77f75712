# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Angles as text: where they may be written, and what they are."""

from __future__ import annotations

import math

import pytest

from hapticmech_ros import SceneError, load_scene
from hapticmech_ros.scene import document_of, scene_from_document
from hapticmech_ros.scene.part import angle_of
from hapticmech_ros.scene.validation import with_angles


@pytest.mark.parametrize(
    ("text", "angle"),
    [
        ("90 deg", math.pi / 2),
        ("-22.5deg", -math.pi / 8),
        ("+1e1 deg", math.pi / 18),
        ("pi", math.pi),
        ("-pi/2", -math.pi / 2),
        ("2*pi/3", 2 * math.pi / 3),
        ("-0.5*pi", -math.pi / 2),
        (" pi/4 ", math.pi / 4),
    ],
)
def test_what_an_angle_is(text, angle):
    assert angle_of(text) == pytest.approx(angle, rel=1e-15)


@pytest.mark.parametrize(
    "text",
    ["", "90", "deg", "90 degrees", "2pi", "pi/0", "pi*2", "pi/2/2", "1.2.3 deg", "π", "--pi"],
)
def test_what_none_is(text):
    assert angle_of(text) is None


@pytest.fixture
def document():
    return document_of(load_scene("five_bar"))


def test_angles_are_read_where_they_may_be_written(document):
    link = document["links"][0]
    joint = link["joint"]
    joint["origin"]["rpy"] = ["0 deg", 0.0, "pi/2"]
    joint["rest"] = "30 deg"
    joint["limits"] = {"lower": "-pi", "upper": "180 deg", "stiffness": 10.0}
    document["initial_state"]["q"][joint["name"]] = "-45 deg"
    document["device"]["workspace"]["angle"] = "60 deg"
    document["closures"][0]["a"]["origin"]["rpy"] = [0.0, 0.0, "pi"]
    before = str(document)
    found = with_angles(document)
    assert str(document) == before
    joint = found["links"][0]["joint"]
    assert joint["rest"] == math.radians(30)
    assert (joint["limits"]["lower"], joint["limits"]["upper"]) == (-math.pi, math.pi)
    assert found["initial_state"]["q"][joint["name"]] == math.radians(-45)
    scene = scene_from_document(document)
    assert scene.links[0].joint.origin.rpy == (0.0, 0.0, math.pi / 2)
    assert scene.device.workspace.angle == math.radians(60)
    assert scene.closures[0].a.origin.rpy[2] == math.pi


def test_a_scene_in_degrees_is_the_scene_in_radians(document):
    joint = document["links"][0]["joint"]["name"]
    document["initial_state"]["q"][joint] = math.pi / 3
    radians = scene_from_document(document)
    document["initial_state"]["q"][joint] = "60 deg"
    degrees = scene_from_document(document)
    assert degrees.initial_state.q[joint] == pytest.approx(radians.initial_state.q[joint])


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ("links.link1.inertial.mass=90 deg", "links[0].inertial.mass"),
        ("links.link1.joint.damping=pi/2", "links[0].joint.damping"),
        ("initial_state.q.joint1=90 degrees", "initial_state.q.joint1"),
        ("device.mass=pi", "device.mass"),
    ],
)
def test_they_are_refused_elsewhere_and_so_is_what_is_none(change, key):
    with pytest.raises(SceneError) as caught:
        load_scene("five_bar", changes=[change])
    assert key in str(caught.value)
    assert change.split("=")[1] in str(caught.value)


def test_a_sliding_joint_has_no_angle():
    scene = document_of(load_scene("crane"))
    slides = [one["joint"] for one in scene["links"] if one["joint"]["type"] == "prismatic"]
    name = slides[0]["name"]
    scene["initial_state"]["q"][name] = "90 deg"
    with pytest.raises(SceneError, match=f"initial_state.q.{name}"):
        scene_from_document(scene)


@pytest.mark.parametrize(
    "document", [{"links": 3}, {"links": [3, {"joint": 4}]}, {"initial_state": {"q": 5}}]
)
def test_documents_that_are_no_scene_stay_for_validation(document):
    assert with_angles(document) == document
