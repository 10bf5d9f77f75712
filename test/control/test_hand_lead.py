# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A hand's wrench until the next sample, and the weight of what a device adds for it."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from hapticmech_ros.control.force_gain import force_gain, lead_gain
from hapticmech_ros.control.hand_lead_kernels import (
    MEMORY_SIZE,
    MOST,
    SHARED,
    TOGETHER,
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


def parts(memory, start=0.0, period=PERIOD):
    """Return F' and F'' (6,) each."""
    found = np.empty(12)
    mean_change(memory, start, period, found)
    return found[:6], found[6:]


def change(memory, start=0.0, period=PERIOD):
    return sum(parts(memory, start, period))


def weights(ratio, others=0):
    """Return W along a direction with R, and the weight of Δ of so many other hands."""
    whole = 1.0 / (1.0 + ratio**6)
    return whole, whole * (1.0 - SHARED * others**TOGETHER * ratio**2)


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


@pytest.mark.parametrize("others", [0, 1, 3])
@pytest.mark.parametrize("lightest", [1.0, 1e4])
def test_what_is_added_is_the_gain_s_function_by_its_eigenvectors(others, lightest):
    """The eliminations in the kernel, against eigenvalues of Λ_d^½ X Λ_d^½.

    Also where a direction is so light that R⁶ of it would leave nothing of all the others.
    """
    rng = np.random.default_rng(3)
    none, command = np.zeros((6, 6)), rng.normal(size=6)
    for _ in range(50):
        inertia = np.diag([rng.uniform(0.05, 0.5)] * 3 + [rng.uniform(1e-4, 1e-3)] * 3)
        half, turn = np.sqrt(inertia), np.linalg.qr(rng.normal(size=(6, 6)))[0]
        values = np.array([*10.0 ** rng.uniform(-2.0, 0.5, 5), lightest])
        back = np.linalg.inv(half)
        inverse = back @ (turn * values) @ turn.T @ back
        gain = force_gain(inertia, inverse, none, 1.0)
        wrenches, carried = rng.normal(size=(3, 6)), 0.1 * rng.normal(size=6) * (others > 0)
        memory = remembered(wrenches, [PERIOD] * 2)
        model = np.concatenate((gain.ravel(), np.zeros(72)))
        sample = np.zeros(DEVICE_SAMPLE.size)
        sample[6] = 1.0
        sample[PUSH] = wrenches[-1]
        told = np.array([*np.zeros(6), *carried, others])
        found = corrected(command, model, sample, sample, memory, PERIOD, told)

        def of(function, half=half, turn=turn, back=back):
            return half @ (turn * function) @ turn.T @ back

        own, theirs = weights(values, others)
        led = of(own * (values - 1.0))
        expected = led @ change(memory) + of(theirs) @ carried
        # Rounding of R², with the square root of the device's inertias on both sides.
        rounding = 1e-13 * (1.0 + values.max()) ** 2
        size = np.abs(expected).max()
        assert found - command == pytest.approx(expected, abs=rounding * size + 1e-14)
        if lightest == 1.0:
            assert lead_gain(gain) == pytest.approx(led, abs=1e-9 * np.abs(led).max())


def answers(ratio, others):
    """Return what a command answers of F_h's last three samples, and of others' last two (3,).

    Of a kernel's numbers along x, for samples of 1 N each by itself.
    """
    model = np.zeros(108)
    model[0] = ratio - 1.0
    own, theirs = np.zeros((2, 3))
    sample = np.eye(DEVICE_SAMPLE.size)[6]
    for age in range(3):
        wrenches = np.zeros((3, 6))
        wrenches[2 - age, 0] = 1.0
        memory = remembered(wrenches, [PERIOD] * 2)
        sample[PUSH] = wrenches[-1]
        told = np.zeros(13)
        own[age] = corrected(np.zeros(6), model, sample, sample, memory, PERIOD, told)[0]
        line = parts(memory)[0]
        told[6:] = *(ratio * line), others
        memory = np.zeros(MEMORY_SIZE)
        theirs[age] = corrected(np.zeros(6), model, sample, sample, memory, PERIOD, told)[0]
    # A command answers the newest sample itself as well.
    own[0] += ratio - 1.0
    theirs[0] += ratio
    return own, theirs


def largest_root(answer, share):
    """Return the largest |z| of F(k + 1) = -r u(k), where u(k) answers F(k) to F(k - 2)."""
    return np.abs(np.roots([1.0, *(share * np.asarray(answer))])).max()


@pytest.mark.parametrize("others", [1, 2, 3, 5, 7])
def test_masses_on_several_devices_do_not_drive_each_other(others):
    """K + 1 equal devices with a share r = m_a / (m_a + m_d) of a rigid mass, on one light body.

    A mass exerts -r u on its device by a command u. In the sum of all, a command answers its own
    sample and K times another's, in a difference its own less another's.
    """
    checked = 0
    for ratio in np.linspace(0.02, 3.0, 150):
        own, theirs = answers(ratio, others)
        ways = own + others * theirs, own - theirs
        plain = (ratio - 1.0) + others * ratio, -1.0
        for share in (0.05, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 0.99, 0.999):
            if max(abs(share * one) for one in plain) < 1.0:
                assert max(largest_root(way, share) for way in ways) < 1.0
                checked += 1
    assert checked > 300


def test_a_device_that_closes_no_force_channel_adds_nothing():
    memory = remembered(np.random.default_rng(4).normal(size=(3, 6)), [PERIOD] * 2)
    sample, command = np.eye(DEVICE_SAMPLE.size)[6], np.ones(6)
    model = np.zeros(108)
    assert np.array_equal(corrected(command, model, sample, sample, memory, PERIOD), command)


def test_a_gain_that_no_mechanism_has_leads_nothing():
    """R⁶ may be -1 if somebody says so."""
    gain = np.zeros((6, 6))
    gain[:2, :2] = [[-1.0, -1.0], [1.0, -1.0]]
    memory = remembered(np.random.default_rng(5).normal(size=(3, 6)), [PERIOD] * 2)
    sample = np.eye(DEVICE_SAMPLE.size)[6]
    model = np.concatenate((gain.ravel(), np.zeros(72)))
    found = corrected(np.ones(6), model, sample, sample, memory, PERIOD)
    assert np.array_equal(found, np.ones(6))
