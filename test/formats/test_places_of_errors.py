# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Errors of files name file, line and element, and names that are near those that are not there."""

from __future__ import annotations

import re

import pytest

from formats.imports import beside, saved
from hapticmech_ros import load_scene
from hapticmech_ros.errors import SceneError

LINK = (
    '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0"'
    ' iyz="0"/></inertial></link>\n'
)
JOINT = '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/>{}</joint>\n'
GEOM = '<geom size=".1" pos=".1 0 0"/>'
BODY = f'<body name="{{}}"><joint name="{{}}"/>{GEOM}</body>\n'
SDF_JOINT = (
    '<joint name="{}" type="{}"><parent>{}</parent><child>{}</child><axis><xyz>0 0 1</xyz>{}</axis>'
    "</joint>\n"
)


def urdf(*parts):
    return f'<robot name="r">\n{"".join(parts)}</robot>'


def mjcf(bodies, rest=""):
    return f"<mujoco><worldbody>\n{bodies}</worldbody>\n{rest}</mujoco>"


def sdf(*parts):
    names = "".join(f'<link name="{name}"/>\n' for name in "ab")
    return f'<sdf version="1.9"><model name="m">\n{names}{"".join(parts)}</model></sdf>'


A, B = LINK.format("base"), LINK.format("arm")
HINGE = JOINT.format("elbow", "revolute", "base", "arm", "")
MIMIC = '<mimic joint="{}"/>'
BROKEN = {
    "link twice": ("urdf", urdf(A, B, A, HINGE), 4, "link", "unique: line 2, <link> has it too"),
    "joint twice": (
        *("urdf", urdf(A, B, LINK.format("c"), HINGE, HINGE.replace("arm", "c")), 6, "joint"),
        "unique: line 5, <joint> has it too",
    ),
    "no link": ("urdf", urdf(A, B, HINGE.replace("base", "bse")), 4, "joint", "mean 'base'?"),
    "circle": (
        *("urdf", urdf(A, B, HINGE, JOINT.format("k", "revolute", "arm", "base", "")), 3, "link"),
        "in a circle",
    ),
    "world": (
        *("urdf", urdf(A, B, HINGE, JOINT.format("k", "revolute", "arm", "world", "")), 5, "joint"),
        "carries the world",
    ),
    "mimic": (
        *("urdf", urdf(A, B, HINGE.replace("</joint>", f"{MIMIC.format('elbw')}</joint>"))),
        *(4, "joint", "no such joint; did you mean 'elbow'?"),
    ),
    "mimics itself": (
        *("urdf", urdf(A, B, HINGE.replace("</joint>", f"{MIMIC.format('elbow')}</joint>"))),
        *(4, "mimic", "not itself"),
    ),
    "mass": (
        "urdf",
        urdf(A, B.replace('"1"', '"-1"', 1), HINGE),
        3,
        "link",
        "link arm.inertial.mass",
    ),
    "damping": (
        *("urdf", urdf(A, B, HINGE.replace("</joint>", '<dynamics damping="-1"/></joint>'))),
        *(4, "joint", "joint elbow.damping"),
    ),
    "body twice": (
        *("xml", mjcf(BODY.format("a", "j") + BODY.format("a", "k")), 3, "body"),
        "line 2, <body> has it too",
    ),
    "MJCF joint twice": (
        *("xml", mjcf(BODY.format("a", "j") + BODY.format("b", "j")), 3, "joint"),
        "line 2, <joint> has it too",
    ),
    "no body": (
        *(
            "xml",
            mjcf(
                BODY.format("arm", "j") + BODY.format("hand", "k"),
                '<equality><weld body1="arm" body2="hnd"/></equality>',
            ),
        ),
        *(5, "weld", "did you mean 'hand'?"),
    ),
    "MJCF damping": (
        *("xml", mjcf(BODY.format("a", "j").replace('"j"', '"j" damping="-1"')), 2, "joint"),
        "joint j.damping",
    ),
    "SDF twice": (
        *(
            "sdf",
            sdf(
                SDF_JOINT.format("j", "revolute", "world", "a", ""),
                SDF_JOINT.format("j", "revolute", "a", "b", ""),
            ),
        ),
        *(5, "joint", "line 4, <joint> has it too"),
    ),
    "SDF mimic": (
        *(
            "sdf",
            sdf(
                SDF_JOINT.format(
                    "elbow",
                    "revolute",
                    "world",
                    "a",
                    '<mimic joint="elbo"><multiplier>1</multiplier></mimic>',
                )
            ),
        ),
        *(4, "joint", "did you mean 'elbow'?"),
    ),
    "SDF loop": (
        *(
            "sdf",
            sdf(
                SDF_JOINT.format("j", "revolute", "world", "a", ""),
                SDF_JOINT.format("k", "prismatic", "a", "b", ""),
                SDF_JOINT.format("l", "prismatic", "a", "b", ""),
            ),
        ),
        *(6, "joint", "only these types can"),
    ),
}


@pytest.mark.parametrize("load", [load_scene, beside], ids=["model", "scene beside it"])
@pytest.mark.parametrize(("suffix", "text", "line", "tag", "said"), BROKEN.values(), ids=BROKEN)
def test_errors_name_file_line_and_element(tmp_path, suffix, text, line, tag, said, load):
    with pytest.raises(SceneError, match=re.escape(said)) as caught:
        load(saved(tmp_path, f"model.{suffix}", text))
    first = str(caught.value)
    assert f"model.{suffix}" in first
    assert f"line {line}, <{tag}>" in first, first


NEAR = [
    ("operational_points: [{name: p, link: hadn}]", "hand"),
    ("closures: [{name: c, kind: spherical, a: {link: hnd}, b: {link: world}}]", "hand"),
    ("springs: [{name: c, a: {link: arn}, b: {link: world}}]", "arm"),
    ("shapes: [{name: b, link: hanf, geometry: {kind: sphere, radius: 1.0}}]", "hand"),
    ("couplings: [{name: c, joint: elbw, leader: shoulder}]", "elbow"),
    ("couplings: [{name: c, joint: elbow, leader: sholder}]", "shoulder"),
    ("initial_state: {q: {sholder: 1.0}}", "shoulder"),
    ("initial_state: {v: {elbo: 1.0}}", "elbow"),
]


@pytest.mark.parametrize(
    ("said", "model", "meant"),
    [
        *((said, "", meant) for said, meant in NEAR),
        ("", "{file: model.urdf, joints: {elbwo: {damping: 1.0}}}", "elbow"),
    ],
)
def test_names_of_the_scene_that_are_not_there(tmp_path, said, model, meant):
    joints = JOINT.format("shoulder", "revolute", "base", "arm", "")
    joints += JOINT.format("elbow", "revolute", "arm", "hand", "")
    path = saved(tmp_path, "model.urdf", urdf(A, B, LINK.format("hand"), joints))
    with pytest.raises(SceneError, match=f"did you mean {meant!r}"):
        beside(path, said, model)
