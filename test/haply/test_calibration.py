# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a base stands in the world, from two movements."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.haply.reader import mounting_of, reach_of


@pytest.mark.parametrize("seed", range(20))
def test_the_rotation_is_found_from_movements_of_any_length(seed):
    chance = np.random.default_rng(seed)
    rotation = pin.Quaternion(*chance.standard_normal(4)).normalized().toRotationMatrix()
    start = chance.uniform(-0.2, 0.2, 3)
    ends = [start + rotation.T @ (axis * chance.uniform(0.06, 0.2)) for axis in np.eye(3)[:2]]
    found = mounting_of(start, *ends)
    assert found.rotation == pytest.approx(rotation, abs=1e-12)
    assert found.skew == pytest.approx(0.0, abs=1e-7)
    assert pin.rpy.rpyToMatrix(*found.angles) == pytest.approx(rotation, abs=1e-9)


def test_an_error_of_the_angle_is_shared_by_both_axes():
    skew = np.deg2rad(8.0)
    ends = (0.1, 0.0, 0.0), (-0.1 * np.sin(skew), 0.1 * np.cos(skew), 0.0)
    found = mounting_of(np.zeros(3), *ends)
    assert found.skew == pytest.approx(skew)
    assert pin.log3(found.rotation) == pytest.approx([0.0, 0.0, -0.5 * skew])
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("along_x", "along_y", "named"),
    [
        ((0.03, 0.0, 0.0), (0.0, 0.1, 0.0), "along x"),
        ((0.1, 0.0, 0.0), (0.0, np.nan, 0.0), "along y"),
        ((0.1, 0.0, 0.0), (0.1, 0.1, 0.0), "angle"),
    ],
)
def test_movements_that_say_too_little_are_refused(along_x, along_y, named):
    with pytest.raises(InvalidInputError, match=named):
        mounting_of(np.zeros(3), np.array(along_x), np.array(along_y))


def test_the_reach_is_the_ball_in_the_box_of_the_path():
    path = np.array([[0.0, -0.1, 0.2], [0.2, 0.1, 0.5], [0.1, 0.0, 0.3]])
    middle, radius = reach_of(path)
    assert middle == pytest.approx([0.1, 0.0, 0.35])
    assert radius == pytest.approx(0.1)
