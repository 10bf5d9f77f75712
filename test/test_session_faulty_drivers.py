# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drivers that go wrong at random: the hand feels no more of it than three periods are long."""

from __future__ import annotations

import math
import warnings
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from hapticmech_ros import Session, load_scene
from hapticmech_ros.device import NO_WRENCH, DeviceState
from oracles.swing import POSITION, QUATERNION, TWIST, Swing
from sampling import sampled

# The clutch has closed by then, in periods; and so long a fault is looked at.
CLOSED, LOOK = 260, 90
MOTIONS = 40
# A twist that is wrong by less, m/s, is told from noise later.
LEAST_SPEED = 0.05


class Driver:
    """A device that a hand swings, whatever is commanded, and what its driver says of that.

    Args:
        seed: of the motion and of the fault.
        planar: whether it moves in x, y and about z only.
        faulty: whether there is a fault.
    """

    def __init__(self, seed: int, planar: bool, faulty: bool) -> None:
        rng = np.random.default_rng(seed)
        self.swing = Swing.random(seed % MOTIONS, planar)
        self.kind = rng.choice(list(FAULTS)) if faulty else ""
        self.size = 10.0 ** rng.uniform(-3.0, -0.3)
        self.towards = rng.normal(size=3) * (1.0, 1.0, not planar)
        self.towards /= np.linalg.norm(self.towards)
        self.first = CLOSED + int(rng.integers(0, 30))
        self.last = self.first + int(rng.choice([1, 2, 5, 20, LOOK]))

    def told(self, tick: int) -> np.ndarray:
        """Return the sample (19,) that the driver tells."""
        sample = self.swing.sample(1e-3 * tick)
        if self.kind and self.first <= tick < self.last:
            FAULTS[self.kind](self, sample, self.swing.sample(1e-3 * (self.first - 1)))
        return sample

    @property
    def is_told_from_noise(self) -> bool:
        """Whether a twist is wrong by more than what may be a filter's lag.

        A pose that stands still contradicts all of the device's twist.
        """
        sound, wrong = self.swing.sample(1e-3 * self.first), self.told(self.first)
        speed = np.linalg.norm((wrong[TWIST] - sound[TWIST])[:3])
        if self.kind == "pose stands still":
            speed = np.linalg.norm(sound[TWIST][:3])
        elif "twist" not in self.kind:
            return True
        return bool(speed > LEAST_SPEED)

    def at_rest(self, pose, held=False, home=None):
        return self._put(DeviceState.resting(pose), pose, 0)

    def _put(self, state, home, tick):
        sample, start = self.told(tick), self.swing.sample(0.0)
        there = home.translation + sample[POSITION] - start[POSITION]
        pose = pin.SE3(Rotation.from_quat(sample[QUATERNION]).as_matrix(), there)
        twist = sample[TWIST]
        return state.replaced(pose=pose, twist=twist, measured_pose=pose, measured_twist=twist)

    def step(self, state, command, held, ticks, push=NO_WRENCH):
        return self._put(state, state.home, ticks + 1)

    def compensation(self, state):
        return NO_WRENCH

    def sensed(self, push):
        return push


def _moved(driver, sample, before):
    sample[POSITION] += driver.size * driver.towards


def _wrapped(driver, sample, before):
    sample[POSITION][0] += math.copysign(0.1, driver.towards[0])


def _turned(driver, sample, before):
    turn = Rotation.from_rotvec([0.0, 0.0, driver.size])
    sample[QUATERNION] = (turn * Rotation.from_quat(sample[QUATERNION])).as_quat()


def _still(driver, sample, before):
    sample[POSITION], sample[QUATERNION] = before[POSITION], before[QUATERNION]


def _scaled(place=1.0, line=1.0, turn=1.0):
    """Return a fault by which places and velocities are so many times as large."""

    def fault(driver, sample, before):
        sample[POSITION] *= place
        sample[TWIST] *= np.repeat((line, turn), 3)

    return fault


def _swapped(part):
    """Return a fault by which x and y of a part of the sample are each other's."""

    def fault(driver, sample, before):
        sample[part][:2] = sample[part][1::-1].copy()

    return fault


FAULTS = {
    "jumps": _moved,
    "an encoder wraps": _wrapped,
    "turns": _turned,
    "pose stands still": _still,
    "millimetres": _scaled(1e3, 1e3),
    "poses in millimetres": _scaled(1e3),
    "twists in mm/s": _scaled(line=1e3),
    "swapped axes": _swapped(POSITION),
    "swapped axes of the twist": _swapped(TWIST),
    "the twist's sign": _scaled(line=-1.0, turn=-1.0),
}


@cache
def _scene(name):
    return load_scene(name)


def _forces(name, driver):
    """Return the forces on the hand (ticks,), N, and the session."""
    session = Session(_scene(name), device=driver)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run = session.run(driver.first + LOOK)
    said = [str(one.message) for one in caught]
    return np.linalg.norm(run["on_hand"][:, :3], axis=1), session, said


@cache
def _sound_forces(name, motion):
    driver = Driver(motion, _scene(name).task_space == "planar", faulty=False)
    driver.first = CLOSED + 30
    return _forces(name, driver)[0]


@pytest.mark.parametrize("name", ["five_bar", "spatial_arm"])
@pytest.mark.parametrize("block", sampled(range(500), every=500))
def test_no_fault_of_a_driver_is_felt_for_longer_than_three_periods(name, block):
    engaging = _scene(name).controller.engagement_force
    for seed in sampled(range(10 * block, 10 * block + 10), every=2):
        driver = Driver(seed, _scene(name).task_space == "planar", faulty=True)
        if not driver.is_told_from_noise:
            continue
        forces, session, said = _forces(name, driver)
        sound = _sound_forces(name, seed % MOTIONS)
        longest = lasts = 0
        for tick in range(driver.first, min(driver.first + LOOK, len(sound))):
            usual = sound[tick - 2 : tick + 1].max()
            lasts = lasts + 1 if forces[tick] > usual + engaging else 0
            longest = max(longest, lasts)
        assert longest <= 3, (seed, driver.kind, driver.size)
        # Some last for less than it takes to be sure, and do nothing.
        assert session.motion.faults == len(said) <= 1
