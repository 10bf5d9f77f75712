# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Limits of the joint constraint's wrench, and of others: they hold, and directions stay."""

import numpy as np
import pytest

from hapticmech_ros.control.kernels import scale_within
from hapticmech_ros.numerics.saturation import limited


def scaled_within(wrench, force_limit, torque_limit):
    cut = wrench.copy()
    scale_within(cut, force_limit, torque_limit)
    return cut


@pytest.mark.parametrize(
    ("force", "torque"), [(0.5, 0.5), (3.0, 0.5), (0.5, 3.0), (30.0, 3.0), (3.0, 30.0)]
)
def test_limits_hold_and_directions_stay(force, torque):
    direction = np.array([2.0, -1.0, 2.0, 0.6, 0.0, 0.8]) / np.array([3.0] * 3 + [1.0] * 3)
    wrench = direction * np.array([force] * 3 + [torque] * 3)
    apart, whole = limited(wrench, 1.0, 1.0), scaled_within(wrench, 1.0, 1.0)
    for cut in (apart, whole):
        assert np.linalg.norm(cut[:3]) <= 1.0 + 1e-15
        assert np.linalg.norm(cut[3:]) <= 1.0 + 1e-15
    kept = np.array([min(force, 1.0)] * 3 + [min(torque, 1.0)] * 3)
    assert np.abs(apart - direction * kept).max() < 1e-15
    assert np.abs(whole - wrench / max(force, torque, 1.0)).max() < 1e-15


def test_a_wrench_within_limits_is_left_alone_to_the_bit():
    wrench = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    assert np.array_equal(limited(wrench, 1.0, 1.0), wrench)
    assert np.array_equal(scaled_within(wrench, 1.0, 1.0), wrench)
    assert np.array_equal(scaled_within(np.zeros(6), 1.0, 1.0), np.zeros(6))
