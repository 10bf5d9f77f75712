# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Joint-constraint controller: only wrenches that joints carry, limited, without a step."""

import numpy as np
import pytest

from hapticmech_ros import Simulator, analyse, load_scene
from hapticmech_ros.control import OperationalModel
from hapticmech_ros.control.kernels import scale_within
from hapticmech_ros.numerics.saturation import limited
from oracles.controllers import answered, control_of

SOFT = {"stiffness": 100.0, "damping": 3.0, "force_limit": 1e9, "torque_limit": 1e9}
NONE = np.zeros((6, 6))


def wrench_of(name, projector, error, rate, **gains):
    """Return the joint constraint's wrench of a scene's control, on a mechanism without motion."""
    model = OperationalModel(NONE, projector, NONE, np.zeros(6))
    return answered(control_of(name, {**SOFT, **gains}), model, error, rate).joint_constraint


def scaled_within(wrench, force_limit, torque_limit):
    cut = wrench.copy()
    scale_within(cut, force_limit, torque_limit)
    return cut


def analysed(name):
    simulator = Simulator(load_scene(name))
    return analyse(simulator.mechanism, simulator.initial_state().q)


@pytest.mark.parametrize("name", ["five_bar", "four_bar_closing", "two_link"])
@pytest.mark.parametrize("limit", [1e9, 1e-3])
def test_it_pushes_only_where_the_mechanism_gives_no_way(name, limit):
    found = analysed(name)
    rng = np.random.default_rng(1)
    limits = {"force_limit": limit, "torque_limit": 0.01 * limit}
    for _ in range(5):
        error, rate = np.zeros(6), np.zeros(6)
        error[[0, 1, 5]], rate[[0, 1, 5]] = rng.normal(size=(2, 3))
        wrench = wrench_of(name, found.constraint_projector, error, rate, **limits)
        assert np.linalg.norm(wrench) > 0.0
        # X n = 0 up to the rounding of X (entries below 1e4 1/(kg m²)) and of n.
        x = found.inverse_inertia
        assert np.linalg.norm(x @ wrench) < 1e-12 * np.linalg.norm(x) * np.linalg.norm(wrench)
        # In the span of N_c: nothing is left after the best fit.
        basis = found.constraint_wrenches
        rest = wrench - basis @ np.linalg.lstsq(basis, wrench, rcond=None)[0]
        assert np.linalg.norm(rest) < 1e-12 * np.linalg.norm(wrench)


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
