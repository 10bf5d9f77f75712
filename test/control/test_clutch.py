# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Engagement keeps two poses together from wherever they are; the pose error is the log map."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import logm

from hapticmech_ros.control.clutch import engage, pose_error
from oracles.controllers import random_pose


@pytest.mark.parametrize("seed", range(5))
def test_any_two_poses_engage_without_error_and_share_the_worlds_axes(seed):
    rng = np.random.default_rng(seed)
    device, point = random_pose(rng), random_pose(rng)
    clutch = engage(0.0, device, point)
    # Two products of rotations and one sum of metres: rounding only.
    assert np.abs(pose_error(point, clutch.mapped(device))).max() < 1e-14
    step, turn = rng.normal(size=3), pin.exp3(rng.normal(size=3))
    after = clutch.mapped(pin.SE3(turn @ device.rotation, device.translation + step))
    assert np.abs(after.translation - (point.translation + step)).max() < 1e-14
    assert np.abs(after.rotation - turn @ point.rotation).max() < 1e-14


def test_the_ramp_goes_from_zero_to_one_and_stays():
    clutch = engage(2.0, pin.SE3.Identity(), pin.SE3.Identity(), 0.5)
    times = (1.0, 2.0, 2.25, 2.375, 2.5, 9.0)
    assert [clutch.ramp(time) for time in times] == [0.0, 0.0, 0.0, 0.5, 1.0, 1.0]
    at_once = engage(2.0, pin.SE3.Identity(), pin.SE3.Identity())
    assert at_once.ramp(2.0) == 1.0


def test_forces_act_at_once_at_a_start_and_come_in_with_the_ramp_at_another_grasp():
    start = engage(2.0, pin.SE3.Identity(), pin.SE3.Identity(), 0.5)
    grasp = engage(2.0, pin.SE3.Identity(), pin.SE3.Identity(), 0.5, np.ones(6))
    times = (1.0, 2.0, 2.25, 2.5, 9.0)
    assert [start.force_ramp(time) for time in times] == [1.0] * 5
    for share in (grasp.force_ramp, grasp.ramp, lambda time: grasp.brake(time, 100.0)):
        assert [share(time) for time in times] == [0.0, 0.0, 0.5, 1.0, 1.0]


@pytest.mark.parametrize("rate", [20.0, 130.0, 1e4])
def test_dampers_stop_a_mass_in_half_the_ramp_without_a_peak(rate):
    """1.2 m v / t: of v̇ = -1.2 v / t, t left, comes v = v0 (t / T)^1.2, then a free decay."""
    clutch, v = engage(0.0, pin.SE3.Identity(), pin.SE3.Identity(), 0.5), 1.0
    step, slowed = 1e-5, []
    for number in range(50_000):
        share = clutch.brake(number * step, rate)
        assert 0.0 < share <= 1.0
        slowed.append(rate * share * v)
        v *= np.exp(-rate * share * step)
    assert max(slowed) < 1.2 / 0.25 * 1.001
    half = clutch.brake(0.25, rate)
    assert half == 1.0
    assert v < 0.05


@pytest.mark.parametrize("seed", range(5))
def test_the_error_is_the_log_map_in_world_axes(seed):
    rng = np.random.default_rng(seed)
    point, device = random_pose(rng), random_pose(rng)
    device = pin.SE3(pin.exp3(rng.uniform(-1, 1, 3)) @ point.rotation, device.translation)
    log = np.real(logm(np.linalg.inv(point.homogeneous) @ device.homogeneous))
    body = np.array([log[0, 3], log[1, 3], log[2, 3], log[2, 1], log[0, 2], log[1, 0]])
    expected = np.concatenate((point.rotation @ body[:3], point.rotation @ body[3:]))
    # logm is good to some 1e-14 of its size.
    assert np.abs(pose_error(point, device) - expected).max() < 1e-12
