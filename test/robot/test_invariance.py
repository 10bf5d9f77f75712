# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Torques depend neither on the axes of the world nor on the axes of the point."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

from hapticmech_ros import Mechanism
from hapticmech_ros.robot.law import ForceTask, OperationalLaw, Target
from hapticmech_ros.scene import scene_from_document
from oracles.driven_robots import ROBOTS, pose_of
from oracles.frames import rotated
from oracles.kinematics import rpy_of_rotation

Q = np.array([0.3, 0.7, 0.2, -1.1, 0.4, 0.9, 0.1])


def document():
    text = Path(ROBOTS["iiwa14"]).read_text(encoding="utf-8")
    return {"closures": [], **yaml.safe_load(text)}


def torques(given, turn, elbow):
    """Return torques of a moving target and a force, both turned with the world."""
    law = OperationalLaw(Mechanism(scene_from_document(given)))
    q = np.where(np.arange(7) == 3, elbow, Q)
    pose = pose_of(law, q)
    # In axes of the world that is turned.
    own = pin.SE3(turn, np.zeros(3))
    away = own * pin.exp6(pin.Motion(np.full(6, 0.05))) * own.inverse()
    six = np.r_[turn @ np.array([0.1, 0.2, -0.3]), turn @ np.array([0.4, -0.5, 0.6])]
    target = Target(away * pose, six, 2.0 * six, ForceTask(turn @ np.array([0.6, 0.0, 0.8]), 5.0))
    state = law.state(q, np.linspace(-0.5, 0.5, 7))
    return law.command(state, target, contact=3.0 * six).torque


# A generic pose, one between free and rigid, and a singular one.
every_elbow = pytest.mark.parametrize("elbow", [-1.1, -0.2, 0.0])


@every_elbow
def test_torques_do_not_depend_on_the_axes_of_the_world(elbow):
    turn = pin.exp3(np.array([0.4, -1.1, 0.7]))
    one = torques(document(), np.eye(3), elbow)
    two = torques(rotated(document(), turn), turn, elbow)
    # Masses of 1 / s_on² = 2500 of the link's, in numbers of 2e-16 each.
    np.testing.assert_allclose(two, one, rtol=1e-9, atol=1e-9)


@every_elbow
def test_torques_do_not_depend_on_the_axes_of_the_point(elbow):
    """A point with other axes has the same position and twist: its target is turned likewise."""
    own = pin.exp3(np.array([-0.3, 0.8, 0.5]))
    given = document()
    one = torques(given, np.eye(3), elbow)
    given["operational_points"][0]["origin"]["rpy"] = rpy_of_rotation(own)
    np.testing.assert_allclose(torques(given, np.eye(3), elbow), one, rtol=1e-9, atol=1e-9)
