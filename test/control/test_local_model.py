# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Loops closed in the device: the answer to the device as it is, found from an old one."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.analysis.scene_variants import with_loop
from hapticmech_ros.control import ControlArchitecture, PointMeasurement
from hapticmech_ros.control.clutch import engage
from hapticmech_ros.control.kernels import displacement
from hapticmech_ros.control.loop_layout import HandMemory
from hapticmech_ros.control.measurements import operational_model_of
from hapticmech_ros.control.passivity import corrected
from hapticmech_ros.numerics.layout import Pose
from oracles.controllers import corrected_answers, local_model, random_pose

# Of a hand whose wrench was never measured before: nothing is carried on.
NO_MEMORY = HandMemory().values


def place(pose):
    return np.asarray(pin.SE3ToXYZQUAT(pose))


def way_between(start, end):
    way = np.empty(6)
    displacement(Pose(start), Pose(end), way)
    return way


def test_displacement_is_the_way_from_pose_to_pose():
    rng = np.random.default_rng(1)
    for _ in range(200):
        start = random_pose(rng)
        turn = rng.normal(size=3)
        turn *= rng.uniform(0.0, 3.0) / np.linalg.norm(turn)
        end = pin.SE3(pin.exp3(turn) @ start.rotation, start.translation + rng.normal(size=3))
        found = way_between(place(start), place(end))
        assert found[3:] == pytest.approx(turn, abs=1e-12)
        assert found[:3] == pytest.approx(end.translation - start.translation, abs=1e-15)
        # q and -q are one rotation.
        other = place(end) * np.array([1, 1, 1, -1, -1, -1, -1])
        assert way_between(place(start), other) == pytest.approx(found, abs=1e-12)


def test_nothing_moved_is_nothing_to_the_bit():
    pose = place(random_pose(np.random.default_rng(2)))
    assert not way_between(pose, pose).any()


@pytest.mark.parametrize("time", [0.01, 0.03, 5.0])
@pytest.mark.parametrize("name", ["five_bar", "spatial_arm", "door"])
def test_along_constrained_directions_it_is_the_answer_to_the_other_pose(name, time):
    scene = load_scene(name)
    # Nothing but the joint constraint, so that nothing else answers to the motion.
    springs = ("stiffness", "damping", "angular_stiffness", "angular_damping")
    gains = {"position_channel": dict.fromkeys(springs, 0.0)}
    rng = np.random.default_rng(3)
    task = np.array([1, 1, 0, 0, 0, 1.0]) if scene.task_space == "planar" else np.ones(6)
    ways = 1e-5 * task * rng.normal(size=(2, 6))
    twists = 1e-3 * task * rng.normal(size=(2, 6))
    # Dampers brake first, then springs come in.
    states = zip(ways, twists, np.zeros((2, 6)), strict=True)
    old, new, found = corrected_answers(scene, gains, time, states)
    # log6's second order in steps of 1e-5 rad and m, on 2000 N/m.
    assert np.abs(found - new).max() < 1e-6
    assert scene.name == "spatial_arm" or np.abs(new - old).max() > 1e-3


def test_what_is_not_local_is_not_corrected():
    scene = load_scene("five_bar")
    control = ControlArchitecture(with_loop(scene, False))
    assert not control.gains.local
    sample = Session(scene).tick()
    clutch = engage(0.0, sample.point.pose, sample.point.pose)
    seen = PointMeasurement(sample.point.pose, np.zeros(6), np.zeros(6))
    model = local_model(control, 1.0, clutch, operational_model_of(sample.analysis), seen)
    assert not model.any()
    command = np.ones(6)
    then = np.eye(19)[6]
    assert np.array_equal(corrected(command, model, then, np.ones(19), NO_MEMORY, 1e-3), command)
