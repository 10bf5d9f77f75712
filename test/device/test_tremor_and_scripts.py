# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tremor added to a hand, and hands that follow a file."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene.device import Device
from hapticmech_ros.scene.hand import (
    ConstantWrenchHand,
    ScriptedHand,
    SpringDamperHand,
    Tremor,
    Waypoint,
)
from oracles.devices import PERIOD, START, body_of, law_of, run

HEADING = "time,fx,fy,fz,tx,ty,tz\n"
HEAVY = Device(mass=50.0, inertia=1.0)


def test_tremor_adds_a_sinusoid_to_a_push():
    hand = ConstantWrenchHand(
        kind="constant_wrench",
        force=(1.0, 0.0, 0.0),
        start_delay=0.02,
        tremor=Tremor(frequency=9.0, force=(0.0, 0.3, 0.0), torque=(0.0, 0.0, 0.01)),
    )
    for tick, state in enumerate(run(body_of(HEAVY, hand), 200)):
        time = (tick - 20) * PERIOD
        sine = np.sin(2.0 * np.pi * 9.0 * time)
        expected = np.array([1.0, 0.3 * sine, 0.0, 0.0, 0.0, 0.01 * sine]) * (time >= 0.0)
        assert np.abs(state.hand_wrench - expected).max() < 1e-12


def test_tremor_sways_a_target_at_the_rate_it_moves():
    tremor = Tremor(frequency=8.0, xyz=(1e-3, 0.0, 0.0), rotation=(0.0, 0.02, 0.0))
    keys = {"kind": "spring_damper", "start_delay": 0.0, "waypoints": (Waypoint(time=0.0),)}
    gains = {"stiffness": 1.0, "angular_stiffness": 1.0}
    springs = law_of(
        SpringDamperHand(**keys, **gains, damping=0.0, angular_damping=0.0, tremor=tremor)
    )
    damped = law_of(
        SpringDamperHand(**keys, **gains, damping=1.0, angular_damping=1.0, tremor=tremor)
    )
    still, step = np.zeros(6), 1e-6
    for time in (0.01, 0.04, 0.1):
        offset = springs(time, START, still, START)
        assert offset[0] == pytest.approx(1e-3 * np.sin(16.0 * np.pi * time), abs=1e-15)
        rate = damped(time, START, still, START) - offset
        after, before = (springs(time + h, START, still, START) for h in (step, -step))
        # Central difference: h² ω³ / 6 of the amplitude.
        assert np.abs(rate - (after - before) / (2.0 * step)).max() < 1e-8
        turned = pin.exp3(np.array([0.0, 0.02, 0.0]) * np.sin(16.0 * np.pi * time))
        assert np.abs(pin.exp3(offset[3:]) - turned).max() < 1e-12


def test_a_script_is_held_between_its_rows(tmp_path):
    file = tmp_path / "push.csv"
    file.write_text(HEADING + "0.01,1,0,0,0,0,0.1\n0.03,3,0,-2,0,0,0\n\n0.031,0,0,0,0,0,0\n")
    hand = ScriptedHand(kind="scripted", file=str(file), interpolation="held", start_delay=0.005)
    rows = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.1], [3.0, -2.0, 0.0], [0.0, 0.0, 0.0]]
    for tick, state in enumerate(run(body_of(HEAVY, hand), 50)):
        expected = rows[np.searchsorted([10, 30, 31], tick - 5, side="right")]
        assert np.abs(state.hand_wrench[[0, 2, 5]] - expected).max() < 1e-9
        assert np.array_equal(state.hand_wrench[[1, 3, 4]], np.zeros(3))


def test_a_long_script_of_random_rows_is_followed_in_lines(tmp_path):
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.uniform(1e-5, 2e-3, size=300))
    rows = np.column_stack((times, rng.normal(size=(300, 6))))
    file = tmp_path / "rows.csv"
    np.savetxt(file, rows, delimiter=",", header=HEADING.strip(), comments="", fmt="%.17g")
    hand = ScriptedHand(kind="scripted", file=str(file), start_delay=0.0)
    states = run(body_of(HEAVY, hand), 350)
    for tick, state in enumerate(states):
        time = tick * PERIOD
        expected = [np.interp(time, times, rows[:, i], left=0.0) for i in range(1, 7)]
        assert np.abs(state.hand_wrench - expected).max() < 1e-9


def test_a_script_that_went_away_is_an_error(tmp_path):
    hand = ScriptedHand(kind="scripted", file=str(tmp_path / "none.csv"))
    with pytest.raises(InvalidInputError, match=r"none\.csv"):
        law_of(hand)
