# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the driver adds: weight is carried, friction is less, rest stays rest."""

import numpy as np
import pytest

from hapticmech_ros.scene.device import Compensation, Device
from oracles.devices import NOTHING, PERIOD, START, body_of, moving, run

WEIGHT = (0.3, 0.0, -1.5)


def test_a_weight_makes_it_fall_unless_actuators_carry_it():
    falling = run(body_of(Device(gravity_load=WEIGHT)), 100)[-1]
    assert np.abs(falling.twist[:3] - np.array(WEIGHT) / 0.3 * 0.1).max() < 1e-12
    carried = Device(gravity_load=WEIGHT, compensation=Compensation(gravity=True))
    resting = run(body_of(carried), 100)[-1]
    # Equal and opposite, to the bit.
    assert np.array_equal(resting.twist, NOTHING)
    assert np.array_equal(resting.applied[:3], -np.array(WEIGHT))


def test_actuators_carry_no_more_than_they_can():
    device = Device(
        gravity_load=(0.0, 0.0, -3.0), force_limit=2.0, compensation=Compensation(gravity=True)
    )
    end = run(body_of(device), 100)[-1]
    assert end.twist[2] == pytest.approx(-1.0 / 0.3 * 0.1, rel=1e-11)


def test_a_planar_device_adds_nothing_out_of_its_plane():
    device = Device(
        gravity_load=(0.3, -0.7, -1.5),
        coulomb_friction=0.2,
        compensation=Compensation(gravity=True, friction=0.5),
    )
    body = body_of(device, planar=True)
    added = body.compensation(body.at_rest(START).replaced(measured_twist=np.full(6, 0.3)))
    assert np.array_equal(added[[2, 3, 4]], np.zeros(3))
    assert np.abs(added[:2]).min() > 0.0


@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
def test_a_share_of_friction_is_given_back_while_it_moves(share):
    device = Device(
        mass=0.2,
        coulomb_friction=0.2,
        damping=0.4,
        substeps=10,
        compensation=Compensation(friction=share),
    )
    body = body_of(device)
    start = moving(body, np.array([0.5, 0, 0, 0, 0, 0]))
    states = run(body, 100, start=start)
    # m v̇ = -(1 - share) (F_c + b v): solved from the first sample on.
    rate, terminal = (1.0 - share) * 0.4 / 0.2, -0.2 / 0.4
    expected = terminal + (start.twist[0] - terminal) * np.exp(-rate * 0.1)
    # Compensation is of the period's start: first order in T, relative (b T / m)² / 2 a period.
    assert states[-1].twist[0] == pytest.approx(expected, rel=2e-3)


def test_it_comes_to_rest_all_the_same():
    device = Device(coulomb_friction=0.2, compensation=Compensation(friction=0.95))
    body = body_of(device)
    start = moving(body, np.array([0.1, 0, 0, 0, 0, 0]))
    speeds = [np.linalg.norm(state.twist) for state in run(body, 4000, start=start)]
    # Less than all of it is given back, so speed only falls.
    assert np.diff(speeds).max() < 1e-15
    assert speeds[-1] == 0.0


def test_coarse_encoders_do_not_make_it_chatter_at_rest():
    device = Device(
        coulomb_friction=0.2,
        angular_coulomb_friction=1e-3,
        position_resolution=1e-5,
        angle_resolution=1e-3,
        velocity_filter=40.0,
        compensation=Compensation(friction=0.95),
    )
    # One count a period is 0.01 m/s and 1 rad/s, a fifth of it after the filter: in the dead zones.
    shaking = np.random.default_rng(1).normal(size=(500, 6)) * np.repeat((0.05, 2e-4), 3)
    states = run(body_of(device), 500, push=lambda time: shaking[round(time / PERIOD)])
    assert all(np.array_equal(state.applied, NOTHING) for state in states)
    assert np.array_equal(states[-1].twist, NOTHING)
