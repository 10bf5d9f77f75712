# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rotations inside kernels against Pinocchio's and Eigen's, at every angle."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.numerics import rotation_kernels

PI = np.pi
ANGLES = (
    *(0.0, 1e-300, 1e-160, 1e-12, 1e-8, 1e-5, 1.2e-4, 1.3e-4, 1e-3, 2.4e-3, 2.6e-3, 0.1, 1.0),
    *(2.0, 2.5, 3.0, PI - 0.01, PI - 4e-3, PI - 3e-3, PI - 1e-5, PI - 1e-9, PI - 1e-14),
)
# A few roundings of numbers up to π.
ROUNDING = 4e-15


def called(name, shape, *arguments):
    out = np.full(shape, np.nan)
    getattr(rotation_kernels, name)(*(np.ascontiguousarray(a) for a in arguments), out)
    return out


def axes(seed):
    """Return unit vectors: along axes and in planes of them too."""
    rng = np.random.default_rng(seed)
    units = [*np.eye(3), *-np.eye(3), *(rng.normal(size=(20, 3))), *(1.0 - np.eye(3))]
    return [unit / np.linalg.norm(unit) for unit in units]


def vectors():
    for index, angle in enumerate(ANGLES):
        for axis in axes(index):
            yield angle, angle * axis


@pytest.fixture(scope="module")
def rotations():
    rng = np.random.default_rng(5)
    return [np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(20)]


def test_products(rotations):
    for a, b in pairwise(rotations):
        for name, expected in (
            ("multiply", a @ b),
            ("multiply_transposed", a @ b.T),
        ):
            assert np.abs(called(name, (3, 3), a, b) - expected).max() < ROUNDING


def test_exponential_is_pinocchios():
    for angle, vector in [*vectors(), (4.0, np.array([0.0, 4.0, 0.0])), (9.0, np.full(3, 27**0.5))]:
        found = called("exp3", (3, 3), vector)
        assert np.abs(found - pin.exp3(vector)).max() < ROUNDING, angle


def test_logarithm_undoes_the_exponential():
    for angle, vector in vectors():
        found = called("log3", 3, pin.exp3(vector))
        off = np.abs(found - vector).max()
        if angle > PI - 1e-10:
            # The axis of half a turn may point either way.
            off = min(off, np.abs(found + vector).max())
        # A rotation's own rounding is 1e-16 of its largest sine, or where that is small of 1.
        assert off <= ROUNDING * min(angle, 1.0) + 1e-16 * (angle > 1e-4), angle


def test_half_a_turn_has_the_same_axis_as_pinocchios():
    for axis in axes(1):
        rotation = 2.0 * np.outer(axis, axis) - np.eye(3)
        found = called("log3", 3, rotation)
        assert np.abs(found - pin.log3(rotation)).max() < 1e-13
        assert abs(np.linalg.norm(found) - PI) < ROUNDING


def test_logarithm_of_what_is_no_longer_orthogonal_is_pinocchios(rotations):
    bend = 1e-7 * np.sin(np.arange(9.0)).reshape(3, 3)
    for rotation in rotations:
        bent = rotation * np.sign(np.linalg.det(rotation)) + bend
        # Both make it orthogonal but for squares of the bend.
        expected = pin.log3(bent)
        lost = 1e-15 / np.sin(np.linalg.norm(expected)) ** 2
        assert np.abs(called("log3", 3, bent) - expected).max() < 1e-13 + lost
        assert np.abs(expected - pin.log3(bent - bend)).max() > 1e-9


def test_quaternion_is_eigens_and_so_is_the_way_back():
    negative = 0
    for angle, vector in [*vectors(), *((2.5, -2.5 * a) for a in axes(3))]:
        rotation = pin.exp3(vector)
        expected = pin.Quaternion(rotation).coeffs()
        found = called("quaternion_of", 4, rotation)
        negative += found[3] < 0.0
        assert np.abs(found - expected).max() < ROUNDING, angle
        for length in (1.0, 0.37):
            back = called("rotation_of", (3, 3), length * found)
            assert np.abs(back - rotation).max() < ROUNDING, angle
    assert negative > 5


def test_angular_rate_is_the_left_jacobian_times_the_rate():
    rng = np.random.default_rng(2)
    for angle, vector in vectors():
        rate = rng.normal(size=3)
        found = called("angular_rate", 3, vector, rate)
        # Pinocchio has the sign of θ²/24 wrong below 1.2e-4.
        slip = angle**3 / 12.0 * np.linalg.norm(rate) if angle < 1.3e-4 else 0.0
        assert np.abs(found - pin.Jexp3(-vector) @ rate).max() < ROUNDING + slip, angle
