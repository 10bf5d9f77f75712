# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A period in one call, and what is left to Python: searches, workspace, steps that need care."""

from itertools import pairwise

import numpy as np
import pytest

import hapticmech_ros.contact.stepping as contact_stepping
from contact.test_felt import against_a_wall
from contact.test_in_mechanisms import PUSH, ROUGH, pushed
from hapticmech_ros.contact.layout import FIRST_WORKSPACE
from hapticmech_ros.mechanism.kernels.layout import sparse
from hapticmech_ros.mechanism.kernels.model import RunPlan
from hapticmech_ros.mechanism.kernels.run_kernels import INACCURATE
from hapticmech_ros.scene import document_of, scene_from_document
from hapticmech_ros.simulation import Simulator
from oracles.touching import (
    FLOOR,
    SHAPES,
    UPRIGHT,
    body,
    on_floor,
    on_links,
    pair,
    run,
    scene,
    shape,
)

ROUNDING = 1e-12


def stack(**simulation):
    """Return the document of a box on a box on the floor, turned, and moved along."""
    return scene(
        [body("low"), body("high")],
        [FLOOR, shape("low", SHAPES["box"]), shape("high", SHAPES["box"])],
        [
            pair("low_shape", friction=0.5, damping=200.0),
            pair("high_shape", "low_shape", friction=0.4, damping=200.0),
        ],
        {
            "low": [0.0, 0.0, 0.05, *UPRIGHT],
            "high": [0.01, 0.0, 0.15, 0.0, 0.0, np.sin(0.1), np.cos(0.1)],
        },
        {"high": [0.3, 0.1, 0.0, 0.0, 0.0, 0.0]},
        **simulation,
    )


@pytest.mark.parametrize("integrator", ["rk2", "rk4", "semi_implicit_euler"])
@pytest.mark.parametrize("name", ["five_bar", "two_link", "stack"])
def test_it_is_the_step_without_contacts_under_their_wrenches(name, integrator):
    """Of a mechanism that has none of them, pushed by the forces that were found."""
    if name == "stack":
        sim, states = run(stack(integrator=integrator), 0.1)
        push = np.zeros((1, 6))
    else:
        sim, states = pushed(name, 0.3, integrator=integrator)
        push = PUSH
    alone = Simulator(sim.scene.model_copy(update={"contacts": (), "shapes": ()}))
    seen = 0
    for before, after in pairwise(states):
        # Of a divided step the last part's forces are told.
        if not after.touching.pairs.size or after.touching.divided > 1:
            continue
        seen += 1
        expected = alone.step(before, push, on_links(sim, before, after))
        scale = 1.0 + np.abs(expected.v).max()
        assert np.abs(after.q - expected.q).max() < ROUNDING
        assert np.abs(after.v - expected.v).max() < 1e-11 * scale
    assert seen > 20


@pytest.mark.parametrize("integrator", ["rk2", "semi_implicit_euler"])
def test_substeps_are_steps_with_searches_between(integrator):
    """What a stack goes through in a period of three substeps, and in three periods."""
    period = 1e-3
    _, whole = run(stack(period=period, substeps=3, integrator=integrator), 0.05)
    sim, single = run(stack(period=period / 3, integrator=integrator), 0.05)
    assert sim.period == pytest.approx(period / 3)
    for one, other in zip(whole, single[::3], strict=True):
        assert one.q == pytest.approx(other.q, abs=1e-9)
        assert one.v == pytest.approx(other.v, abs=1e-6)
        assert one.account.contact_loss == pytest.approx(other.account.contact_loss, abs=1e-9)


def test_a_state_has_all_that_its_next_step_needs():
    """Steps elsewhere in between leave no trace, to the bit; nor do those of another simulator."""
    document = stack(substeps=2)
    sim, states = run(document, 0.05)
    other, calm = Simulator(scene_from_document(document)), np.zeros((1, 6))
    for at in (30, 10, 40, 0, 11):
        for stepper in (sim, other):
            again = stepper.step(states[at], calm)
            assert (again.q == states[at + 1].q).all()
            assert (again.v == states[at + 1].v).all()
            assert (again.touching.forces == states[at + 1].touching.forces).all()
            assert again.account == states[at + 1].account


@pytest.mark.parametrize(("height", "down"), [(0.0501, 0.0), (0.0501, -0.3), (0.0499, 0.0)])
def test_more_points_than_there_is_room_for_at_first(height, down):
    """Six boxes move and lose energy as each of them alone does, from the first contact on."""
    names = [f"box{index}" for index in range(6)]
    many = scene(
        [body(name) for name in names],
        [FLOOR, *(shape(name, SHAPES["box"]) for name in names)],
        [pair(f"{name}_shape", friction=0.5) for name in names],
        {name: [0.3 * at, 0.0, height, *UPRIGHT] for at, name in enumerate(names)},
        {name: [0.2, 0.1, down, 0.0, 0.0, 0.5] for name in names},
    )
    sim, states = run(many, 0.1)
    document = on_floor("box", height, law={"friction": 0.5})
    document["initial_state"]["v"]["of_one"] = [0.2, 0.1, down, 0.0, 0.0, 0.5]
    _, alone = run(document, 0.1)
    assert max(state.touching.pairs.size for state in states[1:]) == 24 > FIRST_WORKSPACE
    for state, single in zip(states, alone, strict=True):
        for at in range(6):
            away = state.q[7 * at : 7 * at + 7] - single.q
            assert np.abs(away[1:]).max() < 1e-9
            assert abs(away[0] - 0.3 * at) < 1e-9
    accounts = [state.account for state in states]
    assert accounts[-1].contact_loss == pytest.approx(6 * alone[-1].account.contact_loss, abs=1e-9)
    first, last = (sum(sim.mechanism.energy(state.q, state.v)) for state in (states[0], states[-1]))
    kept = [one.contact_energy - one.work_in + one.contact_loss for one in accounts]
    assert first - last == pytest.approx(kept[-1] - kept[0], abs=1e-6)


@pytest.mark.parametrize("substeps", [1, 3])
def test_a_step_that_is_done_again_keeps_its_contacts(monkeypatch, substeps):
    """Each substep left to Python, with the forces that the kernel found."""
    kernel, law = contact_stepping.advance_period, {"friction": 0.5, "damping": 20.0}
    document = on_floor("box", 0.0501, (0.3, 0.1, 0.0), law=law, substeps=substeps)

    def wary(*arguments):
        *_, work, _, _, plan = arguments
        run = RunPlan(plan)
        run.steps, run.begins_with = 1, contact_stepping.EACH
        kept = work.copy()
        code = kernel(*arguments)
        if code == 0:
            work[:] = kept
            return INACCURATE
        return code

    _, wanted = run(document, 0.1)
    monkeypatch.setattr(contact_stepping, "advance_period", wary)
    _, found = run(document, 0.1)
    assert sum(state.touching.pairs.size > 0 for state in found[1:]) > 50
    for one, other in zip(found, wanted, strict=True):
        assert one.q == pytest.approx(other.q, abs=1e-10)
        assert one.v == pytest.approx(other.v, abs=1e-8)
        assert one.account.work_in == pytest.approx(other.account.work_in, abs=1e-10)
        assert one.account.contact_loss == pytest.approx(other.account.contact_loss, abs=1e-8)


def test_a_sparse_factorisation_gives_the_same_forces():
    scene_of = scene_from_document(document_of(against_a_wall("five_bar", ROUGH)))
    dense, other = Simulator(scene_of), Simulator(scene_of)
    state = dense.initial_state()
    active, mechanism = state.active, other.mechanism
    mechanism.take(active, sparse(mechanism.active_set(active), state.q))
    assert mechanism.active_set(active).is_sparse
    one, two = state, other.initial_state()
    touched = 0
    for _ in range(300):
        one, two = dense.step(one, PUSH), other.step(two, PUSH)
        assert two.q == pytest.approx(one.q, abs=1e-9)
        assert two.touching.forces == pytest.approx(one.touching.forces, abs=1e-6)
        touched += one.touching.pairs.size > 0
    assert touched > 50
