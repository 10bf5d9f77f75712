# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Meshes of strangers: read within limits, in a child, once."""

from __future__ import annotations

import os

import numpy as np
import pytest

from formats.meshes import TETRAHEDRON, TEXTS, stl
from hapticmech_ros.contact import hull as module
from hapticmech_ros.contact.hull import mesh_hulls, read_mesh
from hapticmech_ros.errors import SceneError
from hapticmech_ros.files.cage import Limits
from hapticmech_ros.scene.contacts import Mesh, Shape

ONE = (1.0, 1.0, 1.0)
KEY = "shapes[0].geometry.file"


@pytest.fixture(autouse=True)
def _forgotten(monkeypatch):
    monkeypatch.setattr(module, "_hulls", {})


def shapes(*files):
    return [
        Shape(name=f"s{k}", link="world", geometry=Mesh(kind="mesh", file=str(file), scale=ONE))
        for k, file in enumerate(files)
    ]


@pytest.fixture
def children(monkeypatch):
    """How many items each child was given."""
    given = []
    caged = module.caged

    def counted(work, items, limits):
        given.append(len(items))
        return caged(work, items, limits)

    monkeypatch.setattr(module, "caged", counted)
    return given


def test_one_child_reads_all_meshes_and_each_of_them_once(tmp_path, children):
    files = [stl(tmp_path / "a.stl", TETRAHEDRON), *(tmp_path / f"b.{kind}" for kind in TEXTS)]
    for file, text in zip(files[1:], TEXTS.values(), strict=True):
        file.write_text(text, encoding="utf-8")
    found = mesh_hulls(shapes(*files))
    assert children == [len(files)]
    for hull in found.values():
        assert np.array_equal(hull.vertices, np.unique(TETRAHEDRON, axis=0))
    mesh_hulls(shapes(*files, files[0]))
    assert children == [len(files)]
    stl(files[0], 2.0 * TETRAHEDRON)
    os.utime(files[0], ns=(1, 1))
    assert mesh_hulls(shapes(*files))[0].vertices.max() == 2.0
    assert children == [len(files), 1]


def test_what_a_child_cannot_bear_is_told_of_the_mesh_that_it_read(tmp_path, monkeypatch):
    """Of two meshes the second takes more than it may."""
    good, large = stl(tmp_path / "a.stl", TETRAHEDRON), tmp_path / "large.stl"
    count = 200_000
    large.write_bytes(bytes(80) + count.to_bytes(4, "little") + os.urandom(50 * count))
    limits = Limits(memory=40_000_000, seconds=5, output=100_000)
    monkeypatch.setattr(module, "Limits", lambda *_: limits)
    with pytest.raises(SceneError, match="cannot be read as a mesh") as caught:
        mesh_hulls(shapes(good, large))
    assert caught.value.problems[0].key_path == "shapes[1].geometry.file"
    assert "\n" not in caught.value.problems[0].rule


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('offset="0"', 'offset="4000000000"'),
        ('count="4">', 'count="4000000000">'),
        ('stride="3"', 'stride="4000000"'),
    ],
)
def test_a_token_that_asks_for_all_memory_is_refused(tmp_path, old, new):
    text = TEXTS["dae"]
    assert old in text
    path = tmp_path / "bad.dae"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(SceneError, match="cannot be read as a mesh"):
        read_mesh(str(path), ONE, KEY)


def test_vertices_that_are_not_finite_are_refused(tmp_path):
    path = stl(tmp_path / "a.stl", np.where(TETRAHEDRON == 1.0, np.nan, TETRAHEDRON))
    with pytest.raises(SceneError, match="mesh"):
        read_mesh(str(path), ONE, KEY)


@pytest.mark.parametrize("name", ["pipe.stl", "zero.stl", "gone.stl", "x" * 300])
def test_what_is_no_regular_file_is_not_opened(tmp_path, name):
    os.mkfifo(tmp_path / "pipe.stl")
    (tmp_path / "zero.stl").symlink_to("/dev/zero")
    with pytest.raises(SceneError, match=r"must be a regular file|cannot be read"):
        read_mesh(str(tmp_path / name), ONE, KEY)
