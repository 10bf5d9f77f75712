# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""End stops of the device: held at a finite depth, never pulling, never giving energy."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.scene.device import Device, Workspace
from oracles.devices import NOTHING, START, body_of, moving, run

SPACE = Workspace(
    radius=0.02,
    angle=0.3,
    stiffness=8000.0,
    damping=10.0,
    angular_stiffness=5.0,
    angular_damping=0.01,
)
BOXED = Device(mass=0.2, inertia=4e-4, workspace=SPACE)


def away(state):
    """Return distance (m) and angle (rad) from where the device started."""
    turn = pin.log3(state.pose.rotation @ START.rotation.T)
    return np.linalg.norm(state.pose.translation - START.translation), np.linalg.norm(turn)


def test_a_push_against_the_stop_is_held_where_its_spring_balances():
    push = np.array([0.0, 3.0, -4.0, 0.06, 0.0, 0.08])
    end = run(body_of(BOXED), 3000, push=push)[-1]
    distance, angle = away(end)
    # Settled: time constants are below 40 ms, in 3 s less than rounding is left.
    assert distance == pytest.approx(0.02 + 5.0 / 8000.0, rel=1e-9)
    assert angle == pytest.approx(0.3 + 0.1 / 5.0, rel=1e-9)
    assert np.abs(end.twist).max() < 1e-9


@pytest.mark.parametrize("substeps", [1, 4])
@pytest.mark.parametrize("stiffness", [1e3, 1e5, 1e8])
def test_running_into_it_straight_never_gains_energy(substeps, stiffness):
    space = SPACE.model_copy(update={"stiffness": stiffness, "angular_stiffness": stiffness / 1e3})
    device = BOXED.model_copy(update={"workspace": space, "substeps": substeps})
    body = body_of(device)
    start = moving(body, np.array([0.3, 0.4, 0.0, 0.0, 0.0, 4.0]))
    states = run(body, 300, start=start)
    kept = []
    for state in states:
        distance, angle = away(state)
        beyond = max(distance - 0.02, 0.0), max(angle - 0.3, 0.0)
        springs = stiffness * (beyond[0] ** 2 + beyond[1] ** 2 / 1e3)
        kinetic = 0.2 * state.twist[:3] @ state.twist[:3] + 4e-4 * state.twist[3:] @ state.twist[3:]
        kept.append(0.5 * (springs + kinetic))
    # Implicit in the speed, so at any stiffness; rounding of the distance times the stiffness.
    assert np.diff(kept).max() < 1e-12 + stiffness * 1e-18
    assert kept[-1] < 0.99 * kept[0]


def test_within_it_nothing_is_felt():
    free = Device(mass=0.2, inertia=4e-4)
    push = np.array([0.1, 0.0, 0.05, 0.0, 1e-4, 0.0])
    inside = run(body_of(BOXED), 100, push=push)
    assert away(inside[-1])[0] < 0.02
    for one, other in zip(inside, run(body_of(free), 100, push=push), strict=True):
        assert np.array_equal(one.twist, other.twist)
        assert np.array_equal(one.pose.homogeneous, other.pose.homogeneous)


def test_it_pushes_back_and_never_pulls():
    body = body_of(BOXED)
    state = held = body.at_rest(START)
    places = []
    for tick in range(600):
        push = np.array([4.0, 0, 0, 0, 0, 0.0]) if tick < 200 else np.array([-1.0, 0, 0, 0, 0, 0])
        last, state = state, body.step(state, NOTHING, held, tick, push)
        # The stop's mean force over a period.
        force = 0.2 * (state.twist[0] - last.twist[0]) / body.period - push[0]
        places.append((state.pose.translation - START.translation)[0])
        assert force * places[-1] < 1e-9
    # Both sides were met.
    assert max(places) > 0.02
    assert min(places) < -0.02


def test_a_workspace_is_about_home_wherever_rest_begins_anew():
    body = body_of(BOXED)
    elsewhere = pin.SE3(START.rotation, START.translation + np.array([0.0, 0.015, 0.0]))
    again = body.at_rest(elsewhere, home=body.at_rest(START).home)
    end = run(body, 3000, push=np.array([0.0, 4.0, 0.0, 0.0, 0.0, 0.0]), start=again)[-1]
    assert away(end)[0] == pytest.approx(0.02 + 4.0 / 8000.0, rel=1e-9)
