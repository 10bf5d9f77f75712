# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Two arms on a free-flying base with one payload: what is felt, what is kept, what gives way."""

from functools import cache

import numpy as np
import pytest

from hapticmech_ros import Simulator, analyse, load_scene
from hapticmech_ros.scene import document_of, scene_from_document
from oracles import closed_form
from oracles.jacobians import Jacobians
from oracles.kinematics import skew

NAME = "shared_payload"

PAYLOAD_MASS, PAYLOAD_MOMENT = 1.0, 1.1e-3
GRIP = {"link": "payload", "origin": {"xyz": [0.04, 0.0, 0.0]}}


@cache
def document():
    return document_of(load_scene("shared_payload"))


@pytest.mark.parametrize("time", [0.0, 1.8, 3.6])
def test_heavier_than_the_payload_and_lighter_than_all_of_it_in_one_piece(time, run):
    """Inverse inertias in order: of one rigid piece, as it is, of the payload alone."""
    sample = run.at(time)
    jacobians = Jacobians(document(), sample.mechanism.q)
    rotation, middle = jacobians.poses["payload"]
    grasp_schedule = middle + rotation @ np.array(GRIP["origin"]["xyz"])
    arm = np.hstack((np.eye(3), -skew(middle - grasp_schedule)))
    turn = np.hstack((np.zeros((3, 3)), np.eye(3)))
    alone = np.linalg.inv(PAYLOAD_MASS * arm.T @ arm + PAYLOAD_MOMENT * turn.T @ turn)
    # All joints locked, what the base's rates move is everything; the payload goes with it.
    of_base = jacobians.at("base", grasp_schedule)[:, :6]
    own = np.linalg.inv(alone)
    frozen = jacobians.inertia()[:6, :6] + of_base.T @ own @ of_base
    rigid = of_base @ np.linalg.solve(frozen, of_base.T)
    felt = sample.analysis.inverse_inertia
    size = np.abs(alone).max()
    for lighter, heavier in ((alone, felt), (felt, rigid)):
        gain = np.linalg.eigvalsh(lighter - heavier)
        assert gain.min() > -1e-9 * size
        assert gain.max() > 1e-2 * size


def momentum(mechanism_state):
    return Jacobians(document(), mechanism_state.q).momenta() @ mechanism_state.v


# To the rules' own order: 5e-7 and 5e-11 kg m/s were found at 1 ms, a quarter and a sixteenth of
# them at 0.5 ms, while bodies carry 0.1 kg m/s.
@pytest.mark.parametrize(("integrator", "error"), [("rk2", 1e-6), ("rk4", 1e-10)])
def test_the_arms_move_the_whole_by_nothing(integrator, error):
    """Without a hand momentum and angular momentum stay, whatever joints and dampers do."""
    changed = document_of(load_scene("shared_payload"))
    changed["simulation"]["integrator"] = integrator
    simulator = Simulator(scene_from_document(changed))
    state = simulator.initial_state()
    rng = np.random.default_rng(3)
    for _ in range(50):
        # Motors in all arms' joints push at random.
        efforts = np.concatenate((np.zeros(6), rng.normal(size=14) * 0.05, np.zeros(6)))
        state = simulator.step(state, np.zeros((1, 6)), joint_forces=efforts)
    before = momentum(state)
    assert np.abs(state.v).max() > 0.1
    assert np.abs(before).max() < error
    thrown = simulator.step(state, np.array([[2.0, -1.0, 0.5, 0.02, 0.01, -0.03]]))
    start = momentum(thrown)
    assert np.abs(start[:3]).max() > 1e-3
    end = momentum(simulator.run(thrown, 1000).end)
    assert end == pytest.approx(start, abs=0.1 * error)


def test_the_hand_moves_the_whole_as_its_mass(run):
    """The centre of mass of all goes as the hand's and the channels' force, over 11.3 kg."""
    h = run.session.period
    # A command acts a period later.
    pushes = run.of(lambda s: s.output.mechanism[:3])[:-1]
    places = []
    for sample in run.samples[::250]:
        mass, centre = Jacobians(document(), sample.mechanism.q).centre_of_mass()
        places.append(centre)
    assert mass == pytest.approx(11.3, rel=1e-12)
    speeds = np.vstack((np.zeros((2, 3)), np.cumsum(pushes, axis=0) * h / mass))
    ways = np.cumsum(0.5 * h * (speeds[1:] + speeds[:-1]), axis=0)
    expected = np.vstack((np.zeros(3), ways))[: len(run.samples) : 250]
    found = np.array(places) - places[0]
    assert np.abs(found).max() > 0.005
    # Momentum to 1e-6 kg m/s, as above, for 5 s: 0.4 µm of the way of 10 mm; and twice that.
    assert found == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("axis", range(3))
def test_the_base_gives_way_to_the_hand(axis):
    """A push at the grip comes to it late, by bent arms: first accelerations by the KKT system."""
    push = np.zeros((1, 6))
    push[0, axis] = 1.0
    changed = document_of(load_scene("shared_payload"))
    changed["simulation"]["period"] = 1e-6
    simulator = Simulator(scene_from_document(changed))
    start = simulator.initial_state()
    jacobians = Jacobians(document(), start.q)
    force = jacobians.of_frame(GRIP).T @ push[0]
    rows = jacobians.closing_rows()
    rates, _ = closed_form.kkt(jacobians.inertia(), rows, force, np.zeros(len(rows)))
    found = simulator.step(start, push).v / simulator.period
    # Dampers of c = 0.02 N m s/rad take c h / (2 I) of it in a step, 1e-5 where I is 1e-3 kg m².
    assert found == pytest.approx(rates, abs=3e-5 * np.abs(rates).max())
    assert found[:6] == pytest.approx(rates[:6], abs=0.01 * np.abs(rates[:6]).max())
    assert 0.0 < np.abs(rates[:3]).max() < 0.1 * rates[20 + axis]


def test_a_grasp_that_opens_leaves_the_payload_in_the_other_hand():
    scene = load_scene("shared_payload")
    simulator = Simulator(scene)
    state = simulator.switch(simulator.initial_state(), {"left_grasp": False})
    assert state.active == (False, True)
    one = analyse(simulator.mechanism, state.q, active=state.active).inverse_inertia
    both = analyse(simulator.mechanism, state.q).inverse_inertia
    # What is let go of is not carried: X rises, and there still is no constraint.
    gain = np.linalg.eigvalsh(one - both)
    assert gain.min() > -1e-9 * gain.max()
    assert np.linalg.matrix_rank(one) == 6
    end = simulator.run(state, 200, np.array([[0.5, 0.0, 0.0, 0.0, 0.0, 0.0]])).end
    assert end.active == (False, True)
    assert end.q[21] > state.q[21] + 1e-3


def test_locked_arms_and_one_grasp_feel_as_one_body(run):
    """All joints locked, the whole is one rigid body of 11.3 kg.

    One grasp does: arms that cannot move meet the other one to the file's nine digits only.
    """
    changed = document_of(load_scene("shared_payload"))
    for link in changed["links"]:
        if link["joint"]["type"] == "revolute":
            link["joint"]["locked"] = True
    changed["closures"][0]["active"] = False
    simulator = Simulator(scene_from_document(changed))
    state = simulator.initial_state()
    found = analyse(simulator.mechanism, state.q, active=state.active).inverse_inertia
    first = run.samples[0].mechanism
    mass, centre = Jacobians(document(), first.q).centre_of_mass()
    force = np.array([1.0, 0.5, -0.2])
    grasp_schedule = np.array([0.24, 0.0, 0.0])
    # A push without turning moment about the centre of mass moves all alike.
    wrench = np.concatenate((force, np.cross(centre - grasp_schedule, force)))
    moved = found @ wrench
    assert moved[:3] == pytest.approx(force / mass, rel=1e-7)
    assert np.abs(moved[3:]).max() < 1e-7
