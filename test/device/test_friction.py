# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coulomb friction of the device: rest under less, a constant brake above, no energy from it."""

import numpy as np
import pytest

from hapticmech_ros.scene.device import Device
from hapticmech_ros.scene.hand import SpringDamperHand, Waypoint
from oracles.devices import NOTHING, PERIOD, body_of, moving, run

LIMIT, TURN_LIMIT = 0.25, 2e-3
ROUGH = Device(mass=0.2, inertia=4e-4, coulomb_friction=LIMIT, angular_coulomb_friction=TURN_LIMIT)


def energy(device, twist):
    return 0.5 * (device.mass * twist[:3] @ twist[:3] + device.inertia * twist[3:] @ twist[3:])


@pytest.mark.parametrize("share", [1e-6, 0.5, 1.0 - 1e-9])
def test_at_rest_it_stays_under_less_than_the_friction(share):
    rng = np.random.default_rng(2)
    for _ in range(20):
        force, torque = rng.normal(size=(2, 3))
        push = np.concatenate(
            (share * LIMIT * force / np.linalg.norm(force), [0.0, 0.0, 0.0])
        ) + np.concatenate(([0.0] * 3, share * TURN_LIMIT * torque / np.linalg.norm(torque)))
        states = run(body_of(ROUGH), 20, push=push)
        for state in states:
            # To the bit: what friction holds has no speed at all.
            assert np.array_equal(state.twist, NOTHING)
            assert np.abs((states[0].pose.inverse() * state.pose).homogeneous - np.eye(4)).max() < (
                1e-14
            )


@pytest.mark.parametrize("planar", [False, True])
def test_above_it_what_is_left_of_the_force_accelerates(planar):
    """In a planar scene that of the plane alone, whatever pushes out of it."""
    out_of_plane = (5.0, 1.0, 1.0) if planar else (0.0, 0.0, 0.0)
    push = np.array([1.25, 0.0, *out_of_plane, 6e-3])
    end = run(body_of(ROUGH, planar=planar), 100, push=push)[-1]
    # Momentum: constant forces, so the explicit step is exact but for rounding.
    assert end.twist[0] == pytest.approx((1.25 - LIMIT) / 0.2 * 0.1, rel=1e-11)
    assert end.twist[5] == pytest.approx((6e-3 - TURN_LIMIT) / 4e-4 * 0.1, rel=1e-11)
    assert np.array_equal(end.twist[1:5], np.zeros(4))


def test_it_brakes_at_a_constant_rate_and_then_stands():
    body = body_of(ROUGH)
    start = moving(body, np.array([0.3, -0.4, 0.0, 0.0, 1.0, 0.0]))
    speed, spin = np.linalg.norm(start.twist[:3]), np.linalg.norm(start.twist[3:])
    states = run(body, 700, start=start)
    for tick, state in enumerate(states):
        left = max(speed - LIMIT / 0.2 * tick * PERIOD, 0.0)
        assert np.linalg.norm(state.twist[:3]) == pytest.approx(left, abs=1e-12)
        left = max(spin - TURN_LIMIT / 4e-4 * tick * PERIOD, 0.0)
        assert np.linalg.norm(state.twist[3:]) == pytest.approx(left, abs=1e-12)
    assert np.array_equal(states[-1].twist, NOTHING)


@pytest.mark.parametrize("substeps", [1, 4])
def test_it_never_gives_energy(substeps):
    device = ROUGH.model_copy(update={"substeps": substeps})
    body, free = body_of(device), body_of(Device(mass=0.2, inertia=4e-4))
    rng = np.random.default_rng(5)
    for _ in range(50):
        start = moving(free, rng.normal(size=6) * np.repeat((0.003, 0.02), 3))
        state = body.step(start, NOTHING, None, 0)
        assert energy(device, state.twist) <= energy(device, start.twist)
        # Against the motion, never past it.
        assert state.twist[:3] @ start.twist[:3] >= 0.0
        assert state.twist[3:] @ start.twist[3:] >= 0.0


def test_a_spring_leaves_it_where_friction_holds_it():
    hand = SpringDamperHand(
        kind="spring_damper",
        stiffness=100.0,
        damping=1.0,
        waypoints=(Waypoint(time=0.2, xyz=(0.02, 0.0, 0.0)),),
        start_delay=0.0,
    )
    states = run(body_of(ROUGH, hand), 1500)
    last = states[-1]
    assert np.array_equal(last.twist, NOTHING)
    stretch = 0.02 - (last.pose.translation - states[0].pose.translation)[0]
    # Stuck anywhere within the friction cone.
    assert abs(stretch) <= LIMIT / 100.0 * (1.0 + 1e-9)
    assert np.linalg.norm(last.hand_wrench[:3]) <= LIMIT * (1.0 + 1e-9)
