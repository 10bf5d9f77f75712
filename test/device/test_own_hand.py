# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A hand of one's own: a law in Python on the device that kernels move."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.device import GraspSchedule, ImpedanceDevice, device_for, grasp_schedule_of
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene.device import Device
from hapticmech_ros.scene.hand import ArmHand, Waypoint
from oracles.devices import NOTHING, PERIOD, START, run


def still(elapsed, pose, twist, held):
    return np.zeros(6)


def test_a_spring_of_ones_own_swings_a_mass_at_its_frequency():
    stiffness, mass, substeps = 120.0, 0.3, 8
    away = np.array([0.01, 0.0, 0.0])

    def spring(elapsed, pose, twist, held):
        force = stiffness * (held.translation + away - pose.translation)
        return np.concatenate((force, np.zeros(3)))

    body = ImpedanceDevice(Device(mass=mass, substeps=substeps), PERIOD, False, law=spring)
    ticks = 1000
    states = run(body, ticks)
    moved = np.array([state.pose.translation[0] - START.translation[0] for state in states])
    # Position Verlet swings at (2 / h) asin(ω h / 2), in phase.
    step, speed = PERIOD / substeps, np.sqrt(stiffness / mass)
    half = np.arcsin(0.5 * speed * step)
    phase = 2.0 * half * substeps * np.arange(ticks + 1)
    expected = 0.01 * (1.0 - np.cos(phase))
    assert np.abs(moved - expected).max() < 1e-10


def test_a_law_is_asked_while_its_grip_holds_and_its_mass_is_in_what_a_sensor_reads():
    schedule = GraspSchedule(start=0.01, switches=(0.02, 0.03), mass=0.5, inertia=1e-3)
    asked = []

    def watching(elapsed, pose, twist, held):
        asked.append(elapsed)
        return np.array([0.4, 0.0, 0.0, 0.0, 0.0, 0.0])

    body = ImpedanceDevice(
        Device(mass=0.3, substeps=2), PERIOD, False, law=watching, schedule=schedule
    )
    states = run(body, 50)
    times = np.array(asked)
    holding = (times > 0.01 - 1e-9) & ((times < 0.03 - 1e-9) | (times > 0.04 - 1e-9))
    assert holding.all()
    # Begin and end of each period, and the middles of its two substeps; and where the grip begins.
    assert len(asked) == (20 + 10) * 4 + 1
    # 0.4 N on 0.8 kg: 0.5 N/kg of acceleration, of which the hand's mass takes 0.25 N.
    assert states[15].hand_wrench[0] == pytest.approx(0.15, rel=1e-9)
    assert states[35].hand_wrench[0] == 0.0


def test_a_law_on_a_scenes_device_holds_as_the_scenes_hand_would():
    scene = load_scene("five_bar")
    hand = ArmHand(kind="arm", waypoints=(Waypoint(time=0.0),), release_at=(0.1,), start_delay=0.1)
    scene = scene.model_copy(update={"hand": hand})
    times = []

    def watching(elapsed, pose, twist, held):
        times.append(elapsed)
        return np.zeros(6)

    Session(scene, device=device_for(scene, law=watching)).run(400)
    assert grasp_schedule_of(hand).mass > 0.0
    assert min(times) == pytest.approx(0.1, abs=1e-9)
    assert max(times) < 0.2 - 1e-9


def test_what_a_law_is_given_is_its_own():
    kept = []

    def spoiling(elapsed, pose, twist, held):
        kept.append((pose.translation.copy(), twist.copy()))
        twist[:] = 9.0
        pose.translation[:] = 9.0
        held.translation[:] = 9.0
        return np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])

    def pushing(elapsed, pose, twist, held):
        return np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])

    ends = [
        run(ImpedanceDevice(Device(), PERIOD, False, law=law), 5)[-1] for law in (spoiling, pushing)
    ]
    assert np.array_equal(ends[0].flat, ends[1].flat)
    assert np.linalg.norm(kept[-1][1]) > 0.0


@pytest.mark.parametrize("wrong", [np.zeros(3), 1.0, np.zeros((6, 1))])
def test_what_is_no_wrench_is_refused(wrong):
    body = ImpedanceDevice(
        Device(),
        PERIOD,
        False,
        law=lambda elapsed, pose, twist, held: wrong,
        schedule=GraspSchedule(start=0.01),
    )
    start = body.at_rest(START, held=True)
    with pytest.raises(InvalidInputError, match=r"shape of the hand's wrench: must be \(6,\)"):
        body.step(start, NOTHING, start, 10)


def test_kernels_alone_move_only_what_has_nothing_in_python():
    class Own(ImpedanceDevice):
        """A subclass, whatever it overrides."""

    assert ImpedanceDevice(Device(), PERIOD, False).plain
    assert not ImpedanceDevice(Device(), PERIOD, False, law=still).plain
    assert not Own(Device(), PERIOD, False).plain


def test_an_unknown_part_of_a_state_is_refused():
    state = ImpedanceDevice(Device(), PERIOD, False).at_rest(pin.SE3.Identity())
    with pytest.raises(InvalidInputError, match="part of a state: must be one of pose, home"):
        state.replaced(speed=np.zeros(6))
