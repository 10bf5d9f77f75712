# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mass felt as an ellipsoid: axes where Newton's law says, flat in a plane, cut off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hapticmech_ros import Mechanism, Simulator, analyse, load_scene
from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.operational.results import felt_masses
from hapticmech_ros.view.shapes import mass_ellipsoid


def analysed(name):
    scene = load_scene(name)
    state = Simulator(scene).initial_state()
    return analyse(Mechanism(scene), state.q)


@pytest.mark.parametrize("name", shipped_scenes())
def test_a_force_along_an_axis_accelerates_along_it_by_its_mass(name):
    found = analysed(name)
    masses, directions = felt_masses(found)
    assert (np.sort(masses) == masses).all()
    for mass, direction in zip(masses, directions.T, strict=True):
        response = found.inverse_inertia[:3, :3] @ direction
        largest = np.abs(found.inverse_inertia[:3, :3]).max()
        assert response == pytest.approx(direction / mass, abs=1e-8 * largest)


def test_half_axes_are_in_proportion_and_cut_off_where_rigid():
    found = analysed("spatial_arm")
    masses, directions = felt_masses(found)
    place = np.array((0.1, 0.2, 0.3))
    (shape,) = mass_ellipsoid(found, place, 0.01, 1e3)
    assert shape.size == pytest.approx(2.0 * 0.01 * masses)
    assert shape.pose.translation == pytest.approx(place)
    assert np.linalg.det(shape.pose.rotation) == pytest.approx(1.0)
    assert np.abs((shape.pose.rotation * directions).sum(axis=0)) == pytest.approx(np.ones(3))
    rigid = replace(found, inverse_inertia=np.zeros((6, 6)))
    assert np.isinf(felt_masses(rigid)[0]).all()
    (shape,) = mass_ellipsoid(rigid, place, 0.01, 0.5)
    assert shape.size == pytest.approx((1.0, 1.0, 1.0))


def test_a_planar_scene_has_a_disc():
    (shape,) = mass_ellipsoid(analysed("five_bar"), np.zeros(3), 0.01, 0.5)
    assert np.abs(shape.pose.rotation[:, 2]) == pytest.approx((0.0, 0.0, 1.0))
    assert shape.size[2] < 0.1 * 0.5
