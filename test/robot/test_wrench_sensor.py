# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A wrench sensor's offset and the weight of the tool beyond it."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.robot.interfaces import EARTH, LEAST, WrenchSensor

MASS, CENTRE = 1.2, np.array([0.01, -0.02, 0.08])
OFFSET = np.array([3.0, -2.0, 5.0, 0.1, 0.2, -0.3])
STILL = np.zeros(7)


def turns(count):
    rng = np.random.default_rng(0)
    return [pin.exp3(rng.normal(size=3)) for _ in range(count)]


def weighed(rotation):
    """Return the wrench of a tool's weight by Pinocchio's action of forces, sensor's axes."""
    hung = pin.Force(MASS * EARTH, np.zeros(3))
    at_centre = pin.SE3(rotation, np.zeros(3)).actInv(hung)
    return pin.SE3(np.eye(3), CENTRE).act(at_centre).vector


def test_weight_and_offset_are_taken_away_in_every_pose():
    sensor = WrenchSensor(MASS, CENTRE, OFFSET)
    contact = np.array([1.0, 2.0, -3.0, 0.1, 0.0, 0.2])
    for rotation in turns(20):
        measured = contact + OFFSET + weighed(rotation)
        np.testing.assert_allclose(sensor.contact(measured, rotation), contact, atol=1e-13)


def test_a_tare_in_one_pose_holds_in_all():
    first, *others = turns(5)
    sensor = WrenchSensor(MASS, CENTRE)
    rng = np.random.default_rng(1)
    noise = 0.1 * rng.normal(size=(100, 6))
    for one in noise:
        sensor.record(OFFSET + weighed(first) + one)
    sensor.tare(first, STILL)
    np.testing.assert_allclose(sensor.offset, OFFSET + noise.mean(axis=0), atol=1e-13)
    for rotation in others:
        left = sensor.contact(OFFSET + weighed(rotation), rotation)
        np.testing.assert_allclose(left, -noise.mean(axis=0), atol=1e-13)


def test_a_tare_needs_samples_and_rest():
    sensor = WrenchSensor()
    with pytest.raises(HapticMechError, match="samples"):
        sensor.tare(np.eye(3), STILL)
    for _ in range(LEAST):
        sensor.record(OFFSET)
    with pytest.raises(HapticMechError, match="moves"):
        sensor.tare(np.eye(3), np.full(7, 0.1))
    assert not sensor.offset.any()


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("tool_mass", {"mass": -1.0}),
        ("tool_centre", {"mass": 1.0, "centre": np.zeros(2)}),
        ("sensor_offset", {"offset": np.full(6, np.nan)}),
    ],
)
def test_tools_that_are_none_are_refused(name, options):
    with pytest.raises(InvalidInputError, match=name):
        WrenchSensor(**options)
