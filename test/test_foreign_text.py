# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Texts of strangers are taken apart in a child, and say there what they say here."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from formats.five_bars import mjcf, sdf, urdf
from hapticmech_ros import foreign_text, load_scene
from hapticmech_ros.errors import FileError, SceneError
from hapticmech_ros.foreign_text import parsed
from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.scene import document_of
from hapticmech_ros.xml_text import elements
from hapticmech_ros.yaml_text import document_in
from oracles.parsers import parser

FIVE_BAR = shipped_scenes()["five_bar"].read_text(encoding="utf-8")
GOOD = {
    "a.yaml": FIVE_BAR,
    "b.yaml": FIVE_BAR.replace("\n", " # größer, 機構 🙂\n", 1),
    "a.urdf": urdf(),
    "a.sdf": sdf(),
    "a.xml": mjcf(),
    "latin.urdf": '<?xml version="1.0" encoding="iso-8859-1"?>' + urdf(),
}
ATTRIBUTES = " ".join(f'a{k}="1"' for k in range(101))
BAD = {
    "empty.yaml": "",
    "list.yaml": "[1, 2]",
    "key.yaml": "format: hapticmech-scene/1\nhand: {1: 2}\n",
    "null.yaml": "~: 2\n",
    "twice.yaml": "a: 1\na: 2\n",
    "open.yaml": "a: [1,\n b: {",
    "infinite.yaml": f"{FIVE_BAR}\nextra: [.inf, .nan, {'9' * 300}]\n",
    "bomb.yaml": "a: &a [1, 1, 1, 1]\n"
    + "".join(
        f"{b}: &{b} [{', '.join(['*' + a] * 9)}]\n" for a, b in zip("abcdef", "bcdefg", strict=True)
    ),
    "cut.urdf": urdf()[:-30],
    "entity.urdf": '<!DOCTYPE r [<!ENTITY a "b">]><robot name="r"/>',
    "deep.xml": "<a>" * 300,
    "encoding.sdf": '<?xml version="1.0" encoding="nobodys"?><sdf/>',
    "attributes.urdf": f"<robot {ATTRIBUTES}/>",
    "root.xml": "<other/>",
}


def said(path: Path) -> object:
    """Return the scene in a file as plain values, or why it is refused."""
    try:
        return document_of(load_scene(path))
    except SceneError as error:
        return str(error)


@pytest.mark.parametrize("name", [*GOOD, *BAD])
def test_a_child_says_what_this_process_would(name, tmp_path, monkeypatch):
    path = tmp_path / name
    encoding = "latin-1" if name.startswith("latin") else "utf-8"
    path.write_text({**GOOD, **BAD}[name], encoding=encoding)
    asked = []
    caged = foreign_text.caged
    monkeypatch.setattr(foreign_text, "caged", lambda *given: asked.append(given) or caged(*given))
    there = said(path)
    assert asked
    monkeypatch.setattr(foreign_text, "is_own", lambda file: True)
    asked.clear()
    assert said(path) == there
    assert not asked
    assert isinstance(there, dict) == (name in GOOD)


def test_included_files_are_read_by_children_too_and_counted_together(tmp_path):
    geoms = '<geom size="1" contype="0"/>' * 100_000
    for name in "ab":
        text = f"<mujocoinclude>{geoms}</mujocoinclude>"
        (tmp_path / f"{name}.xml").write_text(text, encoding="utf-8")
    text = '<mujoco><worldbody><include file="a.xml"/><include file="b.xml"/></worldbody></mujoco>'
    (tmp_path / "main.xml").write_text(text, encoding="utf-8")
    with pytest.raises(SceneError, match=r"b\.xml(.|\n)*at most 200000 elements"):
        load_scene(tmp_path / "main.xml")


def test_the_packages_own_files_are_read_here(monkeypatch):
    def refuse(*given):
        raise AssertionError(given)

    monkeypatch.setattr(foreign_text, "caged", refuse)
    assert load_scene("five_bar").operational_points


def test_a_link_to_an_own_file_is_one_and_a_copy_is_none(tmp_path):
    own = shipped_scenes()["five_bar"]
    link, copy = tmp_path / "link.yaml", tmp_path / "copy.yaml"
    link.symlink_to(own)
    copy.write_bytes(own.read_bytes())
    assert foreign_text.is_own(own)
    assert foreign_text.is_own(link)
    assert not foreign_text.is_own(copy)
    assert not foreign_text.is_own(own.parent / ".." / ".." / "copy.yaml")


def test_a_parser_that_breaks_down_is_a_sentence_of_the_file(tmp_path):
    file = tmp_path / "a.yaml"
    assert parsed(parser, file, "pid") != os.getpid()
    assert parsed(parser, shipped_scenes()["five_bar"], "pid") == os.getpid()
    with pytest.raises(FileError, match=r"a\.yaml: .*its parser ends the process .*SIGSEGV"):
        parsed(parser, file, "segment")
    with pytest.raises(FileError, match="needs more than 512000000 bytes of memory"):
        parsed(parser, file, "memory")
    with pytest.raises(FileError) as caught:
        parsed(parser, file, "refuse")
    error = caught.value
    assert (error.file, error.where) == ("a.yaml", "line 3")
    assert (error.value, error.rule) == (["x", 1], "must be a number")


def test_the_largest_texts_fit_into_the_childs_limits(tmp_path):
    file = tmp_path / "a.urdf"
    node = f'<a b="{"ö" * 10}"/>'
    text = f"<r>{node * 199_999}</r>".encode().decode("latin-1")
    assert 5_000_000 < len(text) < 8_000_000
    found = parsed(elements, file, [str(file), text, 0, 0])
    assert len(found[4]) == 199_999
    written = tmp_path / "a.yaml"
    written.write_text("a: [" + "🙂🙂🙂🙂, " * 199_900 + "b]", encoding="utf-8")
    assert 3_500_000 < written.stat().st_size < 4_000_000
    assert len(parsed(document_in, written, str(written))["a"]) == 199_901
