# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Quaternions of rotations: Pinocchio's, and nothing is left behind."""

import os

import numpy as np
import pinocchio as pin

from benchmarks.reliability.usage import resident
from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.loading import load_scene
from hapticmech_ros.numerics.layout import OperationalModelSample
from hapticmech_ros.numerics.quaternions import quaternion_of

# What is never freed, 80 bytes a call, would come to 4 MB.
CALLS, GROWTH = 50_000, 1_000_000


def grown(call):
    """Return by how much this process grows in many calls, bytes."""
    for _ in range(2000):
        call()
    before = resident(os.getpid())
    for _ in range(CALLS):
        call()
    after = resident(os.getpid())
    return after - before


def test_bits_are_those_of_pinocchios_quaternions():
    for seed in range(200):
        x, y, z = np.random.default_rng(seed).normal(size=3)
        rotation = pin.rpy.rpyToMatrix(3.0 * x, y, z)
        assert quaternion_of(rotation).tobytes() == pin.Quaternion(rotation).coeffs().tobytes()


def test_a_quaternion_leaves_nothing_behind():
    rotation = pin.rpy.rpyToMatrix(0.1, 0.2, 0.3)
    assert grown(lambda: quaternion_of(rotation)) < GROWTH


def test_engaging_leaves_nothing_behind():
    control = ControlArchitecture(load_scene("five_bar"))
    device, operational_model = np.zeros(19), np.zeros(OperationalModelSample.layout.size)
    device[6] = operational_model[OperationalModelSample.layout.slice("quaternion").stop - 1] = 1.0

    def engage():
        control.answer(
            1.0, control.engage(0.0, device, operational_model, 0.0), device, operational_model, 0.0
        )

    assert grown(engage) < GROWTH
