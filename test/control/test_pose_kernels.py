# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses in kernels against Pinocchio's: the logarithm at every angle, and carrying on."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.control.kernels import carry_on, follow, log6, turn_between
from hapticmech_ros.control.measurements import carried_on
from hapticmech_ros.numerics.layout import Pose
from oracles.generator import unit

# Rotations are good to a few 1e-16; a logarithm is no worse conditioned than 1 + θ²/12 < 2.
CLOSE = 1e-14
# Around the border between series and closed form too, at θ² = 1e-3.
ANGLES = (0.0, 1e-300, 1e-12, 1e-8, 1e-5, 1e-3, 0.0316, 0.0317, 0.3, 1.0, 2.0, 3.0)
NEAR_PI = tuple(np.pi - gap for gap in (1e-1, 1e-2, 1e-4, 1e-6, 1e-9, 1e-12))


def quaternion(rotation):
    return pin.Quaternion(np.asarray(rotation)).coeffs().copy()


def matrix(turn):
    return pin.Quaternion(turn / np.linalg.norm(turn)).matrix()


@pytest.mark.parametrize("angle", [*ANGLES, *NEAR_PI])
def test_the_logarithm_undoes_the_exponential(angle):
    rng = np.random.default_rng(2)
    for _ in range(30):
        twist = np.concatenate((rng.normal(size=3), angle * unit(rng)))
        pose = pin.exp6(twist)
        found = np.empty(6)
        log6(quaternion(pose.rotation), pose.translation.copy(), found)
        # Pinocchio's own coefficients lose a digit or two just above θ = 1e-4.
        bound = 10.0 * CLOSE if 1e-4 < angle < 0.02 else CLOSE
        assert np.abs(found - twist).max() < bound


@pytest.mark.parametrize("angle", [1e-5, 0.031, 0.0316, 0.0317])
def test_series_and_closed_form_meet(angle):
    """A quarter turn about the way there: what β contributes, in units of its own size."""
    omega, way = np.array([0.0, 0.0, angle]), np.array([1.0, 0.0, 0.0])
    found = np.empty(6)
    log6(quaternion(pin.exp3(omega)), way, found)
    # θ/2 cot θ/2 along the way, -θ/2 across it.
    half = 0.5 * angle
    assert abs(found[0] - half / np.tan(half)) < 1e-15
    assert abs(found[1] + half) < 1e-15


@pytest.mark.parametrize("length", [-2.0, -1.0, 0.5, 1.0009])
def test_neither_length_nor_sign_of_a_quaternion_matters(length):
    rng = np.random.default_rng(3)
    for _ in range(30):
        turn = quaternion(pin.exp3(rng.uniform(0.0, np.pi) * unit(rng)))
        way, found, other = rng.normal(size=3), np.empty(6), np.empty(6)
        log6(turn, way, found)
        log6(length * turn, way, other)
        assert np.abs(found - other).max() < CLOSE


def test_products_are_those_of_matrices():
    rng = np.random.default_rng(4)
    for _ in range(50):
        one, other = (np.asarray(pin.exp3(3.0 * unit(rng))) for _ in range(2))
        found = np.empty(4)
        follow(quaternion(one), quaternion(other), found)
        assert np.abs(matrix(found) - one @ other).max() < CLOSE
        turn_between(quaternion(one), quaternion(other), found)
        assert np.abs(matrix(found) @ one - other).max() < CLOSE


def test_equal_rotations_have_nothing_between_them():
    rng = np.random.default_rng(5)
    for _ in range(200):
        turn, found = rng.normal(size=4), np.empty(4)
        turn_between(turn, turn.copy(), found)
        assert (found[:3] == 0.0).all()
        assert found[3] > 0.0


@pytest.mark.parametrize("duration", [0.0, 1e-9, 0.005, -0.005, 1.0])
def test_a_pose_is_carried_on_as_before(duration):
    rng = np.random.default_rng(6)
    for _ in range(50):
        pose = pin.SE3(np.asarray(pin.exp3(rng.uniform(0.0, np.pi) * unit(rng))), unit(rng))
        place, twist, found = pin.SE3ToXYZQUAT(pose), rng.normal(size=6), Pose()
        carry_on(place[:3], place[3:], twist, duration, found)
        expected = carried_on(pose, twist, duration)
        assert np.abs(matrix(found.quaternion) - expected.rotation).max() < CLOSE
        assert np.abs(found.position - expected.translation).max() < CLOSE


@pytest.mark.parametrize(("twist", "duration"), [(np.zeros(6), 0.3), (np.ones(6), 0.0)])
def test_a_pose_at_rest_or_at_once_stays_to_the_bit(twist, duration):
    place, found = pin.SE3ToXYZQUAT(pin.SE3.Random()), Pose()
    carry_on(place[:3], place[3:], twist, duration, found)
    assert (found.values == place).all()
