# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A hand's wrench until the next sample, and the weight of what a device adds for it."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.linalg import eigh

from hapticmech_ros.control.force_gain import force_gain, lead_gain
from hapticmech_ros.control.hand_lead_kernels import (
    MEMORY_SIZE,
    MOST,
    mean_change,
    remember_wrench,
)
from hapticmech_ros.control.passivity import corrected
from hapticmech_ros.layout import DEVICE_SAMPLE

PERIOD = 1e-3
PUSH = DEVICE_SAMPLE.slice("hand_wrench")


def remembered(wrenches, spacings):
    """Return a memory of wrenches (n, 6), oldest first, and the times between them."""
    memory = np.zeros(MEMORY_SIZE)
    for wrench, spacing in zip(wrenches, (99.0, *spacings), strict=True):
        remember_wrench(memory, spacing, np.asarray(wrench, dtype=float))
    return memory


def change(memory, start=0.0, period=PERIOD):
    found = np.empty(6)
    mean_change(memory, start, period, found)
    return found


@pytest.mark.parametrize("start", [0.0, 0.4e-3])
@pytest.mark.parametrize("spacings", [(1e-3, 1e-3), (1.2e-3, 2e-3), (5e-3, 1e-3)])
def test_a_parabola_is_carried_on_as_it_is(spacings, start):
    """Against its integral, for samples that are evenly apart, and for some that are not."""
    curve = Polynomial([0.7, -30.0, 2e4])
    times = -np.array([spacings[0] + spacings[1], spacings[1], 0.0])
    memory = remembered([np.full(6, curve(time)) for time in times], spacings)
    whole = curve.integ()
    mean = (whole(start + PERIOD) - whole(start)) / PERIOD
    assert change(memory, start) == pytest.approx(np.full(6, mean - curve(0.0)), rel=1e-12)


def test_evenly_spaced_it_has_the_weights_of_adams_and_bashforth():
    wrenches = np.random.default_rng(1).normal(size=(5, 6))
    found = change(remembered(wrenches, [PERIOD] * 4))
    weights = np.array([5.0, -16.0, 23.0]) / 12.0
    assert found + wrenches[-1] == pytest.approx(weights @ wrenches[-3:], rel=1e-12)


def test_what_is_not_known_is_not_carried_on():
    wrenches = np.random.default_rng(2).normal(size=(MOST, 6))
    assert not change(np.zeros(MEMORY_SIZE)).any()
    assert not change(remembered(wrenches[:1], [])).any()
    two = change(remembered(wrenches[:2], [PERIOD]))
    assert two == pytest.approx(0.5 * (wrenches[1] - wrenches[0]), rel=1e-12)
    # Two samples that come at nearly the same time: their noise is not made more of.
    close = change(remembered(wrenches[:2], [1e-9]))
    assert close == pytest.approx(two, rel=1e-12)


@pytest.mark.parametrize("mass", [0.02, 0.3, 5.0, 300.0])
def test_a_device_leads_where_the_mechanism_is_heavy(mass):
    """Of a mass m on m_d: G = m_d / m - 1, W = 1 / (1 + (m_d / m)⁶)."""
    device = np.diag([0.3] * 3 + [3e-4] * 3)
    gain = force_gain(device, np.diag([1.0 / mass] * 3 + [0.0] * 3), np.zeros((6, 6)), 1.0)
    ratio = 0.3 / mass
    weight = [(ratio - 1.0) / (1.0 + ratio**6)] * 3 + [-1.0] * 3
    assert lead_gain(gain) == pytest.approx(np.diag(weight), rel=1e-12)
    # Never more than that of a force against which the mechanism does not move.
    assert np.abs(np.linalg.eigvals(lead_gain(gain))).max() <= 1.0 + 1e-12


def test_what_is_added_is_the_gain_s_function_by_its_eigenvectors():
    """The elimination in the kernel, against eigenvalues of Λ_d^½ X Λ_d^½."""
    rng = np.random.default_rng(3)
    none, command = np.zeros((6, 6)), rng.normal(size=6)
    for _ in range(50):
        inertia = np.diag([rng.uniform(0.05, 0.5)] * 3 + [rng.uniform(1e-4, 1e-3)] * 3)
        root = rng.normal(size=(6, 6)) * 10.0 ** rng.uniform(-2, 0.5)
        inverse = root @ root.T
        gain = force_gain(inertia, inverse, none, 1.0)
        half = np.sqrt(inertia)
        values, vectors = eigh(half @ inverse @ half)
        of_values = (values - 1.0) / (1.0 + values**6)
        wanted = half @ (vectors * of_values) @ vectors.T @ np.linalg.inv(half)
        wrenches = rng.normal(size=(3, 6))
        memory = remembered(wrenches, [PERIOD] * 2)
        model = np.concatenate((gain.ravel(), np.zeros(72)))
        sample = np.zeros(DEVICE_SAMPLE.size)
        sample[6] = 1.0
        sample[PUSH] = wrenches[-1]
        found = corrected(command, model, sample, sample, memory, PERIOD)
        expected = command + wanted @ change(memory)
        # Rounding of 1 + (1 + G)⁶, with the square root of the device's inertias on both sides.
        rounding = 1e-13 * (1.0 + values[-1]) ** 6
        assert found == pytest.approx(expected, abs=rounding * np.abs(expected).max())
        assert lead_gain(gain) == pytest.approx(wanted, abs=rounding * np.abs(wanted).max())


def test_a_device_that_closes_no_force_channel_adds_nothing():
    memory = remembered(np.random.default_rng(4).normal(size=(3, 6)), [PERIOD] * 2)
    sample, command = np.eye(DEVICE_SAMPLE.size)[6], np.ones(6)
    model = np.zeros(108)
    assert np.array_equal(corrected(command, model, sample, sample, memory, PERIOD), command)


def test_a_gain_that_no_mechanism_has_leads_nothing():
    """(1 + G)⁶ may be -1 if somebody says so."""
    gain = np.zeros((6, 6))
    gain[:2, :2] = [[-1.0, -1.0], [1.0, -1.0]]
    memory = remembered(np.random.default_rng(5).normal(size=(3, 6)), [PERIOD] * 2)
    sample = np.eye(DEVICE_SAMPLE.size)[6]
    model = np.concatenate((gain.ravel(), np.zeros(72)))
    found = corrected(np.ones(6), model, sample, sample, memory, PERIOD)
    assert np.array_equal(found, np.ones(6))
