# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The spring that drags: its law, its limit, and that sampling does not make it unstable."""

from __future__ import annotations

import numpy as np
import pytest

from hapticmech_ros import InvalidInputError
from hapticmech_ros.live.grip import DragSpring, drag_spring, on_plane

PLACE, GOAL = np.array((0.1, 0.0, 0.2)), np.array((0.12, -0.01, 0.2))


def test_it_pulls_to_the_goal_and_brakes():
    spring = DragSpring(100.0, 4.0, 50.0)
    velocity = np.array((0.0, 0.5, 0.0))
    assert spring.force(PLACE, velocity, GOAL) == pytest.approx((2.0, -1.0 - 2.0, 0.0))


def test_its_force_keeps_to_the_limit_and_to_its_direction():
    force = DragSpring(1e4, 0.0, 3.0).force(PLACE, np.zeros(3), GOAL)
    assert np.linalg.norm(force) == pytest.approx(3.0)
    assert np.cross(force, GOAL - PLACE) == pytest.approx(np.zeros(3), abs=1e-12)


@pytest.mark.parametrize("mass", [0.001, 0.05, 0.3, 5.0])
@pytest.mark.parametrize("felt", [1.0, 10.0])
def test_a_mass_that_it_drags_comes_to_rest_at_the_goal(mass, felt):
    """However stiff a spring is asked for; semi-implicit Euler is what a tick does to a mass."""
    period = 0.001
    spring = drag_spring(1e5, felt * mass, mass, period, 1e6)
    x, v = PLACE.copy(), np.zeros(3)
    for _ in range(20_000):
        v = v + period / mass * spring.force(x, v, GOAL)
        x = x + period * v
    assert x == pytest.approx(GOAL, abs=1e-6)


@pytest.mark.parametrize("name", ["stiffness", "felt", "moved", "period", "limit"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_numbers_that_are_not_positive_are_refused(name, value):
    given = {"stiffness": 300.0, "felt": 1.0, "moved": 0.3, "period": 0.001, "limit": 20.0}
    with pytest.raises(InvalidInputError, match=f"{name} of a drag: must be positive"):
        drag_spring(**{**given, name: value})


def test_a_ray_of_sight_meets_the_plane():
    eye, seen = np.array((0.0, 0.0, 2.0)), np.array((0.5, 0.25, 1.0))
    assert on_plane(eye, seen, 0.0) == pytest.approx((1.0, 0.5, 0.0))
    assert on_plane(eye, np.array((0.3, 0.1, 0.0)), 0.0) == pytest.approx((0.3, 0.1, 0.0))


@pytest.mark.parametrize("seen", [(1.0, 0.5, 2.0), (1.0, 0.5, 2.001), (0.0, 0.0, 3.0)])
def test_a_ray_that_misses_the_plane_is_put_on_it(seen):
    eye = np.array((0.0, 0.0, 2.0))
    assert on_plane(eye, np.array(seen), 0.5) == pytest.approx((seen[0], seen[1], 0.5))
