# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Loops that close while running: impulse in the mass metric, momentum, refusals, latching."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from hapticmech_ros.errors import InvalidInputError
from oracles.analysed import terms_of
from oracles.differences import relative
from oracles.generator import blank, closed_chain, floats, random_inertial, unit
from oracles.jacobians import Jacobians
from oracles.kinematics import (
    link_poses,
    origin_in,
    place,
    turn,
)
from oracles.running import run, simulator, total_energy, with_start

KINDS = ("spherical", "revolute", "weld", "planar_pin")
NO_WRENCH = np.zeros((2, 6))


def opened(document, **options):
    closures = [closure | {"active": False} | options for closure in document["closures"]]
    return document | {"closures": closures}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(4))
def test_closing_takes_the_analytic_impulse(kind, seed):
    sample = closed_chain(seed, kind)
    sim = simulator(with_start(opened(sample.document), sample.q, sample.v))
    before = sim.initial_state()
    # Open, the rates are the authored ones, to the rounding of D's Cholesky factor and back.
    assert relative(before.v, sample.v) < 1e-13
    after = sim.switch(before, {"loop": True})
    terms = terms_of(sample.document, sample.q)
    apart = terms.w @ sample.v
    weighted = np.linalg.solve(terms.d, terms.w.T)
    impulse = np.linalg.solve(terms.w @ weighted, apart)
    assert after.active == (True,)
    # eps times the condition of W D^-1 W^T, up to 1e4.
    assert relative(after.v, sample.v - weighted @ impulse, np.linalg.norm(sample.v)) < 1e-11
    # Momentum D v changes by W^T times the impulse only.
    assert relative(terms.d @ (sample.v - after.v), terms.w.T @ impulse) < 1e-10
    loss = 0.5 * apart @ impulse
    assert after.account.latch_loss == pytest.approx(loss, rel=1e-10)
    assert loss > 0.0
    # Opening again costs nothing.
    again = sim.switch(after, {"loop": False})
    assert again.active == (False,)
    assert np.array_equal(again.v, after.v)
    assert again.account.latch_loss == after.account.latch_loss


def two_bodies(seed, kind, flip=False, **options):
    """Return two free bodies whose closure frames meet, flying apart; flip: upside down."""
    rng = np.random.default_rng(seed)
    document = blank()
    q, v = [], rng.normal(size=12)
    for index in range(2):
        name = f"body{index}"
        joint = {"name": f"joint{index}", "type": "free"}
        inertial = random_inertial(rng, planar=False)
        document["links"].append(
            {"name": name, "parent": "world", "joint": joint, "inertial": inertial}
        )
        q += [rng.uniform(-0.3, 0.3, 3), unit(rng, 4)]
    q = np.concatenate(q)
    document["operational_points"] = [
        {"name": f"grip{index}", "link": f"body{index}"} for index in range(2)
    ]
    poses = link_poses(document, q)
    origin = {"xyz": floats(rng.uniform(-0.2, 0.2, 3))}
    frame = place(poses["body0"], origin)
    if flip:
        frame = (frame[0] @ turn((1, 0, 0), np.pi), frame[1])
    b = {"link": "body1", "origin": origin_in(poses["body1"], frame)}
    a = {"link": "body0", "origin": origin}
    document["closures"] = [{"name": "loop", "kind": kind, "a": a, "b": b, "active": False}]
    document["closures"][0] |= options
    return with_start(document, q, v), q, v


def momentum(document, q, v):
    """Return linear and angular momentum about the origin."""
    return Jacobians(document, q).momenta() @ v


@pytest.mark.parametrize("kind", ["spherical", "revolute", "weld"])
@pytest.mark.parametrize("seed", range(3))
def test_bodies_that_catch_each_other_keep_their_momentum(kind, seed):
    document, q, v = two_bodies(seed, kind)
    sim = simulator(document)
    after = sim.switch(sim.initial_state(), {"loop": True})
    expected = momentum(document, q, v)
    # The frames met to 1e-16, so that only rates changed; eps times condition 1e3.
    assert relative(momentum(document, after.q, after.v), expected) < 1e-12
    # ...and keep it while they fly on together, to the order 4 of a 1 ms step at 3 rad/s.
    state = sim.run(after, 100).end
    assert relative(momentum(document, state.q, state.v), expected) < 1e-8


@pytest.mark.parametrize("kind", KINDS)
def test_frames_far_apart_are_refused(kind):
    sample = closed_chain(1, kind)
    document = copy.deepcopy(opened(sample.document))
    document["closures"][0]["b"]["origin"]["xyz"][0] += 0.2
    sim = simulator(with_start(document, sample.q))
    state = sim.initial_state()
    with pytest.raises(InvalidInputError, match="loop") as caught:
        sim.switch(state, {"loop": True})
    assert caught.value.value == pytest.approx(0.2, rel=1e-9)
    assert sim.step(state, NO_WRENCH).active == (False,)


@pytest.mark.parametrize("kind", ["weld", "revolute"])
def test_axes_upside_down_are_refused(kind):
    """The residual vanishes there, but the frames do not meet."""
    document, _, _ = two_bodies(0, kind, flip=True)
    sim = simulator(document)
    with pytest.raises(InvalidInputError, match="loop"):
        sim.switch(sim.initial_state(), {"loop": True})


@pytest.mark.parametrize("kind", ["weld", "revolute"])
def test_axes_upside_down_do_not_latch(kind):
    document, q, _ = two_bodies(0, kind, flip=True, latch_distance=0.05)
    sim = simulator(with_start(document, q))
    assert sim.step(sim.initial_state(), NO_WRENCH).active == (False,)


@pytest.mark.parametrize("kind", KINDS)
def test_latches_by_itself_once_within_its_distance(kind):
    sample = closed_chain(2, kind)
    limit, period = 1e-4, 1e-5
    away = simulator(with_start(opened(sample.document), sample.q, -sample.v), period)
    start = run(away, 20 * period)[-1]
    # The same motion backwards in time meets the closure after 20 steps.
    document = with_start(opened(sample.document, latch_distance=limit), start.q, -start.v)
    sim = simulator(document, period)
    free = simulator(with_start(opened(sample.document), start.q, -start.v), period)
    state = reached = sim.initial_state()
    assert sim.mechanism.distance_of(0, state.q, state.v)[0] > limit
    for _ in range(25):
        before = state
        state = sim.step(before, NO_WRENCH)
        if state.active == (True,):
            reached = free.step(replace(before), NO_WRENCH)
            break
    assert state.active == (True,)
    distance = sim.mechanism.distance_of(0, reached.q, reached.v)[0]
    assert distance < limit
    terms = terms_of(sample.document, reached.q)
    apart = terms.w @ reached.v
    loss = 0.5 * apart @ np.linalg.solve(terms.w @ np.linalg.solve(terms.d, terms.w.T), apart)
    # The position also moves by up to limit / 0.1 m of the geometry, and the energy with it.
    assert state.account.latch_loss == pytest.approx(loss, rel=20.0 * limit / 0.1)
    assert state.closure_error < 1e-11
    gone = total_energy(free, reached) - total_energy(sim, state)
    assert state.account.latch_loss == pytest.approx(gone, rel=1e-9)
    # Once latched it stays so.
    assert sim.step(state, NO_WRENCH).active == (True,)


@pytest.mark.parametrize("kind", KINDS)
def test_one_that_was_opened_latches_again_only_after_it_has_left(kind):
    """Opened where it is closed, it stays open until its frames have been apart."""
    sample = closed_chain(2, kind)
    limit, period = 1e-4, 1e-5
    document = with_start(opened(sample.document, latch_distance=limit), sample.q, -sample.v)
    sim = simulator(document, period)
    state = sim.switch(sim.initial_state(), {"loop": True})
    state = sim.switch(state, {"loop": False})
    still = replace(state, v=0.0 * state.v)
    assert sim.step(still, NO_WRENCH).active == (False,)
    away = sim.step(replace(state, v=-sample.v), NO_WRENCH)
    while sim.mechanism.distance_of(0, away.q, away.v)[0] < limit:
        assert away.active == (False,)
        away = sim.step(away, NO_WRENCH)
    back = replace(away, v=-away.v)
    for _ in range(40):
        back = sim.step(back, NO_WRENCH)
    assert back.active == (True,)
