# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Models in models are what they are when they are written as one."""

from __future__ import annotations

import numpy as np
import pytest

from formats.imports import Read, random_state, refused, scene_naming_all
from formats.test_sdf import INERTIAL, link, written
from hapticmech_ros.formats import read_model

# Rounding of a few transforms.
SAME = 1e-12
POSE = "<pose{}>{}</pose>"
BALL = '<collision name="c">{}<geometry><sphere><radius>1</radius></sphere></geometry></collision>'


def joint(name, parent, child, place="", axis="1 2 3", more=""):
    return (
        f'<joint name="{name}" type="revolute"><parent>{parent}</parent><child>{child}</child>'
        f"{place}<axis><xyz{more}>{axis}</xyz></axis></joint>"
    )


def pose(numbers, relative=""):
    return POSE.format(f' relative_to="{relative}"' if relative else "", numbers)


HAND = (
    pose("0 0 1 0.3 0 0"),
    link("palm", pose("0 0.1 0 0 0 0.2")),
    link("thumb", pose("0.2 0 0 0 0.1 0", "palm") + BALL.format(pose("1 0 0 0 0 0", "nail"))),
    '<frame name="nail" attached_to="thumb">' + pose("0 0 0.5 0 0 1") + "</frame>",
    '<frame name="here">' + pose("0.5 0 0 0 0 0", "__model__") + "</frame>",
    joint("bends", "palm", "thumb", pose("0.1 0 0 0 0 0", "nail"), more=' expressed_in="here"'),
)
ARM = (
    pose("1 2 3 0.1 0.2 0.3", "post"),
    link("upper"),
    link("lower", pose("0 0 1 0 0 0", "upper")),
    joint("elbow", "upper", "lower", axis="0 1 0"),
    f'<model name="hand">{"".join(HAND)}</model>',
    joint("wrist", "lower", "hand::palm", axis="0 0 1"),
)
NESTED = (
    pose("3 2 1 0.4 0.5 0.6"),
    '<frame name="post">' + pose("0 0 2 0.3 0.2 0.1") + "</frame>",
    f'<model name="arm">{"".join(ARM)}</model>',
    joint("shoulder", "world", "arm", axis="1 0 0"),
    '<frame name="tip" attached_to="arm::hand::thumb">'
    + pose("0 0 1 0 0 0", "arm::hand") + "</frame>",
)  # fmt: skip
# The same, every frame of a model a frame of the one model there is.
FLAT = (
    pose("3 2 1 0.4 0.5 0.6"),
    '<frame name="post" attached_to="upper">' + pose("0 0 2 0.3 0.2 0.1", "__model__") + "</frame>",
    '<frame name="arm" attached_to="upper">' + pose("1 2 3 0.1 0.2 0.3", "post") + "</frame>",
    '<frame name="hand" attached_to="palm">' + pose("0 0 1 0.3 0 0", "arm") + "</frame>",
    link("upper", pose("0 0 0 0 0 0", "arm")),
    link("lower", pose("0 0 1 0 0 0", "upper")),
    link("palm", pose("0 0.1 0 0 0 0.2", "hand")),
    link("thumb", pose("0.2 0 0 0 0.1 0", "palm") + BALL.format(pose("1 0 0 0 0 0", "nail"))),
    '<frame name="nail" attached_to="thumb">' + pose("0 0 0.5 0 0 1", "thumb") + "</frame>",
    '<frame name="here" attached_to="palm">' + pose("0.5 0 0 0 0 0", "hand") + "</frame>",
    '<frame name="tip" attached_to="thumb">' + pose("0 0 1 0 0 0", "hand") + "</frame>",
    joint("elbow", "upper", "lower", axis="0 1 0"),
    joint("bends", "palm", "thumb", pose("0.1 0 0 0 0 0", "nail"), more=' expressed_in="hand"'),
    joint("wrist", "lower", "palm", axis="0 0 1"),
    joint("shoulder", "world", "upper", pose("0 0 0 0 0 0", "arm"), axis="1 0 0"),
)
INSIDE = {
    "arm::upper": "upper",
    "arm::lower": "lower",
    "arm::hand::palm": "palm",
    "arm::hand::thumb": "thumb",
    "arm::hand::nail": "nail",
    "arm::hand::here": "here",
    "post": "post",
    "tip": "tip",
}


def test_models_in_models_are_as_if_written_as_one(tmp_path):
    """The joint's axis is in the hand's frame, as that of the frame in it is."""
    (tmp_path / "flat").mkdir()
    nested = Read(written(tmp_path, NESTED))
    flat = Read(written(tmp_path / "flat", FLAT))
    theirs = {"arm::elbow": "elbow", "arm::wrist": "wrist", "arm::hand::bends": "bends"}
    theirs["shoulder"] = "shoulder"
    ends = [(nested.joint(name), flat.joint(other)) for name, other in theirs.items()]
    order = np.array([(nested.model.idx_qs[a], flat.model.idx_qs[b]) for a, b in ends])
    rng = np.random.default_rng(1)
    for _ in range(3):
        q, _ = random_state(nested.model, rng)
        other = np.zeros(4)
        other[order[:, 1]] = q[order[:, 0]]
        for name, known in INSIDE.items():
            error = nested.pose(name, q).homogeneous - flat.pose(known, other).homogeneous
            assert np.abs(error).max() < SAME
        ours = nested.inertia(q)[np.ix_(order[:, 0], order[:, 0])]
        known = flat.inertia(other)[np.ix_(order[:, 1], order[:, 1])]
        assert np.abs(ours - known).max() < SAME * np.abs(known).max()
    assert "arm__hand__thumb" in {link.name for link in nested.scene.links}


def test_shapes_in_models_in_models_are_where_their_frames_are(tmp_path):
    (tmp_path / "flat").mkdir()
    paths = (written(tmp_path, NESTED), written(tmp_path / "flat", FLAT))
    nested, flat = (
        next(s for s in scene_naming_all(path).shapes if s.name == "c") for path in paths
    )
    assert (nested.link, flat.link) == ("arm__hand__thumb", "thumb")
    assert np.abs(np.subtract(nested.origin.xyz, flat.origin.xyz)).max() < SAME


def test_a_frame_of_a_model_moves_with_its_canonical_link(tmp_path):
    """That is the first, or the one it names; where it has none, that of the first model in it."""
    frame = '<frame name="f"><pose>0 0 1 0 0 0</pose></frame>'
    parts = [link("a"), link("b"), joint("i", "world", "a"), joint("j", "a", "b"), frame]
    for model, body in (("", "a"), (' canonical_link="b"', "b")):
        assert read_model(written(tmp_path, parts, model=model)).places["f"][0] == body
    inner = f'<model name="m">{"".join(parts[:4])}</model>'
    assert read_model(written(tmp_path, [inner, frame])).places["f"][0] == "m__a"


def test_joints_may_join_frames(tmp_path):
    """The frame is fixed in a link; where it is, the joint is."""
    frames = (
        '<frame name="end" attached_to="a"><pose relative_to="a">1 0 0 0.1 0 0</pose></frame>',
        '<frame name="start" attached_to="b"><pose relative_to="end">0 0 0 0 0 0.5</pose></frame>',
    )
    bodies = [link("a"), link("b", pose("2 1 0 0 0 0.3")), joint("i", "world", "a")]
    by_frames = Read(written(tmp_path, [*bodies, *frames, joint("j", "end", "start")]))
    (tmp_path / "other").mkdir()
    by_links = [*bodies, *frames, joint("j", "a", "b", pose("0 0 0 0 0 0", "start"))]
    other = Read(written(tmp_path / "other", by_links))
    q = np.array((0.4, -0.7))
    assert np.abs(by_frames.pose("b", q).homogeneous - other.pose("b", q).homogeneous).max() < SAME
    assert np.abs(by_frames.inertia(q) - other.inertia(q)).max() < SAME


MODEL = f'<model name="{{}}"><link name="a">{INERTIAL}</link></model>'
HINGE = joint("i", "world", "m::a")
DEEP = '<model name="m">' * 90 + '<link name="a"/>' + "</model>" * 90
BROKEN = {
    "placement": ([MODEL.format("m").replace(">", ' placement_frame="a">', 1)], "its own frame"),
    "names": ([MODEL.format("m"), MODEL.format("m"), HINGE], "must be unique"),
    "no name": (["<model/>"], "needs name"),
    "static": (['<model name="m"><static>1</static></model>'], "does not move"),
    "include": (['<model name="m"><include/></model>'], "an include needs a <uri>"),
    "outside": (
        ['<model name="m"><link name="a"><pose relative_to="b"/></link></model>', link("b"), HINGE],
        "no such link, joint or frame",
    ),
    "canonical": (
        [MODEL.format("m").replace(">", ' canonical_link="b">', 1), joint("i", "world", "m")],
        "no such link",
    ),
    "empty": (['<model name="m"/>', link("a"), joint("i", "world", "m")], "no such link"),
    "deep": ([DEEP], "at most 200 characters"),
}


@pytest.mark.parametrize(("parts", "rule"), BROKEN.values(), ids=BROKEN)
def test_broken_models_in_models_name_line_and_rule(tmp_path, parts, rule):
    refused(written(tmp_path, parts), rule)
