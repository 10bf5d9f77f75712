# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files that are no mechanism: each is refused by a rule, in bounded memory and without a crash."""

from __future__ import annotations

import os
import re

import pytest

from formats.children import outcomes
from formats.five_bars import mjcf, sdf, urdf, written
from formats.imports import beside
from hapticmech_ros import load_scene
from hapticmech_ros.errors import SceneError
from hapticmech_ros.formats import read_model
from sampling import sampled

LINK = '<link name="{}"/>'
HINGE = '<joint name="{0}{1}" type="fixed"><parent link="{0}"/><child link="{1}"/></joint>'
SDF_LINK = '<link name="{}"/>'
SDF_HINGE = '<joint name="{0}_{1}" type="fixed"><parent>{0}</parent><child>{1}</child></joint>'


def robot(parts):
    return f'<robot name="r">{"".join(parts)}</robot>'


def model(parts):
    return f'<sdf version="1.9"><model name="m">{"".join(parts)}</model></sdf>'


def world(parts):
    return f"<mujoco><worldbody>{''.join(parts)}</worldbody></mujoco>"


def huge_files():
    """Yield suffix, text, and words of the rule that refuses it."""
    many = range(10_000)
    links, own = [LINK.format(k) for k in many], "at most 1000 elements <link>"
    yield "urdf", robot(links + [HINGE.format(k, k + 1) for k in many[:-1]]), own
    yield "urdf", robot(links + [HINGE.format(0, k) for k in many[1:]]), own
    yield "sdf", model(links + [SDF_HINGE.format(k, k + 1) for k in many[:-1]]), own
    yield "xml", world(["<body><joint/></body>"] * 10_000), "at most 1000 elements <body>"
    yield "xml", world(["<body>"] * 1000 + ["</body>"] * 1000), "elements in each other"
    yield "urdf", "<a>" * 100_000, "elements in each other"
    yield "urdf", robot(["<visual/>"] * 200_001), "at most 200000 elements"
    yield "urdf", f'<robot name="{"x" * 9_000_000}"/>', "at most 8000000 bytes"
    yield "urdf", f'<robot name="{"x" * 7_900_000}"/>', "there must be one at least"
    attributes = " ".join(f'a{k}=""' for k in range(200_000))
    yield "urdf", f"<robot {attributes}/>", "at most 100 attributes"
    yield "sdf", model([f'<link name="a"><pose>{"0 " * 3_900_000}</pose></link>']), "must be 6"
    yield "sdf", model([f'<link name="a">{"x&#10;" * 1_200_000}</link>']), "no joint moves"
    frames = [f'<frame name="f{k + 1}" attached_to="f{k}"/>' for k in range(60_000)]
    yield "sdf", model([SDF_LINK.format("f0"), *frames]), "more than 100 deep"
    loop_joints = '<weld body1="a"/>' * 20_000
    text = world(['<body name="a"><joint/><geom size="1"/></body>'])
    yield (
        "xml",
        text.replace("</mujoco>", f"<equality>{loop_joints}</equality></mujoco>"),
        "at most 1000",
    )
    classes = "".join(f'<default class="c{k}"/>' for k in range(60_000))
    yield "xml", f"<mujoco><default>{classes}</default><worldbody/></mujoco>", "elements <default>"
    entities = "".join(f'<!ENTITY a{k + 1} "{f"&a{k};" * 10}">' for k in range(20))
    laughs = f'<!DOCTYPE robot [<!ENTITY a0 "ha">{entities}]>'
    yield "urdf", f"{laughs}<robot name='&a20;'/>", "entities are not read"
    outside = '<!DOCTYPE robot [<!ENTITY a SYSTEM "/etc/hostname">]>'
    yield "urdf", f"{outside}<robot name='r'>&a;</robot>", "entities are not read"
    yield "urdf", robot(links[:1000] + [HINGE.format(k, k + 1) for k in many[:999]]), "no joint mo"


def test_huge_files_are_refused_in_bounded_memory(tmp_path):
    paths, rules = [], []
    for number, (suffix, text, rule) in enumerate(sampled(huge_files(), every=3)):
        paths.append(tmp_path / f"{number}.{suffix}")
        paths[-1].write_text(text)
        rules.append(rule)
    for path, rule, found in zip(paths, rules, outcomes(paths), strict=True):
        assert found.startswith("refused: "), (path.name, found)
        assert rule in found, (path.name, found)


MOVING = """<link name="l{0}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0"
    ixz="0" iyz="0"/></inertial></link><joint name="j{0}" type="revolute"><parent link="{1}"/>
    <child link="l{0}"/><origin xyz="0.1 0 0"/><axis xyz="0 0 1"/><limit lower="-1" upper="1"/>
    </joint>"""


@pytest.mark.parametrize("shape", sampled(["chain", "star"]))
def test_the_largest_scene_loads_in_bounded_memory(tmp_path, shape):
    """As many joints and links as there may be; a stop in each asks for the inertia of all."""
    chain = shape == "chain"
    parts = [MOVING.format(k, f"l{k - 1}" if chain and k else "base") for k in range(201)]
    fixed = [LINK.format(f"f{k}") + HINGE.format("l0", f"f{k}") for k in range(799)]
    paths = [tmp_path / "large.urdf", tmp_path / "too_large.urdf"]
    paths[0].write_text(robot([LINK.format("base"), *parts[:200], *fixed]))
    paths[1].write_text(robot([LINK.format("base"), *parts]))
    found = outcomes(paths)
    assert found == ["loads", "refused: joints: at most 200 degrees of freedom"]


GOOD = {"urdf": urdf(), "xml": mjcf(), "sdf": sdf()}


@pytest.mark.parametrize("kind", GOOD)
def test_a_file_cut_short_is_not_xml(tmp_path, kind):
    text = GOOD[kind]
    path = tmp_path / f"cut.{kind}"
    for size in range(0, len(text.rstrip()) - 1, len(text) // 40):
        path.write_text(text[:size])
        with pytest.raises(SceneError) as caught:
            read_model(path)
        (problem,) = caught.value.problems
        assert problem.rule == "not valid XML"
        assert re.fullmatch(r"line \d+", problem.key_path)


BYTES = {
    "empty": b"",
    "binary": bytes(range(256)),
    "zeros": b"\0" * 100,
    "text": b"links: []",
    "encoding": b'<?xml version="1.0" encoding="no-such"?><robot/>',
    "other bytes": b'<?xml version="1.0" encoding="utf-8"?><robot name="\xff"/>',
    "html": b"<html><body><p></body></html>",
    "two roots": b"<robot/><robot/>",
    "attribute twice": b'<robot name="a" name="b"/>',
}


@pytest.mark.parametrize("data", BYTES.values(), ids=BYTES)
@pytest.mark.parametrize("kind", GOOD)
def test_what_is_no_xml_is_refused(tmp_path, kind, data):
    path = tmp_path / f"bad.{kind}"
    path.write_bytes(data)
    with pytest.raises(SceneError, match=r"not valid XML") as caught:
        load_scene(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1"])
def test_encodings_that_a_file_names_are_read(tmp_path, encoding):
    path = tmp_path / "model.urdf"
    text = f'<?xml version="1.0" encoding="{encoding}"?>' + urdf().replace("link1", "größer")
    path.write_bytes(text.encode(encoding))
    assert "größer" in read_model(path).places


@pytest.mark.parametrize(
    ("name", "rule"),
    [
        ("folder", "must be a regular file"),
        ("pipe", "must be a regular file"),
        ("gone.urdf", "cannot be read"),
        ("/dev/zero", "must be a regular file"),
        ('"a\\0b"', "cannot be read"),
    ],
)
def test_only_files_are_read(tmp_path, name, rule):
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(SceneError, match=rule):
        beside(tmp_path / "nothing", model=name)


def test_an_unknown_root_is_refused(tmp_path):
    path = tmp_path / "model.xml"
    path.write_text("<collada/>")
    with pytest.raises(SceneError, match=r"line 1, <collada>: must be one of mujoco, robot"):
        load_scene(path)


# What is replaced in the five-bar's URDF, by what, and words of the rule.
URDF = {
    "mass nan": ('mass value="1.0"', 'mass value="nan"', "must be 1 finite number"),
    "mass infinite": ('mass value="1.0"', 'mass value="inf"', "must be 1 finite number"),
    "mass huge": ('mass value="1.0"', 'mass value="1e31"', "must not be above"),
    "mass negative": ('mass value="1.0"', 'mass value="-1"', "greater than or equal to 0"),
    "mass words": ('mass value="1.0"', 'mass value="one"', "must be 1 number"),
    "mass in Python": ('mass value="1.0"', 'mass value="1_0"', "must be 1 number"),
    "mass two": ('mass value="1.0"', 'mass value="1 2"', "must be 1"),
    "mass gone": ('mass value="1.0"', "mass", "needs value"),
    "no mass": ('<mass value="1.0"/>', "", "needs <mass> and <inertia>"),
    "moment negative": ('ixx="0.0021"', 'ixx="-1"', "greater than or equal to 0"),
    "moment nan": ('ixx="0.0021"', 'ixx="nan"', "finite"),
    "products": ('ixy="0"', 'ixy="1"', "must not be negative"),
    "axis zero": ('axis xyz="0 0 1"', 'axis xyz="0 0 0"', "must not be zero"),
    "axis short": ('axis xyz="0 0 1"', 'axis xyz="0 0"', "must be 3"),
    "type": ('type="continuous"', 'type="screw"', "type must be one of"),
    "no type": ('type="continuous"', "", "needs type"),
    "link twice": ('link name="link2"', 'link name="link1"', "links must be unique"),
    "joint twice": ('joint name="joint2"', 'joint name="joint1"', "joints must be unique"),
    "parent": ('parent link="link2"', 'parent link="gone"', "needs this link"),
    "no parent": ('<parent link="link2"/>', "", "needs <parent link="),
    "circle": ('parent link="base"', 'parent link="link4"', "in a circle"),
    "stops crossed": (
        'type="continuous">',
        'type="revolute"><limit lower="1" upper="0"/>',
        "lower must not be above upper",
    ),
    "damping": ('damping="0.005"', 'damping="-1"', "greater than or equal to 0"),
    "floating twice": (
        "</robot>",
        '<joint name="again" type="floating"><parent link="link1"/><child link="link2"/></joint>'
        "</robot>",
        "only these types can",
    ),
}


@pytest.mark.parametrize(("old", "new", "rule"), URDF.values(), ids=URDF)
def test_broken_urdf_names_what_and_why(tmp_path, old, new, rule):
    path = written(tmp_path, "urdf")
    text = urdf()
    assert old in text
    (tmp_path / "five_bar.urdf").write_text(text.replace(old, new, 1))
    with pytest.raises(SceneError, match=re.escape(rule)) as caught:
        load_scene(path)
    for problem in caught.value.problems:
        assert problem.key_path != "file"
        assert not problem.key_path.startswith("links["), "no number that no file has"


# What is added to the five-bar's scene file, and words of the rule.
SIDECARS = {
    "links": ("links: []", "links come from the model"),
    "joint": ("model: {file: five_bar.urdf, joints: {gone: {damping: 1.0}}}", "must be one of"),
    "model": ("model: 3", "model"),
    "file": ("model: {base: free}", "model.file"),
    "base": ("model: {file: five_bar.urdf, base: loose}", "model.base"),
    "change": ("model: {file: five_bar.urdf, joints: {joint1: {wheel: 1.0}}}", "wheel"),
    "point": ("operational_points: [{name: a, link: [1]}]", "operational_points[0].link"),
    "unknown": ("operational_points: [{name: a, link: gone}]", "unknown frame"),
    "points": ("operational_points: 3", "operational_points"),
    "ends": ("springs: [{name: a, a: 1, b: {link: {}}}]", "springs[0].a"),
    "start": ("initial_state: [1]", "initial_state"),
    "start of none": ("initial_state: {q: {gone: 1.0}}", "unknown joint"),
    "closures": ("closures: 3", "closures"),
    "period": ("simulation: {period: 0.0}", "simulation.period"),
}


@pytest.mark.parametrize(("line", "rule"), SIDECARS.values(), ids=SIDECARS)
def test_broken_scene_files_name_what_and_why(tmp_path, line, rule):
    path = written(tmp_path, "urdf")
    key = line.split(":")[0]
    text = re.sub(rf"^{key}:.*(\n .*)*\n", "", path.read_text(), flags=re.MULTILINE)
    path.write_text(f"{text}{line}\n")
    with pytest.raises(SceneError, match=re.escape(rule)):
        load_scene(path)
