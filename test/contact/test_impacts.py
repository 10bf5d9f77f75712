# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Impacts: rebounds as the law at every stiffness and phase, no energy made, rest after them."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from contact.test_solver import tumbling
from hapticmech_ros.mechanism.schemes import SCHEMES
from oracles.touching import (
    FLOOR,
    SHAPES,
    UPRIGHT,
    G,
    body,
    on_floor,
    pair,
    run,
    run_with_energies,
    scene,
    shape,
)

STEP = 1e-3
# k h² / m: a contact takes from 314 steps down to a third of one.
KAPPAS = [1e-4, 1e-2, 1.0, 1e2]
LAWS = {
    "hunt_crossley": lambda k, m: {"law": "hunt_crossley", "dissipation": 0.5},
    "kelvin_voigt": lambda k, m: {"damping": 0.2 * np.sqrt(k * m)},
}


def exact(law, stiffness, mass, speed):
    """Return the speed at which a mass that comes in at ``speed`` leaves, by the law itself."""
    chi, damping = law.get("dissipation", 0.0), law.get("damping", 0.0)

    def push(y, rate):
        return stiffness * y * (1.0 + chi * rate) + damping * rate

    def leaves(_, state):
        return push(*state)

    leaves.terminal, leaves.direction = True, -1.0
    omega = np.sqrt(stiffness / mass)
    found = solve_ivp(
        lambda _, state: (state[1], -push(*state) / mass),
        (0.0, 10.0 / omega),
        (1e-9 * speed / omega, speed),
        events=leaves,
        rtol=1e-10,
        atol=1e-12 * speed / omega,
    )
    return -found.y_events[0][-1][1]


def thrown(law, stiffness, mass, speed, phase, **simulation):
    """Return the speed at which a sphere leaves a floor that it meets at a phase of a step."""
    document = on_floor(
        "sphere", 0.05 + phase * speed * STEP, (0, 0, -speed), mass, gravity=(0, 0, 0), **simulation
    )
    document["contacts"][0] |= {"stiffness": stiffness} | law
    _, states, energies = run_with_energies(document, 4.0 * np.sqrt(mass / stiffness) + 4.0 * STEP)
    assert not states[-1].touching.pairs.size
    assert np.diff(energies).max() <= 1e-9 * energies[0]
    return states[-1].v[2]


@pytest.mark.parametrize(
    ("mass", "speed", "phase"), [(1.0, 1.0, 0.0), (1.0, 0.3, 0.37), (0.02, 2.0, 0.81)]
)
@pytest.mark.parametrize("integrator", SCHEMES)
@pytest.mark.parametrize("kappa", KAPPAS)
@pytest.mark.parametrize("name", LAWS)
def test_restitution_is_the_law_s_within_2_percent(name, kappa, integrator, mass, speed, phase):
    stiffness = kappa * mass / STEP**2
    law = LAWS[name](stiffness, mass)
    wanted = exact(law, stiffness, mass, speed)
    assert 0.2 * speed < wanted < 0.95 * speed
    found = thrown(law, stiffness, mass, speed, phase, integrator=integrator)
    assert abs(found - wanted) < 0.02 * wanted


@pytest.mark.parametrize("kappa", KAPPAS)
def test_a_joint_that_meets_a_stopper_rebounds_by_the_same_law(kappa):
    """Of a pendulum's tip; its effective mass is I / r²."""
    link = body("one", 0.5, "revolute")
    link["joint"]["axis"] = [0.0, 1.0, 0.0]
    tip = shape("one", SHAPES["sphere"], origin={"xyz": [0.3, 0.0, 0.0]})
    document = scene([link], [FLOOR, tip], [pair("one_shape")], gravity=(0, 0, 0))
    moment = 0.5 * 0.1**2 / 6.0
    mass, rate = moment / 0.3**2, 2.0
    stiffness = kappa * mass / STEP**2
    law = LAWS["hunt_crossley"](stiffness, mass)
    document["contacts"][0] |= {"stiffness": stiffness} | law
    document["initial_state"] = {"q": {"of_one": -0.052 / 0.3}, "v": {"of_one": rate}}
    _, states = run(document, 0.02 + 4.0 * np.sqrt(mass / stiffness))
    assert not states[-1].touching.pairs.size
    # It meets the floor nearly upright: the tip's speed there.
    assert -0.3 * states[-1].v[0] == pytest.approx(exact(law, stiffness, mass, 0.6), rel=0.02)


@pytest.mark.parametrize("kappa", [*KAPPAS, 1e4])
def test_without_damping_a_ball_bounces_on(kappa):
    """From 5 cm, ten times and more: nothing is gained, and next to nothing is lost."""
    document = on_floor("sphere", 0.1, law={"stiffness": kappa / STEP**2})
    _, states, energies = run_with_energies(document, 4.0)
    start = energies[0] - G * 0.05
    assert energies.max() <= energies[0] + 1e-9
    assert energies[-1] - start > 0.98 * (energies[0] - start)
    speeds = np.array([state.v[2] for state in states])
    assert np.sum(np.diff(np.sign(speeds)) > 0) >= 5


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("stiffness", [1e3, 1e5, 1e7])
def test_a_box_that_tumbles_down_makes_no_energy(stiffness, friction):
    """On edges and corners, each of another effective mass; to T16a's bound in a step."""
    turned = np.array([0.3, 0.2, 0.1, 1.0]) / np.sqrt(1.14)
    document = scene(
        [body("one")],
        [FLOOR, shape("one", SHAPES["box"])],
        [pair("one_shape", stiffness=stiffness, friction=friction)],
        {"one": [0, 0, 0.15, *turned]},
        {"one": [0.5, 0.0, 0.0, 3.0, 2.0, 1.0]},
    )
    _, states, energies = run_with_energies(document, 0.8)
    assert energies.max() <= energies[0] + 1e-6
    assert sum(state.touching.pairs.size > 0 for state in states[1:]) > 10


def test_bodies_that_fall_onto_each_other_come_to_rest_with_the_forces_of_statics():
    document = tumbling()
    for contact in document["contacts"]:
        contact |= {"stiffness": 1e6, "damping": 100.0}
    sim, states, energies = run_with_energies(document, 3.0)
    assert energies.max() <= energies[0] + 1e-6
    assert np.abs(states[-1].v).max() < 1e-4
    floor = [i for i, c in enumerate(sim.scene.contacts) if "floor" in (c.a, c.b)]
    on_the_floor = np.isin(states[-1].touching.pairs, floor)
    weight = G * sum(link.inertial.mass for link in sim.scene.links)
    carried = states[-1].touching.forces[on_the_floor, 2].sum()
    assert carried == pytest.approx(weight, rel=1e-3)


def test_an_impact_beside_one_that_rests_leaves_it_at_rest():
    links = [body("one"), body("two")]
    document = scene(
        links,
        [FLOOR, shape("one", SHAPES["box"]), shape("two", SHAPES["sphere"])],
        [pair("one_shape", damping=100.0), pair("two_shape", stiffness=1e7)],
        {"one": [0, 0, 0.05 - G / 4e5, *UPRIGHT], "two": [1.0, 0, 0.06, *UPRIGHT]},
        {"two": [0, 0, -1.0, 0, 0, 0]},
    )
    _, states = run(document, 0.1)
    places = np.array([state.q[:7] for state in states])
    assert max(state.v[8] for state in states) > 0.9
    assert np.abs(places - places[0]).max() < 1e-7


@pytest.mark.parametrize(
    ("kappa", "refined", "inaccurate"),
    [(1e-3, False, False), (1.0, True, False), (1e5, True, True)],
)
def test_divided_steps_are_counted_and_what_they_do_not_resolve(kappa, refined, inaccurate):
    document = on_floor("sphere", 0.0505, (0, 0, -1.0), gravity=(0, 0, 0))
    document["contacts"][0] |= {
        "stiffness": kappa / STEP**2,
        "damping": 0.2 * np.sqrt(kappa) / STEP,
    }
    _, states = run(document, 0.2 if kappa < 1.0 else 0.01)
    account = states[-1].account
    assert states[-1].v[2] > 0.0
    assert (account.refined > 0, account.inaccurate > 0) == (refined, inaccurate)
