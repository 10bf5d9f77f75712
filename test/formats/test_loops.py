# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Loops in the tags of Gazebo and Drake: closed as by a joint of SDF, or said to be open first."""

from __future__ import annotations

import re

import numpy as np
import pinocchio as pin
import pytest
import yaml

from formats.imports import Read, notes_in, refused, saved
from formats.test_carried_by_nobody import JOINT, LINK, SCENE, felt, four_bar
from hapticmech_ros import Mechanism, load_scene
from hapticmech_ros.formats.reading import read_model

# The same bars as in four_bar().
BARS = {
    "crank": ("0 0.05 0", 0.2),
    "rocker": ("-0.06 0.08 0", 0.25),
    "coupler": ("0.12 0.03 0", 0.3),
}
BODY = """<link name="{}"><inertial><origin xyz="{}"/><mass value="{}"/>
<inertia ixx="8e-4" iyy="8e-4" izz="9e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
PIN = """<joint name="{}" type="continuous"><parent link="{}"/><child link="{}"/>
<origin xyz="{}"/><axis xyz="0 0 1"/></joint>"""
TREE = (
    "".join(BODY.format(name, *bar) for name, bar in BARS.items())
    + PIN.format("A", "world", "crank", "0 0 0")
    + PIN.format("D", "world", "rocker", "0.36 0 0")
    + PIN.format("B", "crank", "coupler", "0 0.1 0")
)
GAZEBO = """<gazebo><joint name="C" type="revolute"><parent>{a}</parent><child>{b}</child>{pose}
<axis><xyz>0 0 1</xyz></axis></joint></gazebo>"""
BALL_SDF = """<drake:ball_constraint>
<drake:ball_constraint_body_A>{a}</drake:ball_constraint_body_A>
<drake:ball_constraint_body_B>rocker</drake:ball_constraint_body_B>
<drake:ball_constraint_p_AP>0.24 0.07 0</drake:ball_constraint_p_AP>
<drake:ball_constraint_p_BQ>-0.12 0.17 0</drake:ball_constraint_p_BQ></drake:ball_constraint>"""
BALL_URDF = re.sub(r"<(drake:ball_constraint_body_.)>(.*?)</\1>", r'<\1 name="\2"/>', BALL_SDF)
BALL_URDF = re.sub(r"<(drake:ball_constraint_p_..)>(.*?)</\1>", r'<\1 value="\2"/>', BALL_URDF)


def urdf(folder, loop, name="loop"):
    """Return the four-bar in URDF with its last pin in other words, and a scene beside it."""
    text = f'<robot name="r" xmlns:drake="http://drake.mit.edu">{TREE}{loop}</robot>'
    file = saved(folder, f"{name}.urdf", text)
    return file, saved(folder, f"{name}.yaml", SCENE.format(file=file.name))


def sdf(folder, loop):
    file, scene = four_bar(folder, {"B": ("crank", "coupler")})
    text = file.read_text().replace('<sdf version="1.7">', '<sdf version="1.7" xmlns:drake="d">')
    file.write_text(text.replace("</model>", f"{loop}</model>"))
    return file, scene


@pytest.fixture
def usual(tmp_path):
    return felt(four_bar(tmp_path, {"B": ("crank", "coupler"), "C": ("coupler", "rocker")})[1])


LOOPS = {
    "gazebo": (
        urdf,
        GAZEBO.format(a="coupler", b="rocker", pose="<pose>-0.12 0.17 0 0 0 0</pose>"),
    ),
    "gazebo, the other way": (
        *(urdf, GAZEBO.format(a="rocker", b="coupler", pose="<pose>0.24 0.07 0 0 0 0</pose>")),
    ),
    "gazebo, in another frame": (
        urdf,
        GAZEBO.format(
            *(),
            a="coupler",
            b="rocker",
            pose='<pose relative_to="coupler">0.24 0.07 0 0 0 1</pose>',
        ),
    ),
    "drake, urdf": (urdf, BALL_URDF.format(a="coupler")),
    "drake, sdf": (sdf, BALL_SDF.format(a="coupler")),
}


@pytest.mark.parametrize(("write", "loop"), LOOPS.values(), ids=LOOPS)
def test_a_loop_is_felt_as_that_of_a_joint(tmp_path, usual, write, loop):
    file, scene = write(tmp_path, loop)
    ours, mobility = felt(scene)
    assert (mobility, usual[1]) == (1, 1)
    np.testing.assert_allclose(ours, usual[0], atol=1e-9 * np.abs(usual[0]).max())
    assert not any(
        "gazebo" in note.what or "drake" in note.what for note in notes_in(read_model(file))
    )


def test_a_gazebo_joint_holds_a_root_and_turns_what_is_below_it(tmp_path):
    """To the world the root itself; from a tip to the root it is a loop, which no circle is."""
    fixed = '<joint name="w" type="fixed"><parent>world</parent><child>root</child></joint>'
    world = f"<gazebo>{fixed}</gazebo>"
    back = GAZEBO.format(a="c", b="root", pose="<pose>0.3 0.2 0.1 0.4 0 0</pose>")
    parts = ["".join(BODY.format(name, "0.1 0 0", 1.0) for name in ("root", "a", "b", "c"))]
    parts += [PIN.format(f"j{b}", a, b, "0.1 0 0") for a, b in ("ra", "ab", "bc")]
    text = "".join(parts).replace('link="r"', 'link="root"')
    for gazebo, loops in ((world, 0), (back, 1), (world + back, 1)):
        ours = Read(saved(tmp_path, "m.urdf", f'<robot name="r">{text}{gazebo}</robot>'))
        assert [one.kind for one in ours.scene.closures] == ["revolute"] * loops
        mechanism = Mechanism(ours.scene)
        assert mechanism.nv == 3
        closing = mechanism.closing_terms(pin.neutral(ours.model), mechanism.initially_active)
        assert not loops or closing.error < 1e-12


OPEN = {
    "bushing": (
        *(sdf, "<drake:linear_bushing_rpy><drake:bushing_frameA>coupler</drake:bushing_frameA>"),
        "<drake:bushing_frameC>rocker</drake:bushing_frameC><drake:bushing_torque_stiffness>9 9 0"
        "</drake:bushing_torque_stiffness></drake:linear_bushing_rpy>",
        ("revolute", None, None),
    ),
    "constraint": (
        *(urdf, '<constraint name="C" type="ball"><link1 link="coupler" xyz="0.24 0.07 0"/>'),
        '<link2 link="rocker" xyz="-0.12 0.17 0"/></constraint>',
        ("spherical", [0.24, 0.07, 0], [-0.12, 0.17, 0]),
    ),
    "loop joint": (
        *(urdf, '<loop_joint name="C" type="continuous"><link1 link="coupler" xyz="0.24 0.07 0"/>'),
        '<link2 link="rocker" xyz="-0.12 0.17 0"/><axis xyz="0 0 1"/></loop_joint>',
        ("revolute", [0.24, 0.07, 0], [-0.12, 0.17, 0]),
    ),
    "plugin": (
        *(urdf, '<gazebo><plugin name="C" filename="libattacher.so"><parent>coupler</parent>'),
        "<child>rocker</child></plugin></gazebo>",
        ("weld", None, None),
    ),
}


@pytest.mark.parametrize(("write", "begin", "end", "closure"), OPEN.values(), ids=OPEN)
def test_a_loop_that_is_not_read_is_named_first_and_how_to_close_it(
    tmp_path, usual, write, begin, end, closure
):
    file, scene = write(tmp_path, begin + end + ("<odd/>" * 3))
    first, *others = notes_in(read_model(file))
    assert first.what.startswith("loop left open: ")
    assert first.what.endswith("between coupler and rocker")
    assert not any(one.what == "gazebo" for one in others)
    written = first.why[first.why.index("closures:") :]
    (found,) = yaml.safe_load(written)["closures"]
    kind, *places = closure
    assert (found["kind"], found["a"]["link"], found["b"]["link"]) == (kind, "coupler", "rocker")
    assert [found[side].get("origin", {}).get("xyz") for side in "ab"] == places
    # What is to be said closes it, where the file has the numbers.
    scene.write_text(f"{scene.read_text()}{written}\n")
    assert len(load_scene(str(scene)).closures) == 1
    if places[0] is not None:
        ours, mobility = felt(scene)
        assert mobility == 1
        np.testing.assert_allclose(ours, usual[0], atol=1e-9 * np.abs(usual[0]).max())


def test_a_gazebo_joint_to_another_file_is_a_loop_left_open(tmp_path):
    loop = GAZEBO.format(a="coupler", b="other::link", pose="")
    first = read_model(urdf(tmp_path, loop)[0]).notes[0]
    assert first.what == "loop left open: C"
    assert "coupler and other::link" in first.why


BAD = {
    "link": (sdf, BALL_SDF.format(a="couple"), "did you mean 'coupler'"),
    "point": (sdf, BALL_SDF.format(a="coupler").replace("0.24 0.07 0", "0.24"), "must be 3"),
    "missing": (sdf, "<drake:ball_constraint/>", "needs <drake:ball_constraint_body_A>"),
    "twice": (urdf, GAZEBO.format(a="coupler", b="rocker", pose="") * 2, "must be unique"),
    "as in URDF": (
        urdf,
        GAZEBO.format(a="coupler", b="rocker", pose="").replace('"C"', '"B"'),
        "must be unique",
    ),
    "axis": (
        urdf,
        GAZEBO.format(a="coupler", b="rocker", pose="").replace("0 0 1", "0 0 0"),
        "must not be zero",
    ),
}


@pytest.mark.parametrize(("write", "loop", "rule"), BAD.values(), ids=BAD)
def test_what_breaks_a_rule_is_named_with_its_line(tmp_path, write, loop, rule):
    refused(write(tmp_path, loop)[0], rule)


def test_in_a_nested_model_links_of_a_ball_constraint_are_those_of_the_model(tmp_path):
    parts = [
        LINK.format(name=name, place="0 0 0 0 0 0", com="0 0 0 0 0 0", mass=1.0)
        for name in ("coupler", "rocker")
    ]
    pins = [
        JOINT.format(name=n, place="0 0 0 0 0 0", a="world", b=n2)
        for n, n2 in (("i", "coupler"), ("j", "rocker"))
    ]
    inner = "".join([*parts, *pins, BALL_SDF.format(a="coupler")])
    models = f'<model name="m"><model name="n">{inner}</model></model>'
    path = saved(tmp_path, "m.sdf", f'<sdf version="1.9" xmlns:drake="d">{models}</sdf>')
    (closure,) = read_model(path).document["closures"]
    assert (closure["a"]["link"], closure["b"]["link"]) == ("n__coupler", "n__rocker")
