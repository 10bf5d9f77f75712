# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Joints that do not move and are asked for, couplings without travel, files without any mass."""

from __future__ import annotations

import re

import pytest

from commands import ran
from formats.imports import saved
from formats.test_sdf import joint, link, written
from hapticmech_ros import Simulator, load_scene
from hapticmech_ros.errors import HapticMechError, SceneError
from hapticmech_ros.formats import read_model

HEAD = "format: hapticmech-scene/1\n"
MASS = """<inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>"""
FILE = """<robot name="r"><link name="base"/><link name="a">{mass}</link>
<link name="b">{mass}</link><link name="c">{mass}</link>
<joint name="i" type="{kind}"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="{lower}" upper="{upper}"/></joint>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.2 0 0"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1"/>{mimic}</joint>
<joint name="k" type="continuous"><parent link="b"/><child link="c"/><axis xyz="1 0 0"/></joint>
{tail}</robot>"""
MIMIC = '<mimic joint="i" multiplier="-2" offset="0.5"/>'
LOOP = '<joint name="l" type="fixed"><parent link="b"/><child link="c"/></joint>'


def urdf(folder, kind="revolute", stops=(-1, 1), mimic="", mass=MASS, tail=""):
    lower, upper = stops
    given = {"kind": kind, "lower": lower, "upper": upper, "mimic": mimic, "tail": tail}
    return saved(folder, "model.urdf", FILE.format(mass=mass, **given))


def scene(folder, said):
    return saved(folder, "scene.yaml", HEAD + said)


@pytest.mark.parametrize(("stops", "none"), [((-1, -0.25), True), ((-1, -0.2), False)])
def test_a_coupling_whose_stops_leave_no_travel_is_said_first(tmp_path, stops, none):
    """j is in [-1, 1], and -2 i + 0.5 in [1, 2.5] or a little more."""
    first = read_model(urdf(tmp_path, stops=stops, mimic=MIMIC)).notes
    said = [note for note in first if "leave no travel" in note.what]
    assert bool(said) == none
    if none:
        assert said == [first[0]]
        assert "those of j are at -1 and 1" in said[0].why
        assert "i have it at 1 and 2.5" in said[0].why


def test_so_is_one_of_sdf(tmp_path):
    stop = "</xyz><limit><lower>{}</lower><upper>{}</upper></limit>"
    inside = '<mimic joint="i"><multiplier>1</multiplier></mimic>'
    parts = [
        *(link("a"), link("b")),
        joint("i", "world", "a").replace("</xyz>", stop.format(0.5, 1)),
        joint("j", "a", "b").replace("</xyz>", stop.format(-1, 0.25) + inside),
    ]
    assert "stops leave no travel" in read_model(written(tmp_path, parts)).notes[0].what


def test_a_locked_joint_that_is_coupled_is_named_and_how_to_free_it(tmp_path):
    path = urdf(tmp_path, stops=(0.25, 0.25), mimic=MIMIC)
    with pytest.raises(SceneError, match=r"joint 'i' is locked, at line 6, <joint>") as caught:
        load_scene(path)
    hint = re.search(r"joints: (\{i: .*?\}\})", str(caught.value))[1]
    freed = load_scene(scene(tmp_path, f"model: {{file: model.urdf, joints: {hint}}}\n"))
    assert not freed.links[0].joint.locked


@pytest.mark.parametrize(
    ("said", "kind", "tail", "why"),
    [
        ("initial_state: {q: {i: 0.1}}", "fixed", "", "'i' is fixed to the world"),
        ("couplings: [{name: c, joint: j, leader: i}]", "fixed", "", "'i' is fixed to the world"),
        ("initial_state: {v: {l: 0.1}}", "revolute", LOOP, "'l' closes a loop"),
        ("initial_state: {v: {i: 0.1}}", "locked", "", "initial_state.v.i: a locked joint"),
        ("model: {file: model.urdf, joints: {l: {damping: 1.0}}}", "revolute", LOOP, "'l' closes"),
    ],
)
def test_a_joint_that_cannot_be_asked_for_is_named(tmp_path, said, kind, tail, why):
    stops = (0, 0) if kind == "locked" else (-1, 1)
    urdf(tmp_path, "revolute" if kind == "locked" else kind, stops, tail=tail)
    model = "" if said.startswith("model") else "model: model.urdf\n"
    with pytest.raises(SceneError, match=re.escape(why)):
        load_scene(scene(tmp_path, f"{model}{said}\n"))


def test_a_mimic_of_a_joint_that_closes_a_loop_says_so(tmp_path):
    tail = LOOP.replace('"fixed"', '"revolute"').replace("<parent", '<axis xyz="0 0 1"/><parent')
    path = urdf(tmp_path, mimic='<mimic joint="l"/>', tail=tail)
    with pytest.raises(SceneError, match="joint 'l' closes a loop: it has no coordinate"):
        read_model(path)


def test_a_file_without_any_mass_says_just_that_and_is_drawn(tmp_path):
    path = urdf(tmp_path, mass="")
    with pytest.raises(HapticMechError, match=r"^no link has a mass: give the links") as caught:
        Simulator(load_scene(path))
    assert "joint" not in str(caught.value)
    picture = tmp_path / "picture.png"
    ran("scene", "show", path, "--out", picture)
    assert picture.read_bytes().startswith(b"\x89PNG")
    # With one mass at its end only what moves none is named, as before.
    path.write_text(
        path.read_text().replace('<link name="a"></link>', f'<link name="a">{MASS}</link>')
    )
    with pytest.raises(HapticMechError, match="joint 'j' moves no mass"):
        Simulator(load_scene(path))


@pytest.mark.parametrize("text", ['<? xml version="1.0"?>', "\n <?  xml version='1.0'?>"])
def test_a_declaration_with_a_blank_before_xml_is_said(tmp_path, text):
    path = urdf(tmp_path)
    path.write_text(text + path.read_text())
    with pytest.raises(SceneError, match="without a blank before xml") as caught:
        load_scene(path)
    assert len(caught.value.problems) == 1
