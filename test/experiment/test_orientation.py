# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Angles and interpolation of orientations against Pinocchio's exponential map."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.experiment.record import angle_between, slerp


def quaternion(vector):
    return pin.Quaternion(pin.exp3(np.asarray(vector, dtype=float))).coeffs()


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, 0.3, 1.5, 3.0, np.pi])
def test_angle_of_a_known_turn(angle):
    axis = np.array((2.0, -1.0, 0.5)) / np.linalg.norm((2.0, -1.0, 0.5))
    start = np.array((0.1, 0.7, -0.4))
    turned = pin.Quaternion(pin.exp3(angle * axis) @ pin.exp3(start)).coeffs()
    found = angle_between(quaternion(start)[None], turned[None])
    # Components of unit quaternions carry errors of a few epsilon each; the angle doubles them.
    assert found == pytest.approx(angle, abs=4e-15)
    assert angle_between(quaternion(start)[None], -turned[None]) == pytest.approx(angle, abs=4e-15)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("turn", [1e-10, 1e-3, 1.0, 3.0])
def test_slerp_turns_at_constant_rate(turn, sign):
    vector = turn * np.array((0.6, 0.0, 0.8))
    orientations = np.array((quaternion((0, 0, 0)), sign * quaternion(vector)))
    at = np.array((2.0, 2.25, 2.5, 3.0))
    found = slerp(at, np.array((2.0, 3.0)), orientations)
    for row, share in zip(found, (0.0, 0.25, 0.5, 1.0), strict=True):
        expected = quaternion(share * vector)
        assert min(np.abs(row - expected).max(), np.abs(row + expected).max()) < 1e-15


def test_slerp_returns_samples_as_they_are_and_holds_the_ends():
    rng = np.random.default_rng(3)
    orientations = np.array([quaternion(rng.normal(size=3)) for _ in range(20)])
    times = np.cumsum(rng.uniform(0.1, 1.0, 20))
    assert (slerp(times, times, orientations) == orientations).all()
    outside = slerp(np.array((times[0] - 1, times[-1] + 1)), times, orientations)
    assert (outside == orientations[[0, -1]]).all()
    assert (slerp(times, times[:1], orientations[:1]) == orientations[0]).all()
