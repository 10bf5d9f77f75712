# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Links on which gravity does not act, and springs in joints, as each kind of file says them."""

from __future__ import annotations

import pytest

from formats.imports import Read, counts_in, refused, saved
from hapticmech_ros.formats import read_model

MASS = """<inertial><mass value="1"/><origin xyz="0.2 0 0"/>
<inertia ixx="1e-3" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>"""
URDF = f"""<robot name="r"><link name="beam">{MASS}</link><link name="weight">{MASS}</link>
<joint name="pivot" type="continuous"><parent link="world"/><child link="beam"/>
<axis xyz="0 1 0"/></joint><joint name="bolt" type="fixed"><parent link="beam"/>
<child link="weight"/><origin xyz="-0.4 0 0"/></joint>{{said}}</robot>"""
SDF = """<sdf version="1.9"><model name="m"><link name="beam"/><link name="weight">
{said}{mass}</link><joint name="pivot" type="revolute"><parent>world</parent><child>beam</child>
<axis><xyz>0 1 0</xyz></axis></joint><joint name="bolt" type="fixed"><parent>beam</parent>
<child>weight</child></joint></model></sdf>"""
SDF_MASS = "<inertial><mass>2</mass></inertial>"
MJCF = """<mujoco><worldbody><body name="beam"><joint name="pivot" axis="0 1 0"/>
<geom size="0.1"/><body name="weight" pos="-0.2 0 0" {said}><geom size="0.1"/>{more}</body></body>
</worldbody></mujoco>"""


def tag(inside, of="weight"):
    return f'<gazebo reference="{of}">{inside}</gazebo>'


def files():
    """Yield a name, the kind of a file, its text, and the fraction that is carried."""
    for written, carried in (("false", 1.0), (" 0 ", 1.0), ("true", 0.0), ("1", 0.0)):
        said = f"<gravity>{written}</gravity>"
        yield f"sdf {written}", "sdf", SDF.format(said=said, mass=SDF_MASS), carried
        yield f"urdf {written}", "urdf", URDF.format(said=tag(said)), carried
        off = f"<turnGravityOff>{written}</turnGravityOff>"
        yield f"urdf off {written}", "urdf", URDF.format(said=tag(off)), 1.0 - carried
    yield "default", "sdf", SDF.format(said="<gravity>false</gravity>", mass=""), 1.0
    yield "value", "urdf", URDF.format(said=tag('<turnGravityOff value="true"/>')), 1.0
    said = (
        tag("<gravity>0</gravity>")
        + tag("<mu1>1</mu1>")
        + tag("<turnGravityOff>false</turnGravityOff>")
    )
    yield "the last one", "urdf", URDF.format(said=said), 0.0
    for written, carried in (('gravcomp="1"', 1.0), ('gravcomp="0.25"', 0.25), ("", 0.0)):
        yield f"mjcf {written}", "xml", MJCF.format(said=written, more=""), carried
    hinges = '<joint name="x" axis="1 0 0"/><joint name="z" axis="0 0 1"/>'
    yield "mjcf, two joints", "xml", MJCF.format(said='gravcomp="1"', more=hinges), 1.0
    total = MJCF.replace("<worldbody>", '<compiler settotalmass="3"/><worldbody>')
    yield "mjcf, weighed", "xml", total.format(said='gravcomp="0.5"', more=""), 0.5


FILES = {name: rest for name, *rest in files()}


@pytest.mark.parametrize(("kind", "text", "carried"), FILES.values(), ids=FILES)
def test_a_link_is_carried_as_its_file_says(tmp_path, kind, text, carried):
    imported = read_model(saved(tmp_path, f"m.{kind}", text))
    found = {link["name"]: link.get("gravcomp") for link in imported.document["links"]}
    assert found.pop("weight") == (carried or None)
    assert not any(found.values())
    said = counts_in(imported)
    assert not {"gravity", "gravcomp"} & set(said)
    assert said.get("gazebo", 0) == text.count("<mu1>")


def test_a_link_that_is_part_of_the_world_has_nothing_to_carry(tmp_path):
    said = tag("<gravity>0</gravity>", "post") + f'<link name="post">{MASS}</link>'
    imported = read_model(saved(tmp_path, "m.urdf", URDF.format(said=said)))
    assert imported.places["post"][0] == "world"
    assert not any("gravcomp" in link for link in imported.document["links"])


BROKEN = {
    "sdf": (SDF.format(said="<gravity>off</gravity>", mass=""), "must be one of"),
    "urdf": (URDF.format(said=tag("<turnGravityOff>off</turnGravityOff>")), "must be one of"),
    "xml": (MJCF.format(said='gravcomp="off"', more=""), "bad format"),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_what_is_no_value_is_named_with_its_line(tmp_path, kind):
    text, rule = BROKEN[kind]
    refused(saved(tmp_path, f"m.{kind}", text), rule)


@pytest.mark.parametrize("rest", [None, 0.25])
def test_springs_of_joints_are_those_of_gazebos_tags(tmp_path, rest):
    reference = "" if rest is None else f"<springReference>{rest}</springReference>"
    said = tag(f"<springStiffness>3</springStiffness>{reference}", "pivot")
    said += tag("<provideFeedback>1</provideFeedback>", "pivot")
    ours = Read(saved(tmp_path, "m.urdf", URDF.format(said=said)))
    found = ours.written("pivot")
    assert (found.stiffness, found.rest) == (3.0, rest or 0.0)
    assert ours.notes == {"gazebo": 1}


def test_a_spring_in_no_hinge_or_slide_is_not_read(tmp_path):
    spring = "<springStiffness>3</springStiffness>"
    text = URDF.format(said=tag(spring, "bolt") + tag(spring, "gone"))
    assert Read(saved(tmp_path, "m.urdf", text)).notes == {"gazebo": 2}
