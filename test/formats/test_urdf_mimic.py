# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What mimics a joint that does not move does not move either: it is where that holds it."""

from __future__ import annotations

import numpy as np
import pytest

from formats.imports import Read, counts_in, refused, saved
from formats.robots import robot
from formats.test_urdf import inertial_of
from hapticmech_ros import load_scene
from hapticmech_ros.formats import read_model

# Rounding of a few transforms.
SAME = 1e-12
LINKS = "".join(f'<link name="{name}">{inertial_of(k)}</link>' for k, name in enumerate("abcde"))
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="0.1 0.2 0.3" rpy="{rpy}"/><axis xyz="{axis}"/><dynamics damping="1" friction="1"/>
<limit lower="-1" upper="1"/>{mimic}</joint>"""
MIMIC = '<mimic joint="{}" multiplier="{}" offset="{}"/>'


def joint(name, ends, kind="revolute", mimic="", axis="0 0 1", rpy="0 0 0"):
    parent, child = ends
    given = {"kind": kind, "parent": parent, "child": child, "axis": axis, "rpy": rpy}
    return JOINT.format(name=name, mimic=mimic, **given)


def written(folder, joints):
    return saved(folder, "model.urdf", f'<robot name="r">{LINKS}{"".join(joints)}</robot>')


CHAIN = [
    joint("second", "cd", mimic=MIMIC.format("first", 2.0, 0.1)),
    joint("free", "ab"),
    joint("first", "bc", mimic=MIMIC.format("still", -3.0, 0.4)),
    joint("slid", "de", "prismatic", MIMIC.format("still", 1.0, -0.3), "1 0 0"),
    joint("still", "df", "fixed"),
]
MIMICS = f'<robot name="r">{LINKS}<link name="f"/>{"".join(CHAIN)}</robot>'


def test_joints_that_mimic_a_fixed_one_are_fixed_at_their_offset(tmp_path):
    """One turned, one slid, one that mimics the first of these; the rest of the tree moves."""
    ours = Read(saved(tmp_path, "model.urdf", MIMICS))
    assert ours.model.nv == 1
    assert counts_in(ours.imported)["mimic of a joint that does not move"] == 3
    assert "couplings" not in ours.imported.document
    by_hand = [
        joint("free", "ab"),
        joint("first", "bc", "fixed", rpy="0 0 0.4"),
        joint("second", "cd", "fixed", rpy="0 0 0.9"),
        joint("slid", "de", "fixed").replace("0.1 0.2 0.3", "-0.2 0.2 0.3"),
    ]
    (tmp_path / "by hand").mkdir()
    theirs = Read(written(tmp_path / "by hand", by_hand))
    q = np.array((0.3,))
    assert np.abs(ours.inertia(q) - theirs.inertia(q)).max() < SAME
    for body in "bcde":
        error = ours.pose(body, q).homogeneous - theirs.pose(body, q).homogeneous
        assert np.abs(error).max() < SAME


def test_a_mimic_in_a_fixed_joint_says_nothing(tmp_path):
    fixed = joint("still", "bc", "fixed", MIMIC.format("free", 1.0, 0.5))
    imported = read_model(written(tmp_path, [joint("free", "ab"), fixed]))
    assert "couplings" not in imported.document
    assert counts_in(imported)["mimic in a fixed joint"] == 1


def test_a_joint_of_several_coordinates_mimics_none(tmp_path):
    floating = joint("loose", "bc", "floating", MIMIC.format("free", 1.0, 0.5))
    path = written(tmp_path, [joint("free", "ab"), floating])
    assert refused(path, "only a joint of one coordinate can mimic").endswith("<mimic>")


def test_joints_that_mimic_each_other_in_a_circle_stay_couplings(tmp_path):
    """Nothing holds them: what they say is for the rows of W."""
    joints = [
        joint("one", "ab", mimic=MIMIC.format("other", 2.0, 0.0)),
        joint("other", "bc", mimic=MIMIC.format("one", 0.5, 0.0)),
    ]
    assert len(read_model(written(tmp_path, joints)).document["couplings"]) == 2


@pytest.mark.parametrize("name", ["talos_left_arm", "talos_reduced"])
def test_talos_whose_gripper_is_fixed_loads(name):
    assert load_scene(robot(".urdf", f"talos_data/robots/{name}.urdf")).couplings == ()
