# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Named frames: where the oracle says, each name once, and everything hangs on world."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.loading import load_scene
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.view import Placer, fixed_frames, moving_frames
from hapticmech_ros.view.placement import frame_names
from oracles.generator import random_mechanism
from oracles.kinematics import link_poses, point_pose

DEVICE = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2, 0.5), np.array((0.1, 0.2, 0.3)))


def under_world(frames):
    """Return the pose in the world of every frame, following parents as tf does."""
    parents = {frame.child: frame for frame in frames}
    assert len(parents) == len(frames), "a frame has two parents"

    def pose(name):
        if name == "world":
            return np.eye(4)
        frame = parents[name]
        return pose(frame.parent) @ frame.pose.homogeneous

    return {name: pose(name) for name in parents}


def matrix(pose):
    return pin.SE3(*pose).homogeneous


@pytest.mark.parametrize("seed", range(8))
def test_frames_are_where_the_oracle_says(seed):
    sample = random_mechanism(seed, closed=False)
    scene = scene_from_document(sample.document)
    placement = Placer(Mechanism(scene)).at(sample.q)
    poses = under_world([*moving_frames(scene, placement, {"": DEVICE}), *fixed_frames(scene)])
    links = link_poses(sample.document, sample.q)
    # The oracle multiplies other matrices in another order: a few roundings per link.
    for name, pose in links.items():
        if name != "world":
            assert np.abs(poses[name] - matrix(pose)).max() < 1e-12
    for index, name in enumerate(("tip", "middle")):
        expected = matrix(point_pose(sample.document, sample.q, index))
        assert np.abs(poses[name] - expected).max() < 1e-12
        upright = poses[f"{name}_world"]
        assert np.array_equal(upright[:3, :3], np.eye(3))
        assert np.abs(upright[:3, 3] - expected[:3, 3]).max() < 1e-12
    assert np.array_equal(poses["device"], DEVICE.homogeneous)
    assert np.array_equal(poses["device_world"][:3, 3], DEVICE.translation)
    assert np.array_equal(poses["device_world"][:3, :3], np.eye(3))


def test_without_a_device_there_is_no_frame_of_it():
    scene = load_scene("five_bar")
    placement = Placer(Mechanism(scene)).at(np.zeros(4))
    names = {frame.child for frame in moving_frames(scene, placement)}
    assert names == {"link1", "link2", "link3", "link4", "handle_world"}


def test_names_that_a_link_has_already_are_told_apart():
    scene = load_scene("two_link")
    point = scene.operational_points[0]
    renamed = scene.model_copy(
        update={
            "operational_points": (
                point.model_copy(update={"name": "link2"}),
                point.model_copy(update={"name": "device"}),
            )
        }
    )
    names = frame_names(renamed)
    assert names["link2"] == "link2_frame"
    placement = Placer(Mechanism(renamed)).at(np.zeros(2))
    frames = [*moving_frames(renamed, placement), *fixed_frames(renamed)]
    children = [frame.child for frame in frames]
    assert len(set(children)) == len(children)


def test_devices_of_several_users_have_the_users_names():
    scene = load_scene("five_bar")
    placement, users = Placer(Mechanism(scene)).at(np.zeros(4)), ["left/", "right/"]
    found = moving_frames(scene, placement, {"right/": DEVICE}, users)
    poses = {frame.child: frame.pose for frame in found}
    assert {name for name in poses if "device" in name} == {"right/device", "right/device_world"}
    assert poses["right/device"] == DEVICE
