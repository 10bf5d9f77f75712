# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Energy never grows: step by step to the bounds of T16a and T16c, and in the end not at all."""

from dataclasses import replace

import numpy as np
import pytest

from contact.test_solver import corner, heavy, sliding, tumbling
from hapticmech_ros import Session, load_scene
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


def sinking(integrator, stiffness=2.6e5):
    """Return a box that is put on soft springs without their load, and sinks into them."""
    law = {"stiffness": stiffness, "damping": 0.0}
    return on_floor("box", 0.05, law=law, integrator=integrator)


@pytest.mark.parametrize("integrator", ["rk2", "rk4"])
@pytest.mark.parametrize("stiffness", [2e3, 2e4, 7e4, 2.6e5, 1e7])
def test_the_bounds_of_a_step_are_kept(integrator, stiffness):
    """Whichever law it sinks in by, and from one to the other: m (g h)² / 2 at most (T16c)."""
    _, _, energies = run_with_energies(sinking(integrator, stiffness), 0.2)
    most = 0.5 * (STEP * G) ** 2
    assert np.diff(energies).max() <= most
    assert (energies - energies[0] <= most).all()
    assert energies[-1] <= energies[0] + 1e-12


@pytest.mark.parametrize("stiffness", [2.6e5, 1e6, 1e7])
def test_with_semi_implicit_euler_no_step_gains_anything(stiffness):
    _, _, energies = run_with_energies(sinking("semi_implicit_euler", stiffness), 0.3)
    assert np.diff(energies).max() <= 1e-12
    assert energies[-1] < energies[0]


@pytest.mark.parametrize(
    ("make", "mass", "duration"),
    [
        (lambda: heavy(1.0, 1.0, 1.0), 3.0, 0.5),
        (lambda: corner(0.3), 1.0, 0.5),
        (sliding, 2.0, 0.6),
        (tumbling, 3.0, 1.0),
    ],
    ids=["stack", "corner", "sliding", "tumbling"],
)
def test_energy_never_grows(make, mass, duration):
    """With friction, edges, corners, and bodies on bodies: below the start, and falling."""
    _, states, energies = run_with_energies(make(), duration)
    assert energies.max() <= energies[0] + 1e-9
    fastest = max(np.abs(state.v).max() for state in states)
    # Between any two times: m g h |Δv| / 2 with all masses and the largest rate there was.
    highest_later = np.maximum.accumulate(energies[::-1])[::-1]
    assert (highest_later - energies).max() <= 0.5 * STEP * mass * G * 2.0 * fastest
    assert energies[-1] < energies[0] - 1e-3
    lost = np.array([state.account.contact_loss for state in states])
    # What rk2 makes of turning bodies is left.
    assert energies + lost == pytest.approx(np.full(energies.size, energies[0]), abs=1e-4)
    made = np.array([state.account.contact_made for state in states])
    assert (made == np.maximum.accumulate(np.maximum(lost, 0.0)) - lost).all()


def test_what_contacts_give_back_of_what_they_lost_is_in_the_account_and_in_the_drift():
    """By ticks of a session as by steps of a simulator."""
    session, lost = Session(load_scene("peg_in_hole")), [0.0]
    for _ in range(1500):
        session.tick()
        lost.append(session.mechanism.account.contact_loss)
    account = session.mechanism.account
    assert max(lost) > 0.0
    assert account.contact_most == max(lost)
    assert account.contact_made == max(lost) - lost[-1]
    worse = replace(account, contact_loss=account.contact_loss - 1.0)
    exchanged = abs(worse.work_in) + worse.lost + worse.moved
    more = worse.drift(0.0) * exchanged - abs(worse.surplus)
    assert more == pytest.approx(account.contact_made + 1.0, rel=1e-12)


@pytest.mark.parametrize("integrator", SCHEMES)
@pytest.mark.parametrize("substeps", [1, 4])
def test_every_rule_comes_to_the_same_rest(integrator, substeps):
    law = {"stiffness": 1e5, "damping": 300.0, "friction": 0.5}
    document = on_floor(
        "box", 0.06, (0.5, 0.0, 0.0), law=law, integrator=integrator, substeps=substeps
    )
    _, states, energies = run_with_energies(document, 1.0)
    end = states[-1]
    assert np.abs(end.v).max() < 1e-8
    assert end.q[2] == pytest.approx(0.05 - G / 4e5, abs=1e-9)
    # Thrown from 1 cm: it slides until friction has taken its speed, landing included.
    assert end.q[0] == pytest.approx(0.5 * np.sqrt(2 * 0.01 / G) + 0.0055, abs=0.006)
    assert end.touching.forces.sum(axis=0) == pytest.approx([0, 0, G], abs=1e-6)
    assert energies.max() <= energies[0] + 1e-12


def test_a_block_on_a_slope_of_20_degrees_stays_for_a_minute():
    """Friction of 0.4, tan 20° = 0.364: what it moves by after settling is below 10 nm."""
    angle = np.radians(20.0)
    gravity = (G * np.sin(angle), 0.0, -G * np.cos(angle))
    law = {"stiffness": 1e5, "damping": 500.0, "friction": 0.4}
    document = on_floor(
        "box", 0.05 - G * np.cos(angle) / 4e5, law=law, gravity=gravity, period=0.005
    )
    _, states = run(document, 61.0, 200)
    settled, end = states[1], states[-1]
    assert np.abs(end.q - settled.q).max() < 1e-8
    forces = end.touching.forces.sum(axis=0)
    assert forces == pytest.approx(-np.array(gravity), abs=1e-6)
    # All four share what holds it, in proportion to nothing but need: each is within its cone.
    assert np.hypot(*end.touching.forces[:, :2].T).max() < 0.4 * end.touching.forces[:, 2].max()


def test_what_slides_down_a_wall_gains_nothing():
    """Light friction carries less than the weight: the case in which T16a has its gain."""
    wall = {**FLOOR, "name": "wall", "origin": {"rpy": [0.0, np.pi / 2, 0.0]}}
    document = scene(
        [body("one")],
        [wall, shape("one", SHAPES["box"])],
        [pair("one_shape", "wall", stiffness=1e4, damping=50.0, friction=0.2)],
        {"one": [0.0501, 0.0, 0.0, *UPRIGHT]},
        {"one": [-0.3, 0.0, 0.0, 0.0, 0.0, 0.0]},
    )
    _, states, energies = run_with_energies(document, 0.2)
    touched = [state.touching.pairs.size > 0 for state in states[1:]]
    assert 5 < sum(touched) < len(touched)
    assert energies.max() <= energies[0] + 1e-12
    assert np.diff(energies).max() <= 0.125 * (STEP * G) ** 2 + 1e-12
