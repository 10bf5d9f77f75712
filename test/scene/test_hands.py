# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes with several hands: what each user has, and the rules."""

import pytest
import yaml

from hapticmech_ros import InvalidInputError, load_scene
from hapticmech_ros.errors import SceneError
from hapticmech_ros.scene import document_of, scene_from_document
from hapticmech_ros.scene.controller import by_rule
from oracles.users import two_points

ARM = {"kind": "arm", "waypoints": [{"time": 0.0}]}


def shared(*hands):
    return scene_from_document(two_points() | {"hands": list(hands)})


def test_each_has_its_own_and_the_scenes_otherwise():
    scene = shared(
        {"point": "b", "device": {"preset": "touch"}, "connection": {"expected": 0.02}},
        {"point": "a", "hand": ARM},
    )
    assert scene.held_points == ("b", "a")
    first, second = scene.held_at("b"), scene.held_at("a")
    assert first == scene.held_at()
    assert first.device.preset == "touch"
    assert first.hand == scene.hand
    assert first.connection.expected == 0.02
    assert second.device == scene.device
    assert second.hand.kind == "arm"
    assert not first.hands
    # Gains are by the rule of each one's own device and connection.
    for view in (first, second):
        joint = two_points_joint(view)
        assert view.controller.joint_constraint == joint
    assert first.controller != second.controller


def two_points_joint(view):
    """Return the gains of a scene that says nothing of them."""
    plain = scene_from_document(two_points()).controller.joint_constraint
    fields = {key: getattr(plain, key) for key in type(plain).model_fields}
    bare = type(plain)(**{k: v for k, v in fields.items() if k not in ("stiffness", "damping")})
    return by_rule(bare, view.device, view.connection, view.simulation.period)


def test_without_hands_the_first_point_is_held_by_the_scenes_own():
    scene = scene_from_document(two_points())
    assert scene.held_points == ("a",)
    assert scene.held_at("b") is scene
    with pytest.raises(InvalidInputError, match="'c'"):
        scene.held_at("c")


def test_a_scene_is_written_and_read_as_it_was():
    scene = shared({"point": "a", "device": {"preset": "omega_3"}}, {"point": "b", "hand": ARM})
    assert scene_from_document(document_of(scene)) == scene
    assert scene.with_("gravity=[0, 0, -1]").hands == scene.hands


def test_a_network_is_that_of_each(tmp_path):
    document = two_points() | {"hands": [{"point": "a", "connection": {}}, {"point": "b"}]}
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    scene = load_scene(path, network_delay=0.03)
    assert [scene.held_at(p).connection.expected for p in "ab"] == [0.03, 0.03]


BAD = [
    ("hands[0].point", [{"point": "c"}], "one of a, b"),
    ("hands[1].point", [{"point": "a"}, {"point": "a"}], "held once"),
    ("hands[0].point", [{"hand": ARM}], "required key is missing"),
    ("hands[0].grip", [{"point": "a", "grip": 1}], "unknown key"),
    ("hands[0].hand.mass", [{"point": "a", "hand": ARM | {"mass": -1.0}}], "greater than or equal"),
    (
        "hands[1].hand.waypoints[1].time",
        [{"point": "a"}, {"point": "b", "hand": ARM | {"waypoints": [{"time": 0.0}] * 2}}],
        "must increase",
    ),
    (
        "hands[0].device.damping",
        [{"point": "a", "device": {"mass": 0.01, "damping": 900.0}}],
        "must not exceed",
    ),
]


@pytest.mark.parametrize(("key", "hands", "words"), BAD)
def test_what_is_wrong_is_named_by_its_entry(key, hands, words):
    with pytest.raises(SceneError, match=words) as caught:
        shared(*hands)
    (problem,) = caught.value.problems
    assert problem.key_path == key


def test_in_a_plane_all_hands_are():
    document = document_of(load_scene("five_bar"))
    push = {"kind": "constant_wrench", "force": [0.0, 0.0, 1.0]}
    document["hands"] = [{"point": "handle", "hand": push}]
    with pytest.raises(SceneError, match="x-y plane") as caught:
        scene_from_document(document)
    assert [one.key_path for one in caught.value.problems] == ["hands[0].hand"]
