# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What refers to replicas is replicated as MuJoCo's compiler does; other counts are refused."""

from __future__ import annotations

import mujoco
import pytest

from formats.imports import counts_in, saved
from hapticmech_ros.errors import SceneError
from hapticmech_ros.formats import read_model

BODIES = """<body name="a"><joint name="j" axis="0 1 0"/><geom size=".1"/>
    <body name="b" pos="1 0 0"><joint name="k" axis="0 1 0"/><geom size=".1" pos=".2 0 0"/></body>
    </body>"""
OUTSIDE = '<body name="z"><joint name="zz"/><geom size=".1" pos=".1 0 0"/></body>'
EQUALITIES = """<tendon><fixed name="t"><joint joint="j" coef="1"/>
    <joint joint="k" coef="2"/></fixed></tendon>
    <actuator><motor name="m" joint="j" armature="0.3" gear="2"/></actuator><equality>
    <joint name="e" joint1="j" joint2="k"/><joint name="f" joint1="j" joint2="zz"/>
    <connect name="c" body1="a" body2="b" anchor="1 0 0"/>
    <connect name="w" body1="b" anchor=".5 0 0"/>
    <tendon name="g" tendon1="t"/><joint name="h" joint1="j1" joint2="zz"/></equality>"""


def written(folder, inside, rest=""):
    text = f"<mujoco><worldbody>{OUTSIDE}{inside}</worldbody>\n{rest}</mujoco>"
    return saved(folder, "model.xml", text)


def test_references_are_those_that_mujoco_compiles(tmp_path):
    text = f'<replicate count="3" offset="0 1 0" euler="0 0 20">{BODIES}</replicate>'
    path = written(tmp_path, text, EQUALITIES)
    theirs = mujoco.MjModel.from_xml_path(str(path))
    ours = read_model(path)
    document = ours.document
    assert set(ours.joints) >= {theirs.joint(k).name for k in range(theirs.njnt)}
    names = {theirs.eq(k).name for k in range(theirs.neq)}
    parts = [*document["closures"], *document["couplings"]]
    assert {part["name"] for part in parts} == names
    assert names == {f"{name}{k}" for name in "ecwg" for k in range(3)} | {"h"}
    for coupling in document["couplings"]:
        if coupling["name"].startswith("e"):
            number = coupling["name"][1:]
            assert (coupling["joint"], coupling["leader"]) == (f"j{number}", f"k{number}")
    armatures = {
        link["joint"]["name"]: link["joint"].get("armature", 0.0) for link in document["links"]
    }
    for k in range(theirs.njnt):
        joint = theirs.joint(k)
        assert armatures[joint.name] == pytest.approx(
            float(joint.armature[0]) + (1.2 if joint.name.startswith("j") else 0.0)
        )
    assert counts_in(ours)["reference from a replica to outside"] == 1


@pytest.mark.parametrize(
    ("count", "said"),
    [
        ('count="1.5"', "line 1, <replicate>: .*bad format in attribute 'count'"),
        ("", "line 1, <replicate>: .*attribute missing: 'count'"),
        ('count="100000"', "at most 200000 elements, replicas counted"),
    ],
)
def test_a_count_is_a_number_within_the_limits(tmp_path, count, said):
    with pytest.raises(SceneError, match=said):
        read_model(written(tmp_path, f"<replicate {count}>{BODIES}</replicate>"))


def test_no_replicas_are_none(tmp_path):
    path = written(tmp_path, f'<replicate count="0">{BODIES}</replicate>')
    assert set(read_model(path).joints) == {"zz"}
