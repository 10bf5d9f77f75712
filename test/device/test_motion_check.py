# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Samples that are no motion of a device that a hand holds are found; all others pass."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hapticmech_ros.device.safety import MotionCheck
from hapticmech_ros.numerics.layout import DeviceSample
from hapticmech_ros.scene.device import Device, Workspace
from oracles.swing import POSITION, QUATERNION, TWIST, Swing

PERIOD_NS = 1_000_000


def faults(samples, stamps=None, device=None, period=1e-3):
    """Return the indices of samples at which a fault begins, and what is said."""
    check = MotionCheck(device or Device(), period)
    begun, said = [], []
    for index, sample in enumerate(samples):
        before = check.faults
        check.check(sample, PERIOD_NS * (index + 1) if stamps is None else stamps[index])
        if check.faults > before:
            begun.append(index)
            said.append(check.fault)
    return begun, said


def swung(seed, count=1000, period=1e-3):
    swing = Swing.random(seed)
    return [swing.sample(period * index) for index in range(count)]


def along_x(speed, places):
    """Return samples at places (m) along x, with one and the same speed (m/s)."""
    samples = np.zeros((len(places), DeviceSample.layout.size))
    samples[:, QUATERNION.stop - 1] = 1.0
    samples[:, TWIST.start], samples[:, POSITION.start] = speed, places
    return samples


@pytest.mark.parametrize("seed", range(12))
def test_motions_of_a_hand_pass(seed):
    assert faults(swung(seed)) == ([], [])


@pytest.mark.parametrize("period", [0.25e-3, 2e-3, 4e-3])
def test_drivers_of_other_rates_pass(period):
    stamps = [round(1e9 * period) * (index + 1) for index in range(1000)]
    assert faults(swung(3, period=period), stamps) == ([], [])


@pytest.mark.parametrize("seed", range(4))
def test_stamps_that_are_not_on_time_and_samples_that_are_lost_pass(seed):
    rng = np.random.default_rng(seed)
    swing, times = Swing.random(seed), 1e-3 * np.arange(1, 2000)
    times = times[rng.random(times.size) > 0.1]
    told = times + rng.uniform(-4e-4, 4e-4, times.size)
    samples = [swing.sample(time) for time in times]
    assert faults(samples, [round(1e9 * time) for time in told]) == ([], [])


@pytest.mark.parametrize("cut_off", [10.0, 30.0, 100.0])
def test_a_twist_with_the_lag_of_a_filter_passes(cut_off):
    share = 1.0 - math.exp(-2.0 * math.pi * cut_off * 1e-3)
    samples, known = swung(5), np.zeros(6)
    known[:] = samples[0][TWIST]
    for sample in samples:
        known += share * (sample[TWIST] - known)
        sample[TWIST] = known
    assert faults(samples) == ([], [])


def test_twists_from_encoder_steps_pass():
    step, turn = 5e-5, 1e-3
    device = Device(position_resolution=step, angle_resolution=turn)
    samples, known, before = swung(7), np.zeros(6), None
    for sample in samples:
        rotation = Rotation.from_quat(sample[QUATERNION])
        seen = turn * np.round(rotation.as_rotvec() / turn)
        sample[POSITION] = step * np.round(sample[POSITION] / step)
        sample[QUATERNION] = Rotation.from_rotvec(seen).as_quat()
        now = sample[POSITION].copy(), Rotation.from_rotvec(seen)
        if before is not None:
            rate = np.concatenate((now[0] - before[0], (now[1] * before[1].inv()).as_rotvec()))
            known += 0.466 * (1e3 * rate - known)
        before = now
        sample[TWIST] = known
    assert faults(samples[20:], device=device) == ([], [])


JUMPS = {
    "elsewhere": lambda sample: sample[POSITION].__iadd__([0.27, 0.0, 0.0]),
    "by 2 mm": lambda sample: sample[POSITION].__iadd__([0.0, 0.002, 0.0]),
    "an encoder's turn": lambda sample: sample.__setitem__(
        QUATERNION,
        (Rotation.from_rotvec([0, 0, 0.5]) * Rotation.from_quat(sample[QUATERNION])).as_quat(),
    ),
    "swapped axes": lambda sample: sample.__setitem__(
        POSITION, sample[POSITION][[1, 0, 2]] + [0.01, 0, 0]
    ),
    "millimetres": lambda sample: sample.__setitem__(POSITION, 1000.0 * sample[POSITION]),
}


@pytest.mark.parametrize("kind", JUMPS)
@pytest.mark.parametrize("derived", [False, True])
def test_a_jump_is_found_with_its_first_sample(kind, derived):
    """Also where the twist is the rate of the poses, as drivers make it."""
    samples = swung(2)
    for sample in samples[500:]:
        JUMPS[kind](sample)
    if derived:
        for index, sample in enumerate(samples[1:], 1):
            moved = sample[POSITION] - samples[index - 1][POSITION]
            turned = Rotation.from_quat(sample[QUATERNION])
            turned = turned * Rotation.from_quat(samples[index - 1][QUATERNION]).inv()
            sample[TWIST] = 1e3 * np.concatenate((moved, turned.as_rotvec()))
        samples[0][TWIST] = samples[1][TWIST]
    begun, said = faults(samples)
    assert begun[0] == 500
    assert "the device" in said[0]


def test_one_wild_sample_is_one_fault_that_ends():
    samples = swung(4)
    samples[500][POSITION] += [0.2, 0.0, 0.0]
    check, faulty = MotionCheck(Device(), 1e-3), []
    for index, sample in enumerate(samples):
        check.check(sample, PERIOD_NS * (index + 1))
        faulty.append(bool(check.fault))
    # Back again with the next one, and sound for 0.1 s after that.
    assert (faulty.index(True), sum(faulty)) == (500, 102)
    assert check.faults == 1


@pytest.mark.parametrize("speed", [0.003, 0.03, 0.3, 3.0])
def test_a_pose_that_stands_still_while_its_twist_does_not_is_found(speed):
    begun, _ = faults(along_x(speed, 1e-3 * speed * np.minimum(np.arange(6000), 1000)))
    found = begun[0] - 1000
    # Slow ones add up; else the pose lacks less than 0.3 mm by then, or three samples.
    assert 0 < found <= (2500 if speed < 0.01 else max(3, 3e-4 / (1e-3 * speed)))


def test_a_fault_that_lasts_lasts():
    check = MotionCheck(Device(), 1e-3)
    for index, sample in enumerate(along_x(0.3, np.zeros(3000))):
        check.check(sample, PERIOD_NS * (index + 1))
        assert bool(check.fault) == (index >= 3)
    assert check.faults == 1
    assert "moved by" in check.fault


def test_a_pose_may_be_anywhere_after_a_silence():
    samples = swung(6)
    stamps = [PERIOD_NS * (index + 1) + 200_000_000 * (index >= 500) for index in range(1000)]
    for sample in samples[500:]:
        sample[POSITION] += 0.1
    assert faults(samples, stamps) == ([], [])


@pytest.mark.parametrize(
    ("at", "value", "said"),
    [
        (TWIST.start, 8.0, "8 m/s, device.motion.speed is 5; are these millimetres?"),
        (TWIST.start + 4, 300.0, "300 rad/s, device.motion.angular_speed is 100"),
    ],
)
def test_speeds_of_nobody_are_told(at, value, said):
    samples = swung(8, 100)
    samples[50][at] = value
    begun, sentences = faults(samples)
    assert begun == [50]
    assert said in sentences[0]


def test_twists_that_jump_are_told():
    samples = swung(8, 100)
    samples[50][TWIST][0] += 2.0
    begun, sentences = faults(samples)
    assert begun == [50]
    assert "twist jumps within 1 ms" in sentences[0]
    assert "device.motion.acceleration is 501" in sentences[0]


def test_a_device_is_not_further_than_its_workspace_is_wide():
    device = Device(workspace=Workspace(radius=0.075))
    samples = along_x(0.2, 0.2e-3 * np.arange(2000))
    begun, sentences = faults(samples, device=device)
    assert begun == [1125]
    assert "3 times device.workspace.radius is 0.225 m; are these millimetres?" in sentences[0]
    assert faults(samples) == ([], [])


def test_numbers_that_are_none_are_a_fault():
    samples = swung(9, 10)
    samples[5][POSITION][1] = math.nan
    assert faults(samples)[0] == [5]
