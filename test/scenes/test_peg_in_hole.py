# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A peg in a hole: in with clearance, on two points when it is pulled aside, and jammed."""

import numpy as np
import pytest

from hapticmech_ros import analyse

NAME = "peg_in_hole"

MASS, MOMENT, HANDLE = 1.0, 1.2e-3, 0.05
WIDTH, LENGTH, HOLE, DEPTH = 0.02, 0.06, 0.0206, 0.04
STIFFNESS, FRICTION, HAND = 2e4, 0.15, 300.0
LEFT, RIGHT, BOTTOM = range(3)
FREE, DOWN, TILTED, JAMMED = 0.95, 1.45, 2.95, 3.75  # s
# Digits of a state at rest: the hand's dampers and contacts have had half a second.
AT_REST = 1e-4


def wrench_of(sample, *pairs):
    """Return force (x, y) and torque about the handle of pairs of shapes, on the peg."""
    touching, handle = sample.mechanism.touching, sample.point.pose.translation
    total = sum(touching.wrench(pair, handle) for pair in pairs)
    return total[[0, 1, 5]]


def push_of(sample):
    return sample.hand_wrench[[0, 1, 5]]


def test_the_peg_alone_is_a_body_in_the_plane(run):
    sample = run.samples[0]
    found = sample.analysis.inverse_inertia[np.ix_([0, 1, 5], [0, 1, 5])]
    lever = HANDLE**2 / MOMENT
    assert found[0, 0] == pytest.approx(1.0 / MASS + lever, rel=1e-12)
    assert found[1, 1] == pytest.approx(1.0 / MASS, rel=1e-12)
    assert found[2, 2] == pytest.approx(1.0 / MOMENT, rel=1e-12)
    mechanism = run.session.simulator.mechanism
    assert analyse(mechanism, sample.mechanism.q).rank == 3
    assert set(run.count) == {0}


def test_pushed_straight_it_goes_in_and_touches_nothing(run):
    in_the_hole = [s for s in run.samples if s.time < FREE and s.mechanism.q[1] < 0.5 * LENGTH]
    depths = [0.5 * LENGTH - sample.mechanism.q[1] for sample in in_the_hole]
    assert max(depths) > 0.9 * DEPTH
    assert all(not s.mechanism.touching.pairs.size for s in in_the_hole)


def slip_of(run):
    """Return by how much the clutch has slipped while it closed, m: the hand moves then."""
    first = run.samples[0]
    began = first.point.pose.translation - first.device.pose.translation
    return run.session._clutch.displacement - began


def test_it_stands_on_the_bottom(run):
    """The hand's spring goes 5 mm below it; four corners bear the push, alike."""
    sample = run.at(DOWN)
    touching = sample.mechanism.touching
    assert touching.pairs.tolist() == [BOTTOM] * 4
    push = -push_of(sample)[1]
    depth, slip = push / (4.0 * STIFFNESS), slip_of(run)[1]
    assert push == pytest.approx(HAND * (0.005 - depth - slip), rel=AT_REST)
    assert touching.depths == pytest.approx(depth, rel=1e-3)
    assert touching.forces[:, 1] == pytest.approx(push / 4.0, rel=1e-3)
    assert sample.contact_wrench[1] == pytest.approx(push, rel=AT_REST)


@pytest.mark.parametrize("time", [TILTED, JAMMED])
def test_pulled_aside_it_bears_on_two_points(time, run):
    """On the right rim and on the left wall, both pushing inwards, within their cones."""
    sample = run.at(time)
    touching = sample.mechanism.touching
    # At each, the peg's edge along z has two ends.
    assert sorted(touching.pairs.tolist()) == [LEFT, LEFT, RIGHT, RIGHT]
    foot, rim = (touching.points[touching.pairs == side] for side in (LEFT, RIGHT))
    inside = 0.5 * LENGTH - sample.mechanism.q[1]
    assert rim[:, 1] == pytest.approx(0.0, abs=2e-4)
    assert foot[:, 1] == pytest.approx(-inside, abs=5e-4)
    assert np.abs(np.abs(touching.points[:, 0]) - 0.5 * HOLE).max() < 2e-4
    normal = np.einsum("pi,pi->p", touching.forces, touching.normals)
    along = np.linalg.norm(touching.forces - normal[:, None] * touching.normals, axis=1)
    assert normal.min() > 2.0
    assert (along <= FRICTION * normal * (1.0 + 1e-9)).all()


@pytest.mark.parametrize("time", [TILTED, JAMMED])
def test_two_forces_hold_the_push_and_its_lever(time, run):
    """Both sides' wrenches and the hand's add up to none, and each side's is larger."""
    sample = run.at(time)
    push = push_of(sample)
    left, right = (wrench_of(sample, side) for side in (LEFT, RIGHT))
    assert left + right + push == pytest.approx(np.zeros(3), abs=AT_REST * np.abs(push[0]))
    assert right[0] < -2.0 * push[0]
    assert left[0] > push[0]
    # By the lever alone: foot, rim and handle are this far apart, to the tilt's 2 mm to the side.
    inside = 0.5 * LENGTH - sample.mechanism.q[1]
    above = sample.point.pose.translation[1]
    lever = (push[0] * above - push[2]) / inside
    assert left[0] == pytest.approx(lever, rel=0.15)


@pytest.mark.parametrize("time", [DOWN, TILTED, JAMMED])
def test_what_is_held_is_what_touches(time, run):
    """F_c is the contacts' own wrench, the device gives it on, and the hand holds it."""
    sample = run.at(time)
    contacts = wrench_of(sample, LEFT, RIGHT, BOTTOM)
    size = np.abs(contacts).max()
    assert sample.contact_wrench[[0, 1, 5]] == pytest.approx(contacts, abs=AT_REST * size)
    assert sample.output.device[[0, 1, 5]] == pytest.approx(contacts, abs=AT_REST * size)
    assert push_of(sample) == pytest.approx(-contacts, abs=AT_REST * size)


def test_it_tilts_as_far_as_the_clearance_lets_it(run):
    """Inside · tan + width / cos = hole, and what both contacts give way by."""
    sample = run.at(TILTED)
    _, y, cosine, sine = sample.mechanism.q
    touching = sample.mechanism.touching
    gives = sum(touching.depths[touching.pairs == side].mean() for side in (LEFT, RIGHT))
    # The foot's left corner, below the rim; the right face leans outwards from there up to the rim.
    corner = y - 0.5 * LENGTH * cosine - 0.5 * WIDTH * sine
    assert corner < 0.0
    assert sine < 0.0
    across = WIDTH / cosine + corner * sine / cosine
    assert across == pytest.approx(HOLE + gives, abs=2e-5)
    assert gives == pytest.approx(
        sum(abs(wrench_of(sample, side)[0]) for side in (LEFT, RIGHT)) / (2.0 * STIFFNESS), rel=0.05
    )


def test_it_is_jammed_until_it_comes_straight(run):
    """A push of over 1 N does not move the tilted peg; straight, it follows at once."""
    before, after = run.at(TILTED), run.at(JAMMED)
    pushed = push_of(before)[1] - push_of(after)[1]
    assert pushed > 1.0
    assert abs(after.mechanism.q[1] - before.mechanism.q[1]) < 2e-5
    straight = run.at(4.55).mechanism.q
    assert before.mechanism.q[1] - straight[1] > 3e-3
    assert run.samples[-1].mechanism.q[1] == pytest.approx(0.5 * LENGTH + 0.005, abs=1e-3)
