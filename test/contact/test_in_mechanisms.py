# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Contacts of mechanisms: planar ones, with closed loops in motion, and links on links."""

from itertools import pairwise

import numpy as np
import pytest

from contact.test_felt import against_a_wall
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.analysis import contact_wrench
from hapticmech_ros.scene import document_of, scene_from_document
from hapticmech_ros.simulation import Simulator
from oracles.touching import G, broken_law, run

ROUGH = {"stiffness": 5e3, "damping": 20.0, "friction": 0.3}
# Into the wall, which is on the side of smaller x, and along it.
PUSH = np.array([[-0.5, 0.3, 0.0, 0.0, 0.0, 0.0]])


def pushed(name="five_bar", duration=0.6, law=ROUGH, **simulation):
    """Return the simulator and all states of a mechanism that is pushed along a wall."""
    document = document_of(against_a_wall(name, law))
    document["simulation"] |= simulation
    return run(document, duration, wrenches=PUSH)


def total(sim, state):
    """Return energy held, less what came in, plus what joints have lost, J: contacts' to take."""
    account = state.account
    held = sum(sim.mechanism.energy(state.q, state.v)) + account.contact_energy
    return held - account.work_in + account.damping_loss


@pytest.mark.parametrize("integrator", ["rk2", "rk4", "semi_implicit_euler"])
@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("name", ["five_bar", "two_link"])
def test_a_tip_that_slides_along_a_wall_gains_nothing(name, integrator, substeps):
    """The loop stays closed, friction takes energy, and none comes from anywhere."""
    sim, states = pushed(name, integrator=integrator, substeps=substeps)
    touched = np.array([state.touching.pairs.size > 0 for state in states[1:]])
    assert touched.sum() > 50
    energies = np.array([total(sim, state) for state in states])
    lost = np.array([state.account.contact_loss for state in states])
    work = states[-1].account.work_in
    assert work > 1e-4
    # What rules of first and of higher order are off by, contacts or not.
    order = (3e-2 if integrator == "semi_implicit_euler" else 1e-4) * work
    assert (energies - np.minimum.accumulate(energies)).max() < order
    assert energies + lost == pytest.approx(np.full(energies.size, energies[0]), abs=order)
    assert lost[-1] > 1e-2 * work
    assert max(state.closure_error for state in states) < 1e-9
    # In a plane there is no force across it, but for the rounding of the wall's axes.
    across = [np.abs(state.touching.forces[:, 2]) for state in states[1:]]
    assert np.concatenate(across).max() < 1e-12


def test_forces_in_a_closed_loop_in_motion_are_what_the_law_says():
    """Points of links that turn by ω h in a step see other rates by as much."""
    sim, states = pushed(duration=0.3)
    sliding = 0
    for before, after in pairwise(states):
        found = after.touching
        if found.pairs.size and before.touching is not None and before.touching.pairs.size:
            turned = np.abs(after.v).max() * sim.period
            speed = np.abs(after.v).max() * sim.mechanism.length
            assert broken_law(sim, before, after) < 20.0 * 4.0 * turned * speed + 1e-9
            sliding += 1
    assert sliding > 50


def test_the_wrench_is_the_consistent_map_of_contacts_in_motion():
    """X F_c = a_c along directions that are free, at every fifth step of a loop that moves."""
    sim, states = pushed(duration=0.3)
    analyser, checked = Analyser(sim.mechanism), 0
    for state in states[1::5]:
        found = state.touching
        if not found.forces.any():
            continue
        terms = sim.evaluate(state)
        analysis = analyser.analyse(terms)
        wrench = contact_wrench(analyser, terms, found.joint_force)
        nothing = np.zeros_like(found.joint_force)
        rates = terms.acceleration(found.joint_force)[0] - terms.acceleration(nothing)[0]
        free = analysis.weights == 0.0
        along = analysis.spectrum.wrenches[:, free].T
        asked = (terms.points[0].jacobian @ rates)[analysis.rows]
        given = (analysis.inverse_inertia @ wrench)[analysis.rows]
        assert free.sum() >= 1
        assert along @ given == pytest.approx(along @ asked, rel=1e-8, abs=1e-9)
        assert np.linalg.norm(wrench) > 0.0
        checked += 1
    assert checked > 10


def pendulums(planar=True):
    """Return two arms of one mechanism that swing into each other, a capsule on each."""
    arm = {"kind": "capsule", "radius": 0.01, "length": 0.2}
    inertia = {"ixx": 4e-4, "iyy": 4e-4, "izz": 4e-4}
    links = [
        {
            "name": name,
            "joint": {
                "name": f"of_{name}",
                "type": "revolute",
                "axis": [0.0, 0.0, 1.0] if planar else [0.0, 1.0, 0.0],
                "origin": {"xyz": [at, 0.0, 0.0]},
            },
            "inertial": {"mass": 0.1, "com": [0.1, 0.0, 0.0], "inertia": inertia},
        }
        for name, at in (("left", -0.05), ("right", 0.05))
    ]
    shapes = [
        {
            "name": f"{name}_arm",
            "link": name,
            "origin": {"xyz": [0.1, 0.0, 0.0], "rpy": [0.0, np.pi / 2, 0.0]},
            "geometry": arm,
        }
        for name in ("left", "right")
    ]
    law = {"stiffness": 1e4, "damping": 5.0, "friction": 0.3}
    down = [0.0, -G, 0.0] if planar else [0.0, 0.0, -G]
    start = -np.pi / 2 if planar else np.pi / 2
    return {
        "format": "hapticmech-scene/1",
        "name": "pendulums",
        "task_space": "planar" if planar else "spatial",
        "gravity": down,
        "links": links,
        "operational_points": [{"name": "held", "link": "left"}],
        "shapes": shapes,
        "contacts": [{"name": "arms", "a": "left_arm", "b": "right_arm", **law}],
        "initial_state": {"q": {"of_left": start - 0.9, "of_right": start}},
        "hand": {"kind": "constant_wrench"},
    }


@pytest.mark.parametrize("planar", [True, False])
def test_links_of_one_mechanism_hit_each_other(planar):
    document = pendulums(planar=planar)
    if not planar:
        document["initial_state"]["q"]["of_left"] = np.pi / 2 + 0.9
    sim = Simulator(scene_from_document(document))
    state, calm = sim.initial_state(), np.zeros((1, 6))
    start, touched, most = total(sim, state), 0, -np.inf
    for _ in range(2500):
        before, state = state, sim.step(state, calm)
        found = state.touching
        if found.pairs.size:
            touched += 1
            # Action is reaction: about both pivots, the arms get what one force does.
            force = found.forces.sum(axis=0)
            arms = [
                sim.mechanism.frame_pose(before.q, link).translation for link in ("left", "right")
            ]
            axis = np.array(document["links"][0]["joint"]["axis"])
            wanted = [
                sign * axis @ np.cross(found.points - arm, found.forces).sum(axis=0)
                for arm, sign in zip(arms, (1.0, -1.0), strict=True)
            ]
            # Of a divided step the last part's forces are told.
            if found.divided == 1:
                assert found.joint_force == pytest.approx(wanted, abs=1e-10)
            assert np.linalg.norm(force) < 1e3
        most = max(most, total(sim, state))
    assert touched > 10
    assert most <= start + 1e-7
    assert state.account.contact_loss > 1e-3
