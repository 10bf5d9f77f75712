# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Models of several SDFormat files, screws, and comments as other parsers take them."""

from __future__ import annotations

import numpy as np
import pytest

from formats.imports import Read, beside, random_state
from formats.test_sdf import INERTIAL, joint, link, written
from hapticmech_ros import load_scene
from hapticmech_ros.errors import SceneError
from hapticmech_ros.formats import read_model
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.projection import consistent_initial_state

# Rounding of a few transforms.
SAME = 1e-12
ARM = (
    link("upper"),
    link("lower", "<pose>0 0 1 0.1 0.2 0</pose>"),
    joint("shoulder", "world", "upper", "0 1 0"),
    joint("elbow", "upper", "lower"),
)
POSE = "<pose>1 2 3 0.1 0.2 0.3</pose>"


def included(folder, version="1.9", parts=ARM, name="arm"):
    (folder / name).mkdir(parents=True, exist_ok=True)
    path = folder / name / "model.sdf"
    inside = "".join(parts)
    path.write_text(f'<sdf version="{version}"><model name="m">{inside}</model></sdf>')
    return path


def include(uri, inside="<name>left</name>"):
    return f"<include><uri>{uri}</uri>{inside}</include>"


@pytest.mark.parametrize("uri", ["arm/model.sdf", "arm", "model://arm"])
@pytest.mark.parametrize("version", ["1.9", "1.4"])
def test_an_included_model_is_as_if_it_were_written_there(tmp_path, uri, version):
    included(tmp_path, version)
    of_model = "<use_parent_model_frame>1</use_parent_model_frame>" if version == "1.4" else ""
    inside = "".join(ARM).replace("</xyz></axis>", f"</xyz>{of_model}</axis>")
    nested = f'<model name="left">{POSE}{inside}</model>'
    hand = (link("hand"), joint("wrist", "left::lower", "hand", "0 0 1"))
    own = Read(written(tmp_path, (nested, *hand)))
    found = Read(written(tmp_path, (include(uri, f"<name>left</name>{POSE}"), *hand)))
    assert found.imported.joints == own.imported.joints
    q, v = random_state(own.model, np.random.default_rng(1))
    np.testing.assert_allclose(found.inertia(q), own.inertia(q), atol=SAME)
    np.testing.assert_allclose(found.bias(q, v), own.bias(q, v), atol=10.0 * SAME)


def test_files_include_files_from_their_own_folders(tmp_path):
    of_base = [joint("base", "base", "inner::upper"), link("base")]
    fixed = '<joint name="f" type="fixed"><parent>world</parent><child>base</child></joint>'
    inner = include("../lower", "<name>inner</name>")
    included(tmp_path / "parts", parts=[p for p in ARM if "shoulder" not in p], name="lower")
    included(tmp_path / "parts", parts=[inner, *of_base, fixed])
    with pytest.raises(SceneError, match="names of links, joints, frames must be unique"):
        read_model(written(tmp_path, (include("parts/arm"),)))
    of_base[0] = joint("turns", "base", "inner::upper")
    included(tmp_path / "parts", parts=[inner, *of_base, fixed])
    found = read_model(written(tmp_path, (include("parts/arm"),)))
    assert set(found.joints) == {"left::turns", "left::inner::elbow"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (include("nowhere.sdf"), r"model.sdf: scene refused\n  line 2, <uri>: no such file"),
        (include("https://fuel/arm"), "nothing else is searched"),
        (include("model://nowhere"), "nor a folder with a model.sdf"),
        ("<include><name>a</name></include>", "line 2, <include>: an include needs a <uri>"),
        (include("model.sdf"), "include each other in a circle"),
        (include("arm").replace("<include>", '<include merge="true">'), "leave merge out"),
        (include("arm", "<static>true</static>"), "a static model does not move"),
        (include("bad.sdf"), r"line 1, <uri>|must be <sdf> with one <model>"),
        (include("arm") * 2, "names of links, joints, frames must be unique"),
        ("".join(include("arm", f"<name>a{k}</name>") for k in range(101)), "at most 100 includes"),
    ],
)
def test_includes_that_are_refused(tmp_path, text, said):
    included(tmp_path)
    (tmp_path / "bad.sdf").write_text("<sdf/>")
    with pytest.raises(SceneError, match=said):
        read_model(written(tmp_path, ("\n", text)))


def test_an_error_in_an_included_file_names_that_file(tmp_path):
    included(tmp_path, parts=("\n\n", '<link name="a"/>', joint("j", "world", "a", kind="odd")))
    with pytest.raises(
        SceneError, match=r"arm/model.sdf: scene refused\n  line 3, <joint>: type must"
    ):
        read_model(written(tmp_path, (include("arm"),)))


def test_files_are_included_so_deep(tmp_path):
    for k in range(12):
        included(tmp_path, parts=(include(f"../m{k + 1}", ""),), name=f"m{k}")
    included(tmp_path, name="m12")
    with pytest.raises(SceneError, match="at most 10 files that include each other"):
        read_model(written(tmp_path, (include("m0"),)))


def screw(inside):
    text = joint("spindle", "world", "nut", "0 0 1", kind="screw").replace(
        "</joint>", f"{inside}</joint>"
    )
    return (link("nut", "<pose>0.1 0.2 0 0 0 0</pose>"), text)


@pytest.mark.parametrize(
    ("inside", "pitch"),
    [
        ("<screw_thread_pitch>0.5</screw_thread_pitch>", 0.5),
        # gazebosim/sdformat, SDFormat 1.10: rad/m, left-handed, if the newer one is not there.
        (f"<thread_pitch>{-4.0 * np.pi!r}</thread_pitch>", 0.5),
        ("<thread_pitch>8</thread_pitch>", -np.pi / 4.0),
        ("<screw_thread_pitch>-0.2</screw_thread_pitch><thread_pitch>-12</thread_pitch>", -0.2),
        ("", 1.0),
    ],
)
def test_a_screw_moves_by_its_pitch_in_a_turn(tmp_path, inside, pitch):
    path = written(tmp_path, screw(inside))
    at = f"{{spindle: 0.7, spindle_slide: {0.7 * pitch / (2.0 * np.pi)!r}}}"
    scenes = load_scene(path), beside(path, f"initial_state: {{q: {at}}}")
    start, turned = map(Mechanism, scenes)
    poses = [one.frame_pose(consistent_initial_state(one)[0], "nut") for one in (start, turned)]
    moved = poses[1].translation - poses[0].translation
    np.testing.assert_allclose(moved[2], 0.7 * pitch / (2.0 * np.pi), atol=SAME)
    turn = poses[0].rotation.T @ poses[1].rotation
    np.testing.assert_allclose(np.arctan2(turn[1, 0], turn[0, 0]), 0.7, atol=SAME)
    # What the spindle feels: the nut's moment about the axis, and its mass by the lead squared.
    q, _ = consistent_initial_state(start)
    closing = start.closing_terms(q, start.initially_active)
    free = np.array([1.0, pitch / (2.0 * np.pi)])
    assert np.abs(closing.jacobian @ free).max() < SAME
    d = closing.space.factor @ closing.space.factor.T
    place = start.frame_pose(q, "nut")
    own = start.scene.links[-1].inertial
    com = place.act(np.array(own.com))
    i = own.inertia
    tensor = np.array([[i.ixx, i.ixy, i.ixz], [i.ixy, i.iyy, i.iyz], [i.ixz, i.iyz, i.izz]])
    about = (place.rotation @ tensor @ place.rotation.T)[2, 2]
    line = np.array([0.1, 0.2])
    about += own.mass * np.sum((com[:2] - line) ** 2)
    expected = about + own.mass * (pitch / (2.0 * np.pi)) ** 2
    assert free @ d @ free == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    "inside", ["<thread_pitch>0</thread_pitch>", "<screw_thread_pitch>0</screw_thread_pitch>"]
)
def test_a_screw_without_a_pitch_is_refused(tmp_path, inside):
    with pytest.raises(SceneError, match="thread_pitch must not be zero"):
        read_model(written(tmp_path, screw(inside)))


COMMENTS = "<!-- a -- b -->\n<!--- <link> -->\n<!-- c --->\n<!----><!-- plain -->"


@pytest.mark.parametrize(
    "before",
    [
        "",
        '\n \n<?xml version="1.0"?>',
        '<?xml version="1.0" encoding="utf8"?>',
        '\n<?xml version="1.0" encoding="UTF8"?>',
        '\n<?xml version="1.0" encoding="ISO-8859-1"?>',
        '<?xml version="1.0" encoding="utf-8"?>',
    ],
)
def test_hyphens_in_comments_and_declarations_after_blank_lines(tmp_path, before):
    text = f'<sdf version="1.9"><model name="mü">{COMMENTS}{"".join(ARM)}{COMMENTS}</model></sdf>'
    latin = "8859" in before
    path = tmp_path / "model.sdf"
    path.write_bytes((before + text).encode("latin-1" if latin else "utf-8"))
    found = read_model(path)
    assert set(found.joints) == {"shoulder", "elbow"}
    assert found.document["name"] == "m_"
    # Lines of errors are those of the file.
    wrong = text.replace('type="revolute"', 'type="odd"', 1)
    path.write_bytes((before + wrong).encode("latin-1" if latin else "utf-8"))
    line = (before + text).count("\n", 0, (before + text).index("<joint")) + 1
    with pytest.raises(SceneError, match=f"line {line}, <joint>"):
        read_model(path)


def test_what_looks_like_a_comment_in_text_is_none(tmp_path):
    inside = "<![CDATA[ <!-- a -- b ]]>" + INERTIAL
    path = written(tmp_path, (f'<link name="upper">{inside}</link>', *ARM[1:]))
    assert set(read_model(path).joints) == {"shoulder", "elbow"}


def test_a_world_may_include_what_is_not_there(tmp_path):
    included(tmp_path)
    included(tmp_path, parts=("<static>true</static>", link("plane")), name="ground_plane")
    path = tmp_path / "world.sdf"
    sun, plane = include("model://sun", ""), include("model://ground_plane", "")
    text = f"{sun}{plane}{include('arm')}{include('https://fuel/x', '')}"
    path.write_text(f'<sdf version="1.9"><world name="w">{text}</world></sdf>')
    found = read_model(path)
    assert set(found.joints) == {"shoulder", "elbow"}
    assert {note.what: note.count for note in found.notes} == {"include of a world": 2}
