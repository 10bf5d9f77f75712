# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the device does under the impedance controller: algebra of physics section 5."""

import numpy as np
import pytest

from oracles.control.impedance import impedance_wrench

# Products of 6 x 6 matrices with entries up to about 10: a few hundred rounding errors.
ROUNDING = 1e-12


def random_model(seed, rank):
    """Return Λ_d, X of the given rank, Π onto its null space in a random metric, a_0 and F."""
    rng = np.random.default_rng(seed)

    def positive():
        root = rng.normal(size=(6, 6))
        return root @ root.T + np.eye(6)

    metric = positive()
    # I^½ X I^½ = V diag(μ) Vᵀ with null vectors v: n = I^½ v, Π = Σ n nᵀ I⁻¹.
    lower = np.linalg.cholesky(metric)
    vectors = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    mu = np.concatenate((rng.uniform(0.1, 1.0, rank), np.zeros(6 - rank)))
    back = np.linalg.inv(lower)
    x = back.T @ (vectors * mu) @ vectors.T @ back
    null = lower @ vectors[:, rank:]
    share = null @ null.T @ np.linalg.inv(metric)
    return positive(), x, share, rng.normal(size=6), rng.normal(size=6)


@pytest.mark.parametrize("rank", range(7))
@pytest.mark.parametrize("beta", [0.0, 0.3, 1.0])
def test_the_device_accelerates_as_the_point_and_meets_the_rest_of_the_push(rank, beta):
    inertia, x, share, a0, push = random_model(rank, rank)
    bias = np.arange(6.0)
    u = impedance_wrench(inertia, x, share, a0, push, beta, bias)
    # Λ_d a + bias = F + u
    acceleration = np.linalg.solve(inertia, push + u - bias)
    expected = x @ push + a0 + (1.0 - beta) * np.linalg.solve(inertia, share @ push)
    assert np.abs(acceleration - expected).max() < ROUNDING * 10.0


def test_with_full_feedforward_a_push_on_rigid_joints_moves_nothing():
    inertia, x, share, _, push = random_model(7, 4)
    rigid = share @ push
    u = impedance_wrench(inertia, x, share, np.zeros(6), rigid, 1.0, np.zeros(6))
    assert np.abs(rigid + u).max() < ROUNDING * np.abs(rigid).max() * 100.0


def test_a_mechanism_like_the_device_needs_no_wrench():
    inertia, *_ = random_model(8, 6)
    push = np.array([1.0, -2.0, 3.0, 0.4, 0.5, -0.6])
    x = np.linalg.inv(inertia)
    u = impedance_wrench(inertia, x, np.zeros((6, 6)), np.zeros(6), push, 0.0, np.zeros(6))
    assert np.abs(u).max() < ROUNDING


def test_the_law_is_linear_in_push_and_free_acceleration():
    inertia, x, share, a0, push = random_model(9, 3)

    def law(wrench, accel):
        return impedance_wrench(inertia, x, share, accel, wrench, 0.25, np.zeros(6))

    whole = law(2.0 * push, -3.0 * a0)
    parts = 2.0 * law(push, np.zeros(6)) - 3.0 * law(np.zeros(6), a0)
    assert np.abs(whole - parts).max() < ROUNDING * 100.0
