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
NONE, PLANE = np.zeros((6, 6)), np.array([1.0, 1.0, 0.0, 0.0, 0.0, 1.0])


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


def test_nothing_is_rigid_on_a_generic_arm_in_space():
    found = analysed("spatial_arm")
    wrench = wrench_of("spatial_arm", found.constraint_projector, np.ones(6), np.ones(6))
    assert np.array_equal(wrench, np.zeros(6))


def test_an_error_that_the_mechanism_can_follow_meets_nothing():
    found = analysed("five_bar")
    following = found.inverse_inertia @ np.array([1.0, 2.0, 0, 0, 0, 0.1])
    following /= np.linalg.norm(following)
    wrench = wrench_of("five_bar", found.constraint_projector, following, following)
    # nᵀ X F = 0 to rounding, times gains of 100.
    assert np.linalg.norm(wrench) < 1e-10 * SOFT["stiffness"]


def test_along_a_constrained_direction_the_gain_is_per_unit_of_the_metrics_mass():
    found = analysed("two_link")
    n = found.constraint_wrenches[:, 0]
    error = np.array([1e-3, 2e-3, 0, 0, 0, 0.01])
    wrench = wrench_of("two_link", found.constraint_projector, error, np.zeros(6))
    # The link weighs 1 kg; n is normalised in the link's metric.
    assert np.linalg.norm(wrench + SOFT["stiffness"] * n * (n @ error)) < 1e-12


def test_spring_and_damper_take_energy_from_the_hand():
    projector = analysed("five_bar").constraint_projector
    rng = np.random.default_rng(2)

    def held(error):
        return 0.5 * SOFT["stiffness"] * error @ projector @ error

    for _ in range(10):
        error, rate = 0.5 * PLANE * rng.normal(size=(2, 6))
        pull = wrench_of("five_bar", projector, error, np.zeros(6))
        step = 1e-6 * PLANE * rng.normal(size=6)
        work = -pull @ step
        gain = held(error + step)
        gain -= held(error - step)
        # The energy is quadratic, so the central difference is exact but for cancellation of
        # terms of up to 1e3 J at 1e-16.
        assert abs(gain / 2.0 - work) < 1e-12
        assert wrench_of("five_bar", projector, np.zeros(6), rate) @ rate <= 0.0


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
