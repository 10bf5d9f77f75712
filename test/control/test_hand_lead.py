# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A hand's wrench until the next sample, and the weight of what a device adds for it."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from hapticmech_ros.control.account_kernels import MOST, change_of_mean, remember
from hapticmech_ros.control.loop_layout import HandMemory, MeanChange
from hapticmech_ros.control.loop_stability import force_gain, lead_gains
from hapticmech_ros.control.passivity import corrected
from hapticmech_ros.numerics.layout import DeviceSample

PERIOD = 1e-3
PUSH = DeviceSample.layout.slice("hand_wrench")


def remembered(wrenches, spacings):
    """Return a memory of wrenches (n, 6), oldest first, and the times between them."""
    memory = HandMemory().values
    for wrench, spacing in zip(wrenches, (99.0, *spacings), strict=True):
        remember(HandMemory(memory), spacing, np.asarray(wrench, dtype=float))
    return memory


def parts(memory, start=0.0, period=PERIOD):
    """Return F' and F'' (6,) each."""
    found = MeanChange()
    change_of_mean(HandMemory(memory), start, period, found)
    return found.line, found.bend


def change(memory, start=0.0, period=PERIOD):
    return sum(parts(memory, start, period))


def bend_weight(ratio, others=0):
    """Return W along a direction with 1 + G, of a device with so many others."""
    square = ((others + 1) * ratio) ** 2
    return (1.0 - 1.6 * square) / (1.0 + 2.0 * square)


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


def test_what_is_not_known_is_not_carried_on():
    wrenches = np.random.default_rng(2).normal(size=(MOST, 6))
    assert not change(HandMemory().values).any()
    assert not change(remembered(wrenches[:1], [])).any()
    two = change(remembered(wrenches[:2], [PERIOD]))
    assert two == pytest.approx(0.5 * (wrenches[1] - wrenches[0]), rel=1e-12)
    # Two samples that come at nearly the same time: their noise is not made more of.
    close = change(remembered(wrenches[:2], [1e-9]))
    assert close == pytest.approx(two, rel=1e-12)


@pytest.mark.parametrize("others", [0, 1, 3])
@pytest.mark.parametrize("lightest", [1.0, 1e4])
def test_what_is_added_is_the_gain_s_function_by_its_eigenvectors(others, lightest):
    """The elimination in the kernel, against eigenvalues of Λ_d^½ X Λ_d^½."""
    rng = np.random.default_rng(3)
    none, command = np.zeros((6, 6)), rng.normal(size=6)
    for _ in range(50):
        inertia = np.diag([rng.uniform(0.05, 0.5)] * 3 + [rng.uniform(1e-4, 1e-3)] * 3)
        half, turn = np.sqrt(inertia), np.linalg.qr(rng.normal(size=(6, 6)))[0]
        values = np.array([*10.0 ** rng.uniform(-2.0, 0.5, 5), lightest])
        back = np.linalg.inv(half)
        inverse = back @ (turn * values) @ turn.T @ back
        gain = force_gain(inertia, inverse, none, 1.0)
        wrenches, carried = rng.normal(size=(3, 6)), rng.normal(size=(2, 6)) * (others > 0)
        memory = remembered(wrenches, [PERIOD] * 2)
        model = np.concatenate((gain.ravel(), np.zeros(72)))
        sample = np.zeros(DeviceSample.layout.size)
        sample[6] = 1.0
        sample[PUSH] = wrenches[-1]
        told = np.array([*np.zeros(6), *carried.ravel(), others])
        found = corrected(command, model, sample, sample, memory, PERIOD, told)

        def of(function, half=half, turn=turn, back=back):
            return half @ (turn * function) @ turn.T @ back

        line, bend = parts(memory)
        own, weight = values - 1.0, bend_weight(values, others)
        expected = of(own) @ line + carried[0] + of(own * weight) @ bend + of(weight) @ carried[1]
        # Rounding of R², with the square root of the device's inertias on both sides.
        rounding = 1e-13 * (1.0 + values.max()) ** 2
        size = np.abs(expected).max()
        assert found - command == pytest.approx(expected, abs=rounding * size + 1e-14)
        if lightest == 1.0 and not others:
            assert lead_gains(gain)[0] == pytest.approx(of(own), abs=1e-9)
            assert lead_gains(gain)[1] == pytest.approx(of(own * weight), abs=1e-9)


def answers(ratio, others):
    """Return what a command answers of F_h's last three samples, and of another's (3,).

    Of a kernel's numbers along x, for samples of 1 N each by itself.
    """
    model = np.zeros(108)
    model[0] = ratio - 1.0
    own, theirs = np.zeros((2, 3))
    sample = np.eye(DeviceSample.layout.size)[6]
    for age in range(3):
        wrenches = np.zeros((3, 6))
        wrenches[2 - age, 0] = 1.0
        memory = remembered(wrenches, [PERIOD] * 2)
        sample[PUSH] = wrenches[-1]
        told = np.zeros(19)
        told[18] = others
        own[age] = corrected(np.zeros(6), model, sample, sample, memory, PERIOD, told)[0]
        told[6:18] = ratio * np.concatenate(parts(memory))
        memory = HandMemory().values
        theirs[age] = corrected(np.zeros(6), model, sample, sample, memory, PERIOD, told)[0]
    # A command answers the newest sample itself as well.
    own[0] += ratio - 1.0
    theirs[0] += ratio
    return own, theirs


def largest_root(answer, share):
    """Return the largest |z| of F(k + 1) = -r u(k), where u(k) answers F(k) to F(k - 2)."""
    return np.abs(np.roots([1.0, *(share * np.asarray(answer))])).max()


@pytest.mark.parametrize("others", [0, 1, 2, 3, 5, 7])
def test_masses_on_several_devices_do_not_drive_each_other(others):
    """K + 1 equal devices with a share r = m_a / (m_a + m_d) of a rigid mass, on one light body.

    A mass exerts -r u on its device by a command u. In the sum of all, a command answers its own
    sample and K times another's, in a difference its own less another's.
    """
    checked = 0
    for ratio in np.geomspace(0.01, 5.0, 150):
        own, theirs = answers(ratio, others)
        ways = (own + others * theirs, own - theirs) if others else (own,)
        plain = ((others + 1) * ratio - 1.0, -1.0)[: len(ways)]
        for share in (0.05, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 0.99, 0.999):
            if max(abs(share * one) for one in plain) < 1.0:
                assert max(largest_root(way, share) for way in ways) < 1.0
                checked += 1
    assert checked > 300


def loop_of(told, shares):
    """Return the largest |z| of masses' wrenches F_i(k + 1) = -r_i u_i(k) on several devices.

    ``told`` (n, n, 3) says what each command answers of each hand's last three samples.
    """
    count = len(shares)
    step = np.eye(3 * count, k=-count)
    step[:count] = np.hstack([-shares[:, None] * told[:, :, age] for age in range(3)])
    return np.abs(np.linalg.eigvals(step)).max()


def test_nor_do_masses_on_devices_that_differ():
    """Two to four devices of 50 g to 2 kg on a body of 10 g to 30 kg, drawn at random."""
    rng, checked = np.random.default_rng(6), 0
    for _ in range(3000):
        count = rng.integers(2, 5)
        devices = 10.0 ** rng.uniform(-1.3, 0.3, count)
        masses = devices * 10.0 ** rng.uniform(-2.0, 2.0, count)
        ratios, shares = devices / 10.0 ** rng.uniform(-2.0, 1.5), masses / (masses + devices)
        plain = np.zeros((count, count, 3))
        plain[:, :, 0] = ratios[:, None] - np.eye(count)
        if loop_of(plain, shares) >= 1.0:
            continue
        led = np.empty_like(plain)
        for i, ratio in enumerate(ratios):
            own, theirs = answers(ratio, count - 1)
            led[i] = theirs
            led[i, i] = own
        assert loop_of(led, shares) < 1.0
        checked += 1
    assert checked > 1000


def test_without_its_weight_the_parabola_would_drive_a_mass():
    """Of 1 kg on 0.3 kg, on a body of 0.15 kg: 1.92, -1.33 and 0.42 times r G."""
    share, gain = 1.0 / 1.3, 1.0
    assert largest_root(gain * np.array([23.0, -16.0, 5.0]) / 12.0, share) > 1.5
    assert largest_root(answers(1.0 + gain, 0)[0], share) < share


def test_a_device_that_closes_no_force_channel_adds_nothing():
    memory = remembered(np.random.default_rng(4).normal(size=(3, 6)), [PERIOD] * 2)
    sample, command = np.eye(DeviceSample.layout.size)[6], np.ones(6)
    model = np.zeros(108)
    assert np.array_equal(corrected(command, model, sample, sample, memory, PERIOD), command)


def test_a_gain_that_no_mechanism_has_leads_nothing():
    """R² may be -1/2 if somebody says so."""
    gain = np.zeros((6, 6))
    gain[:2, :2] = np.sqrt(0.5) * np.array([[0.0, -1.0], [1.0, 0.0]]) - np.eye(2)
    memory = remembered(np.random.default_rng(5).normal(size=(3, 6)), [PERIOD] * 2)
    sample = np.eye(DeviceSample.layout.size)[6]
    model = np.concatenate((gain.ravel(), np.zeros(72)))
    found = corrected(np.ones(6), model, sample, sample, memory, PERIOD)
    assert np.array_equal(found, np.ones(6))
