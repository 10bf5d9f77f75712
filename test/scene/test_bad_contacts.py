# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every rule that shapes and contacts can break: the error names key path, value and rule."""

import pytest

from hapticmech_ros.errors import SceneError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.loading.loader import with_own_paths
from hapticmech_ros.scene import document_of, scene_from_document
from hapticmech_ros.scene.rules import MESH_SIZE_LIMIT
from oracles.touching import on_floor
from scene.broken import place, problems_of

# key path | value | words of the rule
BROKEN = [
    ("shapes[1].link", "nothing", "unknown frame"),
    ("shapes[1].name", "floor", "names must be unique"),
    ("shapes[1].geometry.radius", -1.0, "greater than or equal to 0.000001"),
    ("shapes[1].geometry.radiu", 1.0, "unknown key"),
    ("shapes[1].geometry.kind", "cone", "'sphere'"),
    ("contacts[0].a", "nothing", "unknown shape"),
    ("contacts[0].a", "floor", "move against each other"),
    ("contacts[0].stiffness", 0.0, "greater than 0"),
    ("contacts[0].damping", -1.0, "greater than or equal to 0"),
    ("contacts[0].friction", float("nan"), "finite number"),
    ("contacts[0].restitution", 0.5, "unknown key"),
]
WHERE = {"contacts[0].a": "contacts[0].b", "shapes[1].geometry.kind": "shapes[1].geometry"}


@pytest.mark.parametrize(("path", "value", "rule"), BROKEN)
def test_a_broken_rule_names_key_and_rule(path, value, rule):
    document = on_floor("sphere")
    place(document, path, value)
    wanted = WHERE.get(path, path) if value in ("floor", "cone") and path in WHERE else path
    problems = problems_of(document)
    assert any(rule in p.rule for p in problems if p.key_path == wanted), problems


MESH = "shapes[1].geometry.file"


@pytest.mark.parametrize(
    ("geometry", "key", "rule"),
    [
        (
            {"kind": "half_space"},
            "contacts[0].b",
            "two half-spaces do not touch in points: one of the two must be bounded",
        ),
        ({"kind": "mesh", "file": "nowhere.stl"}, MESH, "no such file"),
        (
            {"kind": "mesh", "file": "body.xyz", "scale": [1.0, 0.0, -1.0]},
            "shapes[1].geometry.scale[1]",
            "must not be zero",
        ),
        (
            {"kind": "mesh", "file": "body.xyz", "scale": [1.0, 2.0, -1.0]},
            MESH,
            "a mesh's file must end in one of .stl, .obj, .dae, .off",
        ),
        (
            {"kind": "mesh", "file": "large.stl", "scale": [1.0, 2.0, -1.0]},
            MESH,
            f"a mesh's file must have at most {MESH_SIZE_LIMIT} bytes (32000001)",
        ),
    ],
    ids=["two half-spaces", "not there", "flattened", "of no known kind", "large"],
)
def test_a_geometry_that_does_not_touch_is_refused(tmp_path, monkeypatch, geometry, key, rule):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "body.xyz").touch()
    with (tmp_path / "large.stl").open("wb") as written:
        written.truncate(MESH_SIZE_LIMIT + 1)
    document = on_floor("sphere")
    document["shapes"][1]["geometry"] = geometry
    (found,) = problems_of(document)
    assert (found.key_path, found.rule) == (key, rule)


@pytest.mark.parametrize(
    ("text", "rule"),
    [("nothing", "cannot be read"), ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "must not be flat")],
)
def test_a_mesh_that_is_no_body(tmp_path, text, rule):
    from hapticmech_ros.simulation import Simulator

    file = tmp_path / "bad.obj"
    file.write_text(text, encoding="utf-8")
    document = on_floor("sphere")
    document["shapes"][1]["geometry"] = {"kind": "mesh", "file": str(file)}
    with pytest.raises(SceneError, match=rule) as caught:
        Simulator(scene_from_document(document))
    assert caught.value.problems[0].key_path == "shapes[1].geometry.file"


def test_paths_of_meshes_and_scripts_are_from_the_scenes_file(tmp_path):
    mesh, push = {"kind": "mesh", "file": "cube.obj"}, {"kind": "scripted", "file": "push.csv"}
    document = {
        "shapes": [{"name": "cube", "geometry": mesh}],
        "hand": push,
        "hands": [{"point": "a"}, {"point": "b", "hand": push}],
    }
    moved = with_own_paths(document, tmp_path / "scene.yaml")
    assert moved["shapes"][0]["geometry"]["file"] == str(tmp_path / "cube.obj")
    whole = {"kind": "scripted", "file": str(tmp_path / "push.csv")}
    assert moved["hand"] == whole
    assert moved["hands"] == [{"point": "a"}, {"point": "b", "hand": whole}]
    assert (mesh["file"], push["file"]) == ("cube.obj", "push.csv")


def test_what_a_scene_says_of_contacts_survives_a_document():
    scene = scene_from_document(on_floor("capsule"))
    assert scene_from_document(document_of(scene)) == scene
    assert load_scene("five_bar").contacts == ()
