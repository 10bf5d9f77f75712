# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Slides and universal joints in loops: the mechanism is the same wherever its loop is cut."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from formats.imports import Read, counts_in, refused, same_dynamics, saved
from formats.test_carried_by_nobody import felt
from formats.test_sdf import joint, link, written
from hapticmech_ros import load_scene
from hapticmech_ros.errors import SceneError
from hapticmech_ros.formats import read_model

SCENE = """format: hapticmech-scene/1
model: {file}
operational_points:
  - {{name: tip, link: {link}, origin: {{xyz: [0.05, 0.02, 0.01]}}}}
"""
MASS = """<inertial><pose>0.05 0.01 0 0 0 0</pose><mass>0.4</mass><inertia><ixx>8e-4</ixx>
<iyy>9e-4</iyy><izz>1e-3</izz></inertia></inertial>"""
DAMPED = "<dynamics><damping>0.1</damping></dynamics>"


def body(name, place, mass=MASS):
    return f'<link name="{name}"><pose>{place}</pose>{mass}</link>'


def pin_of(name, a, b, place="0 0 0 0 0 0", kind="revolute", axis="0 0 1", inside=""):
    return f"""<joint name="{name}" type="{kind}"><pose>{place}</pose><parent>{a}</parent>
<child>{b}</child><axis><xyz>{axis}</xyz>{inside}</axis></joint>"""


def scene_of(folder, name, parts, held):
    """Return a scene of an SDF model of these parts."""
    text = f'<sdf version="1.9"><model name="m">{"".join(parts)}</model></sdf>'
    file = saved(folder, f"{name}.sdf", text)
    return file, saved(folder, f"{name}.yaml", SCENE.format(file=file.name, link=held))


def assert_alike(one, other, mobility):
    (x, first), (y, second) = felt(one), felt(other)
    assert (first, second) == (mobility, mobility)
    assert np.abs(x).max() > 0.1
    np.testing.assert_allclose(y, x, atol=1e-9 * np.abs(x).max())


BARS = [
    body("crank", "0 0 0 0 0 1.2"),
    body("rod", "0.06 0.1 0 0 0 -0.5"),
    body("block", "0.3 0 0 0 0 0"),
]
SLIDE = pin_of("slide", "world", "block", kind="prismatic", axis="1 0 0")
PINS = [
    pin_of("A", "world", "crank"),
    pin_of("B", "crank", "rod"),
    pin_of("C", "rod", "block", "0 0 0 0 0 0"),
]


@pytest.mark.parametrize("turned", [False, True])
def test_a_slider_crank_is_the_same_whichever_joint_comes_last(tmp_path, turned):
    """In both the slide is carried; turned, the slide says that the block carries the world."""
    slide = SLIDE
    if turned:
        ground = body("ground", "0 0 0 0 0 0") + pin_of("bolt", "world", "ground", kind="fixed")
        slide = ground + pin_of("slide", "block", "ground", kind="prismatic", axis="1 0 0")
    usual = scene_of(tmp_path, "usual", [*BARS, SLIDE, *PINS], "rod")[1]
    file, other = scene_of(tmp_path, "other", [*BARS, *PINS, slide], "rod")
    assert_alike(usual, other, 1)
    joints = [one["joint"]["type"] for one in read_model(file).document["links"]]
    assert joints.count("prismatic") == 1


def cylinder(first, damped=()):
    """Return an inverted slider-crank, whose slide comes first or last."""
    pins = [
        *(("A", "world", "crank"), ("B", "crank", "rod"), ("D", "world", "cylinder")),
    ]
    parts = [
        body("crank", "0 0 0 0 0 1.2"),
        body("rod", "0.06 0.1 0 0 0 0.3"),
        body("cylinder", "0.4 0 0 0 0 0.3"),
    ]
    joints = [pin_of(name, a, b, inside=DAMPED if name in damped else "") for name, a, b in pins]
    slide = pin_of("slide", "cylinder", "rod", kind="prismatic", axis="1 0 0")
    return [*parts, *((slide, *joints[::-1]) if first else (*joints, slide))]


@pytest.mark.parametrize(
    ("damped", "cut"), [((), "B"), (("B",), "D"), (("B", "D"), "A"), (("A", "D"), "B")]
)
def test_the_joint_that_is_cut_is_a_bare_one_if_there_is_one(tmp_path, damped, cut):
    """Those between it and the slide are turned around, and still damped."""
    usual = scene_of(tmp_path, "usual", cylinder(first=True), "rod")[1]
    file, other = scene_of(tmp_path, "other", cylinder(first=False, damped=damped), "rod")
    assert_alike(usual, other, 1)
    read = read_model(file)
    (closure,) = read.document["closures"]
    assert closure["name"] == cut
    found = {one["joint"]["name"]: one["joint"].get("damping") for one in read.document["links"]}
    assert {name for name, value in found.items() if value} == set(damped)
    assert not counts_in(read)


def test_a_slide_that_closes_a_loop_in_urdf(tmp_path):
    arm = """<link name="{0}"><inertial><origin xyz="0.05 0 0"/><mass value="0.3"/>
<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{1}" type="{2}"><parent link="{3}"/><child link="{0}"/><origin xyz="{4}"/>
<axis xyz="{5}"/></joint>"""
    again = """<joint name="slide" type="prismatic"><parent link="world"/><child link="rod"/>
<origin xyz="0.2 0 0"/><axis xyz="1 0 0"/><limit lower="-1" upper="1"/></joint>"""
    parts = [
        arm.format("crank", "A", "continuous", "world", "0 0 0", "0 0 1"),
        arm.format("rod", "B", "continuous", "crank", "0.2 0 0", "0 0 1"),
    ]
    text = f'<robot name="r">{"".join(parts)}{again}</robot>'
    scene = load_scene(str(saved(tmp_path, "m.urdf", text)))
    assert [(one.name, one.kind) for one in scene.closures] == [("B", "revolute")]
    assert {one.joint.name: one.joint.limits is not None for one in scene.links}["slide"]


def test_a_loop_of_slides_alone_is_refused_with_the_way_out(tmp_path):
    wedge = [body("a", "0 0 0 0 0 0"), body("b", "0 0 0 0 0 0")]
    slides = [
        pin_of(name, a, b, kind="prismatic", axis=axis)
        for name, a, b, axis in (
            ("x", "world", "a", "1 0 0"),
            ("y", "world", "b", "0 1 0"),
            ("z", "a", "b", "1 1 0"),
        )
    ]
    file, _ = scene_of(tmp_path, "wedge", [*wedge, *slides], "a")
    with pytest.raises(SceneError, match="in two, joined by a fixed joint"):
        read_model(file)
    # As it says.
    parts = [*wedge, body("b2", "0 0 0 0 0 0"), *slides, pin_of("w", "b", "b2", kind="fixed")]
    parts[5] = parts[5].replace("<child>b<", "<child>b2<")
    assert felt(scene_of(tmp_path, "two", parts, "a")[1])[1] == 1


UNIVERSAL = """<joint name="u" type="{kind}"><pose>{place}</pose><parent>{a}</parent>
<child>{b}</child><axis><xyz>1 0 0</xyz>{inside}</axis><axis2><xyz>{second}</xyz>{inside}</axis2>
</joint>"""


@pytest.mark.parametrize("kind", ["universal", "revolute2"])
def test_a_universal_joint_is_two_hinges(tmp_path, kind):
    place, second = "0.1 0.2 0.3 0.4 0.5 0.6", "0.2 0.9 -0.1"
    inside = f"{DAMPED}<limit><lower>-1</lower><upper>2</upper></limit>"
    base = [link("base"), joint("j", "world", "base")]
    given = UNIVERSAL.format(
        kind=kind, place=place, a="base", b="arm", second=second, inside=inside
    )
    ours = Read(written(tmp_path, [*base, link("arm"), given]))
    for name in ("u", "u_axis2"):
        found = ours.written(name)
        assert (found.type, found.damping, found.limits.lower) == ("revolute", 0.1, -1.0)
    theirs, at = pin.Model(), pin.SE3(pin.rpy.rpyToMatrix(0.4, 0.5, 0.6), np.array((0.1, 0.2, 0.3)))
    axes = [
        np.array(a) / np.linalg.norm(a) for a in ((1.0, 2.0, 3.0), (1.0, 0, 0), (0.2, 0.9, -0.1))
    ]
    inertia = pin.Inertia(
        1.5, np.zeros(3), np.array([[1.0, 0.1, 0.05], [0.1, 1.2, 0.02], [0.05, 0.02, 1.3]])
    ).se3Action(pin.SE3(pin.rpy.rpyToMatrix(0.4, 0.5, 0.6), np.array((0.3, 0.2, -0.1))))
    for k, place_of in enumerate((pin.SE3.Identity(), at, pin.SE3.Identity())):
        theirs.addJoint(k, pin.JointModelRevoluteUnaligned(axes[k]), place_of, "")
    theirs.appendBodyToJoint(1, inertia, pin.SE3.Identity())
    theirs.appendBodyToJoint(3, inertia, at.inverse())
    assert len(list(same_dynamics(ours, theirs, 1e-12))) == 3


@pytest.mark.parametrize("second", ["0 1 0", "0.3 1 0.2"])
def test_a_universal_joint_may_close_a_loop(tmp_path, second):
    """One row less than a ball leaves free; with the ball cut instead it moves alike."""
    bodies = [
        body("a", "0 0 0 0 0 0.3"),
        body("b", "0.2 0.1 0 0.1 0 0"),
        body("c", "0.5 0 0 0 0 2"),
    ]
    ball = '<joint name="s" type="ball"><parent>a</parent><child>b</child></joint>'
    cross = UNIVERSAL.format(
        kind="universal", place="0.2 0.1 0.05 0.1 0.2 0.3", a="c", b="b", second=second, inside=""
    )
    a, c = pin_of("ja", "world", "a"), pin_of("jc", "world", "c", axis="0 0.3 1")
    carried = scene_of(tmp_path, "carried", [*bodies, c, a, ball, cross], "b")
    closing = scene_of(tmp_path, "closing", [*bodies, a, c, ball, cross], "b")
    kinds = [[one.kind for one in load_scene(str(path)).closures] for _, path in (carried, closing)]
    assert kinds == [["spherical"], ["spherical", "rod"]]
    assert_alike(carried[1], closing[1], 1)
    stops = cross.replace("</xyz>", "</xyz><limit><lower>-1</lower><upper>1</upper></limit>")
    file, _ = scene_of(tmp_path, "stops", [*bodies, a, c, ball, stops], "b")
    assert counts_in(read_model(file)) == {"forces in joints that close loops": 2}


BROKEN = {
    "one axis": (joint("u", "world", "a", kind="universal"), "needs an <axis2>"),
    "name": (
        link("u_cross")
        + UNIVERSAL.format(
            kind="universal", place="0 0 0 0 0 0", a="world", b="a", second="0 1 0", inside=""
        ),
        "rename u_cross",
    ),
}


@pytest.mark.parametrize(("part", "rule"), BROKEN.values(), ids=BROKEN)
def test_errors_of_universal_joints(tmp_path, part, rule):
    refused(written(tmp_path, [link("a"), part]), rule)
