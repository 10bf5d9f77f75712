# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot with a gripper: its fingers stand still, and the arm moves as without them."""

import numpy as np
import pinocchio as pin
import pytest

from formats.robots import robot as file_of
from hapticmech_ros import Mechanism, load_scene
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.robot.follower import arm_of, load_arm
from hapticmech_ros.robot.law import OperationalLaw
from oracles.driven_robots import ROBOTS


def test_an_arm_without_a_gripper_is_what_it_was():
    scene = load_scene(ROBOTS["iiwa14"])
    assert arm_of(scene) is scene


def gripper(tmp_path):
    """Return a robot of two joints with two fingers of which one mimics the other."""
    link = (
        '<link name="{0}"><inertial><mass value="1"/><origin xyz="0.1 0 0"/>'
        '<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    joint = (
        '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>'
        '<origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>{3}'
        '<limit lower="-3" upper="3" effort="9" velocity="9"/></joint>'
    )
    mimic = '<mimic joint="left"/>'
    links = "".join(link.format(name) for name in ("a", "b", "f", "g"))
    joints = [
        joint.format("shoulder", "world", "a", ""),
        joint.format("elbow", "a", "b", ""),
        joint.format("left", "b", "f", ""),
        joint.format("right", "b", "g", mimic),
    ]
    path = tmp_path / "gripper.urdf"
    path.write_text(f'<robot name="r"><link name="world"/>{links}{"".join(joints)}</robot>')
    return path


def test_coupled_joints_are_locked_where_they_start(tmp_path):
    scene = load_scene(gripper(tmp_path))
    assert scene.couplings
    arm = Mechanism(load_arm(str(gripper(tmp_path))))
    assert arm.tree.joint_names == ("shoulder", "elbow")
    law = OperationalLaw(arm)
    model = pin.buildModelFromUrdf(str(gripper(tmp_path)))
    q, v = np.array([0.4, -0.7]), np.array([0.3, 0.5])
    there, moving = pin.neutral(model), np.zeros(model.nv)
    there[:2], moving[:2] = q, v
    inertia = np.triu(pin.crba(model, model.createData(), there))
    upper = inertia + np.triu(inertia, 1).T
    state = law.state(q, v)
    # Sums of four bodies.
    np.testing.assert_allclose(state.factor @ state.factor.T, upper[:2, :2], atol=1e-12)
    expected = pin.nle(model, model.createData(), there, moving)[:2]
    np.testing.assert_allclose(state.bias_force, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("file", "given", "expected"),
    [
        (ROBOTS["iiwa14"], None, (0.0, 0.0, -9.81)),
        # The shipped scene is to be felt: without weight.
        ("ur5e", None, (0.0, 0.0, 0.0)),
        ("ur5e", (0.0, 9.0, 0.0), (0.0, 9.0, 0.0)),
        ("", None, (0.0, 0.0, -9.81)),
        ("", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ],
)
def test_gravity_is_the_files_or_what_is_given(tmp_path, file, given, expected):
    gravity = () if given is None else (np.array(given),)
    assert load_arm(file or str(gripper(tmp_path)), *gravity).gravity == expected


@pytest.mark.parametrize("wrong", [np.zeros(2), np.array([0.0, np.nan, 0.0])])
def test_gravity_that_is_none_is_refused(wrong):
    with pytest.raises(InvalidInputError, match="gravity"):
        load_arm("ur5e", wrong)


def test_a_panda_with_its_gripper_is_an_arm_of_seven_joints():
    law = OperationalLaw(Mechanism(arm_of(load_scene(file_of(".urdf", PANDA)))))
    assert law.mechanism.nv == 7
    state = law.state(np.array([0.0, 0.3, 0.0, -1.8, 0.0, 2.0, 0.7]), np.zeros(7))
    assert state.analysis.rank == 6


PANDA = "panda_description/urdf/panda.urdf"
