# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Gearboxes and mimics of SDFormat turn what they say they turn, by how much they say."""

from __future__ import annotations

from itertools import product

import numpy as np
import pinocchio as pin
import pytest

from formats.imports import Read, counts_in, refused
from formats.test_sdf import joint, link, written
from hapticmech_ros.errors import SceneError
from hapticmech_ros.formats import read_model

SAME = 1e-12
PLACE = "<pose>0 0 0 0.3 0.2 0.1</pose>"
GEARBOX = """<joint name="g" type="gearbox"><parent>in</parent><child>out</child>
<gearbox_reference_body>{reference}</gearbox_reference_body><gearbox_ratio>{ratio}</gearbox_ratio>
<axis><xyz expressed_in="__model__">{axis}</xyz></axis>
<axis2><xyz expressed_in="__model__">{axis2}</xyz></axis2></joint>"""


def geared(axis="1 2 3", axis2="1 2 3", reference="base", ratio="0.25"):
    return GEARBOX.format(axis=axis, axis2=axis2, reference=reference, ratio=ratio)


def bodies():
    return [link("base"), link("in", PLACE), link("out")]


def turn_about(axis, rotation):
    """Return the angle of a rotation that is about an axis."""
    vector = pin.log3(rotation)
    unit = np.array(axis.split(), dtype=float)
    unit /= np.linalg.norm(unit)
    assert np.abs(np.cross(vector, unit)).max() < SAME
    return vector @ unit


@pytest.mark.parametrize(
    ("own", "first", "second"), list(product((1, -1), ("1 2 3", "-1 -2 -3"), ("1 2 3", "-1 -2 -3")))
)
def test_a_gearbox_turns_its_child_against_its_parent_by_its_ratio(tmp_path, own, first, second):
    """Whatever way the hinges' own axes point: angles are those of the links, from their poses."""
    along = ' expressed_in="__model__"'
    axis = " ".join(str(own * x) for x in (1, 2, 3))
    parts = [
        *bodies(),
        joint("j", "world", "base"),
        joint("i", "base", "in", axis, of_axis=along),
        joint("o", "base", "out", "1 2 3", of_axis=along),
        geared(first, second),
    ]
    ours = Read(written(tmp_path, parts))
    (coupling,) = ours.imported.document["couplings"]
    assert (coupling["joint"], coupling["leader"], coupling["offset"]) == ("o", "i", 0.0)
    q = np.zeros(3)
    before = [ours.pose(name, q) for name in ("base", "in", "out")]
    q[ours.model.idx_qs[ours.joint("i")]] = 0.8
    q[ours.model.idx_qs[ours.joint("o")]] = coupling["ratio"] * 0.8
    after = [ours.pose(name, q) for name in ("base", "in", "out")]
    one, two = (
        turn_about(axis, after[k].rotation @ before[k].rotation.T)
        for k, axis in ((1, first), (2, second))
    )
    assert abs(one) == pytest.approx(0.8, rel=SAME)
    assert two == pytest.approx(-0.25 * one, rel=SAME)


def test_a_gearbox_may_be_said_from_its_parent_on(tmp_path):
    """The reference body hangs on the parent there: the angle from it is minus the hinge's."""
    parts = [*bodies(), joint("j", "world", "in"), joint("i", "in", "base", "1 0 0", inside=PLACE)]
    parts += [joint("o", "base", "out", "1 0 0", of_axis=' expressed_in="i"'), geared()]
    axes = "<axis><xyz expressed_in='i'>1 0 0</xyz></axis><axis2><xyz expressed_in='i'>1 0 0</xyz>"
    text = geared()
    text = text[: text.index("<axis>")] + axes + "</axis2></joint>"
    (coupling,) = read_model(written(tmp_path, [*parts[:-1], text])).document["couplings"]
    assert coupling["ratio"] == 0.25


INEXACT = {
    "another body": geared(reference="world"),
    "another axis": geared(axis="1 0 0"),
    "another second axis": geared(axis2="3 2 1"),
    "one axis": geared().replace("axis2>", "axis3>"),
}


@pytest.mark.parametrize("text", INEXACT.values(), ids=INEXACT)
def test_a_gearbox_of_no_two_hinges_is_noted(tmp_path, text):
    along = ' expressed_in="__model__"'
    parts = [*bodies(), joint("j", "world", "base")]
    parts += [joint(n, "base", e, "1 2 3", of_axis=along) for n, e in (("i", "in"), ("o", "out"))]
    imported = read_model(written(tmp_path, [*parts, text]))
    assert "couplings" not in imported.document
    assert counts_in(imported)["gearbox"] == 1


MIMIC = """<joint name="k" type="prismatic"><parent>a</parent><child>b</child>
<axis><xyz>0 0 1</xyz><mimic joint="{leader}" axis="{axis}">{values}</mimic></axis></joint>"""
VALUES = "<multiplier>-2</multiplier><offset>0.3</offset><reference>0.1</reference>"
ALONG = ' expressed_in="__model__"'
# A gearbox and a mimic of what it drives.
GEARS = [
    *bodies(),
    link("b"),
    joint("j", "world", "base"),
    joint("i", "base", "in", of_axis=ALONG),
    joint("o", "base", "out", of_axis=ALONG),
    geared(),
    MIMIC.format(leader="o", axis="axis", values=VALUES).replace(">a<", ">out<"),
]


def test_gears_drive_each_other(tmp_path):
    couplings = read_model(written(tmp_path, GEARS)).document["couplings"]
    assert {(one["leader"], one["joint"]) for one in couplings} == {("i", "o"), ("o", "k")}


BROKEN = {
    "child": ([joint("i", "base", "in")], geared(), "another joint must carry its child"),
    "reference": ([], geared(reference="gone"), "no such link"),
    "no reference": ([], geared(reference=""), "needs a <gearbox_reference_body>"),
    "ratio": (
        [joint(n, "base", e, "1 2 3", of_axis=' expressed_in="__model__"')
         for n, e in (("i", "in"), ("o", "out"))],
        geared(ratio="nan"),
        "a ratio must be 1 finite",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("joints", "text", "rule"), BROKEN.values(), ids=BROKEN)
def test_a_gearbox_that_is_none_is_refused(tmp_path, joints, text, rule):
    refused(written(tmp_path, [*bodies(), joint("j", "world", "base"), *joints, text]), rule)


def mimicking(folder, leader="i", axis="axis", values=VALUES, kind="revolute"):
    parts = [link("a"), link("b"), joint("i", "world", "a", kind=kind)]
    text = MIMIC.format(leader=leader, axis=axis, values=values)
    return read_model(written(folder, [*parts, text], version="1.11"))


@pytest.mark.parametrize("leader", [0.1, -0.4])
def test_a_mimic_is_a_coupling_from_its_reference_on(tmp_path, leader):
    (coupling,) = mimicking(tmp_path).document["couplings"]
    assert (coupling["name"], coupling["joint"], coupling["leader"]) == ("k_mimics_i", "k", "i")
    found = coupling["ratio"] * leader + coupling["offset"]
    assert found == pytest.approx(-2.0 * (leader - 0.1) + 0.3, rel=SAME)


def test_a_mimic_of_a_second_axis_is_noted(tmp_path):
    imported = mimicking(tmp_path, axis="axis2")
    assert "couplings" not in imported.document
    assert counts_in(imported)["mimic of a second axis"] == 1


@pytest.mark.parametrize(
    ("given", "rule"),
    [
        ({"leader": "gone"}, "no such joint"),
        ({"leader": ""}, "needs joint"),
        ({"values": "<offset>1</offset>"}, "needs a <multiplier>"),
        ({"values": VALUES.replace("-2", "x")}, "multiplier must be 1"),
    ],
)
def test_a_mimic_that_is_none_is_refused(tmp_path, given, rule):
    with pytest.raises(SceneError, match=rule):
        mimicking(tmp_path, **given)
