# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Meshes are found where files name them: beside the file, or in packages and models."""

from __future__ import annotations

import os

import pytest

from formats.meshes import TETRAHEDRON, stl
from formats.test_sdf import joint, link
from formats.test_sdf import written as sdf_written
from formats.test_shapes import MJCF, collision, mjcf, scene, sdf_collision, urdf
from hapticmech_ros import load_scene
from hapticmech_ros.errors import SceneError
from hapticmech_ros.scene.rules import MESH_SIZE_LIMIT

MANIFEST = '<?xml version="1.0"?><package format="3"><name>{}</name></package>'
VARIABLES = ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH", "GZ_SIM_RESOURCE_PATH", "SDF_PATH")


@pytest.fixture(autouse=True)
def _no_packages_but_ours(monkeypatch):
    for variable in VARIABLES:
        monkeypatch.delenv(variable, raising=False)


def meshes_of(folder, name):
    """Return the file that is found where a URDF in a folder names a mesh so."""
    folder.mkdir(parents=True, exist_ok=True)
    ends = {"a": collision('<sphere radius="1"/>'), "d": collision(f'<mesh filename="{name}"/>')}
    path = urdf(folder, **ends)
    (folder / "body.stl").unlink()
    found = load_scene(scene(path, [("base_collision", "tool_collision")]))
    return found.shapes[1].geometry.file


def placed(file):
    file.parent.mkdir(parents=True, exist_ok=True)
    return stl(file, TETRAHEDRON)


# Where the mesh is, and how a URDF in ws/arm/urdf names it.
NAMES = {
    "beside": ("ws/arm/urdf/part.stl", "part.stl"),
    "relative": ("ws/arm/meshes/part.stl", "../meshes/part.stl"),
    "file": ("ws/arm/meshes/a part.stl", "file://{root}/ws/arm/meshes/a%20part.stl"),
    "absolute": ("part.stl", "{root}/part.stl"),
    "folder above": ("ws/arm/meshes/part.stl", "package://arm/meshes/part.stl"),
    "package above": ("ws/arm/meshes/part.stl", "package://arm_description/meshes/part.stl"),
    "folder beside one above": ("ws/hand/part.stl", "package://hand/part.stl"),
    "model": ("ws/arm/meshes/part.stl", "model://arm/meshes/part.stl"),
}


@pytest.mark.parametrize(("where", "name"), NAMES.values(), ids=NAMES)
def test_meshes_are_found_by_path_and_by_package(tmp_path, where, name):
    file = placed(tmp_path / where)
    (tmp_path / "ws" / "arm").mkdir(parents=True, exist_ok=True)
    (tmp_path / "ws" / "arm" / "package.xml").write_text(MANIFEST.format("arm_description"))
    found = meshes_of(tmp_path / "ws" / "arm" / "urdf", name.format(root=tmp_path))
    assert file.samefile(found)


@pytest.mark.parametrize(
    ("variable", "inside", "scheme"),
    [
        ("AMENT_PREFIX_PATH", "share/hand", "package"),
        ("ROS_PACKAGE_PATH", "hand", "package"),
        ("GZ_SIM_RESOURCE_PATH", "hand", "model"),
        ("SDF_PATH", "hand", "model"),
    ],
)
def test_meshes_are_found_where_variables_say(tmp_path, monkeypatch, variable, inside, scheme):
    file = placed(tmp_path / "elsewhere" / inside / "meshes" / "part.stl")
    places = (tmp_path / "gone", "", tmp_path / "elsewhere")
    monkeypatch.setenv(variable, os.pathsep.join(map(str, places)))
    found = meshes_of(tmp_path / "ws", f"{scheme}://hand/meshes/part.stl")
    assert file.samefile(found)
    other = {"package": "model", "model": "package"}[scheme]
    with pytest.raises(SceneError, match=r"no such file in a folder or package 'hand'"):
        meshes_of(tmp_path / "ws", f"{other}://hand/meshes/part.stl")


def test_the_nearest_package_counts(tmp_path, monkeypatch):
    placed(tmp_path / "elsewhere" / "arm" / "part.stl")
    near = placed(tmp_path / "ws" / "arm" / "part.stl")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "elsewhere"))
    assert near.samefile(meshes_of(tmp_path / "ws" / "arm", "package://arm/part.stl"))


def test_a_manifest_that_is_no_file_names_no_package(tmp_path):
    (tmp_path / "ws").mkdir()
    os.mkfifo(tmp_path / "ws" / "package.xml")
    with pytest.raises(SceneError, match=r"no such file in a folder or package"):
        meshes_of(tmp_path / "ws" / "urdf", "package://hand/part.stl")


def test_a_mesh_that_is_nowhere_is_named_with_where_it_was_searched_for(tmp_path, monkeypatch):
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "install"))
    with pytest.raises(SceneError) as caught:
        meshes_of(tmp_path / "ws", "package://hand/part.stl")
    (problem,) = caught.value.problems
    assert problem.value == "package://hand/part.stl"
    for words in ("'hand'", str(tmp_path / "ws"), str(tmp_path / "install" / "share"), "AMENT"):
        assert words in problem.rule


@pytest.mark.parametrize(
    ("name", "rule"),
    [
        ("gone/part.stl", "no such file in"),
        ("http://example.org/part.stl", "a mesh is a path, file://"),
        ("x" * 5000, "no such file"),
        ("package://", "no such file"),
        ("..", "no such file"),
    ],
)
def test_names_of_no_mesh_are_refused(tmp_path, name, rule):
    with pytest.raises(SceneError, match=rule) as caught:
        meshes_of(tmp_path, name)
    assert caught.value.problems[0].key_path.endswith("<mesh>")


def test_a_mesh_file_is_bounded_and_of_a_known_kind(tmp_path):
    with (tmp_path / "large.stl").open("wb") as file:
        file.truncate(MESH_SIZE_LIMIT + 1)
    with pytest.raises(SceneError, match=rf"at most {MESH_SIZE_LIMIT} bytes"):
        meshes_of(tmp_path, "large.stl")
    for name in ("part.blend", "part.ply", "part"):
        placed(tmp_path / name)
        with pytest.raises(SceneError, match=r"must end in one of"):
            meshes_of(tmp_path, name)
    os.mkfifo(tmp_path / "pipe.stl")
    with pytest.raises(SceneError, match=r"no such file"):
        meshes_of(tmp_path, "pipe.stl")


@pytest.mark.parametrize(
    ("compiler", "file", "where"),
    [
        ("", "parts/body.stl", "parts"),
        ('meshdir="parts"', "body.stl", "parts"),
        ('assetdir="parts"', "body.stl", "parts"),
        ('assetdir="gone" meshdir="parts"', "body.stl", "parts"),
        ('meshdir="parts" strippath="true"', "away/body.stl", "parts"),
        ('meshdir="{folder}/parts"', "body.stl", "parts"),
        ('meshdir="gone"', "{folder}/parts/body.stl", "parts"),
    ],
)
def test_meshes_of_mjcf_are_where_its_compiler_says(tmp_path, compiler, file, where):
    text = MJCF.replace('meshdir="parts"', compiler).replace('file="body.stl"', f'file="{file}"')
    path = mjcf(tmp_path, text.replace("{folder}", str(tmp_path)))
    found = load_scene(scene(path, [("floor", "piece")])).shapes[1].geometry.file
    assert (tmp_path / where / "body.stl").samefile(found)


@pytest.mark.parametrize("uri", ["model://thing/meshes/part.stl", "meshes/part.stl"])
def test_meshes_of_sdf_are_where_its_uris_say(tmp_path, uri):
    file = placed(tmp_path / "thing" / "meshes" / "part.stl")
    ball = sdf_collision("ball", "<sphere><radius>1</radius></sphere>")
    floor = {"name": "floor", "link": "world", "geometry": {"kind": "half_space"}}
    mesh = sdf_collision("part", f"<mesh><uri> {uri} </uri></mesh>")
    parts = [link("a", ball + mesh), joint("j", "world", "a")]
    path = sdf_written(tmp_path / "thing", parts)
    found = load_scene(scene(path, [("floor", "part")], shapes=[floor])).shapes[1]
    assert file.samefile(found.geometry.file)
