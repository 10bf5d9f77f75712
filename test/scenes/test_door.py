# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A door felt at its knob: a circle to move along, a stop at its end, a latch."""

import numpy as np
import pytest

from hapticmech_ros import Mechanism, Simulator, analyse, load_scene

NAME = "door"

MASS, WIDTH, THICK = 0.9, 0.2, 0.018
KNOB = np.array([0.17, -0.03, 0.0])
# Of a plate about its edge.
INERTIA = MASS * ((WIDTH**2 + THICK**2) / 12.0 + WIDTH**2 / 4.0)
STOP, STOP_STIFFNESS, LATCH_DISTANCE = 0.9, 66.0, 1e-3


def knob_at(angle):
    """Return the knob's place and the unit tangent of its circle."""
    c, s = np.cos(angle), np.sin(angle)
    place = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ KNOB
    return place, np.array([-place[1], place[0], 0.0]) / np.linalg.norm(place)


@pytest.mark.parametrize("angle", [0.0, 0.35, 0.8])
def test_the_knob_is_heavy_along_its_circle_and_held_across_it(angle):
    """X of a body on an axis is one twist times its transpose over the moment of inertia."""
    found = analyse(Mechanism(load_scene("door")), np.array([angle]))
    place, tangent = knob_at(angle)
    radius = np.linalg.norm(place)
    twist = np.concatenate((radius * tangent, (0.0, 0.0, 1.0)))
    # Moments stand in the file with seven digits.
    assert found.inverse_inertia == pytest.approx(np.outer(twist, twist) / INERTIA, rel=1e-6)
    assert found.rank == 1
    along = tangent @ found.inverse_inertia[:3, :3] @ tangent
    assert 1.0 / along == pytest.approx(0.4035, rel=1e-3)
    wrenches = found.constraint_wrenches
    assert wrenches.shape == (6, 5)
    # Across the circle, and along the axis, all force is balanced; along it none is.
    balanced = found.wrench_projector
    for across in (place / radius, (0.0, 0.0, 1.0)):
        push = np.concatenate((across, np.zeros(3)))
        assert balanced @ push == pytest.approx(push, abs=1e-9)
    assert twist @ wrenches == pytest.approx(np.zeros(5), abs=1e-12)


def test_the_hinges_carry_the_weight(run):
    """Let go of, the door stays where it is, and the hand has nothing to carry."""
    simulator = Simulator(load_scene("door"))
    start = simulator.initial_state()
    end = simulator.run(start, 200).end
    assert np.array_equal(end.q, start.q)
    waiting = run.of(lambda s: s.output.device)[run.time < 0.25]
    assert np.abs(waiting).max() == 0.0


def test_the_stop_is_felt_where_the_door_ends(run):
    """The hand rests against the stop: moment of the spring = what hand and device hold at r."""
    beyond = run.of(lambda s: s.mechanism.q[0]) - STOP
    resting = (run.time > 2.1) & (run.time < 2.4)
    assert beyond[resting].min() > 0.005
    assert beyond.max() < 0.02
    sample = run.at(2.3)
    place, _ = knob_at(sample.mechanism.q[0])
    force, torque = sample.output.device[:3], sample.output.device[3:]
    felt = np.cross(place, force)[2] + torque[2]
    # At rest to the hinges' friction of 0.02 N m, which the tanh lets creep.
    assert felt == pytest.approx(-STOP_STIFFNESS * beyond[2300], rel=0.01)
    assert sample.hand_wrench == pytest.approx(-sample.output.device, abs=1e-3)


def test_a_pull_across_the_circle_is_felt_and_moves_nothing(run):
    """The hand's way is the chord: in its middle it pulls inwards, by springs, through 9 mm."""
    sample = run.at(1.0)
    place, tangent = knob_at(sample.mechanism.q[0])
    inwards = -place / np.linalg.norm(place)
    pull = sample.hand_wrench[:3] @ inwards
    assert pull > 1.5
    # The device gives it back to what its own mass takes along a curve, and the knob stays put.
    assert sample.output.joint_constraint[:3] @ inwards == pytest.approx(-pull, rel=0.05)
    assert np.linalg.norm(sample.device.pose.translation - place) < 2e-3
    assert abs(sample.point.twist[:3] @ inwards) < 1e-12
    assert sample.point.twist[:3] @ tangent > 0.05


def test_the_latch_catches_and_takes_the_last_freedom(run):
    closed = run.of(lambda s: s.mechanism.active[0])
    caught = int(np.argmax(closed))
    before, after = run.samples[caught - 1].mechanism, run.samples[caught].mechanism
    assert 3.5 < run.time[caught] < 4.5
    assert closed[caught:].all()
    # Within the catch's reach, at the door's edge.
    assert abs(before.q[0]) * WIDTH < LATCH_DISTANCE
    assert after.closure_error < 1e-12
    ((time, *counts),) = run.changes
    assert counts == [5, 6]
    # The count follows after its dwell.
    assert time == pytest.approx(run.time[caught] + load_scene("door").perception.dwell, abs=2e-3)
    assert np.abs(run.samples[-1].mechanism.v).max() < 1e-12
