# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Loops held by Baumgarte's pull: how errors decay, how far loops open, when that is refused."""

import numpy as np
import pytest

from hapticmech_ros.errors import ClosureError
from hapticmech_ros.mechanism.motion import Start
from hapticmech_ros.mechanism.tolerances import BAUMGARTE_FAILURE
from oracles.planar_linkages import five_bar, five_bar_bent
from oracles.running import run, simulator, unpushed, with_start

FIVE_BAR = with_start(
    five_bar(-9.81, 0.002), five_bar_bent(1.9, 0.9), np.array([0.9, -1.0, 1.0, 0.5])
)


def held(document, period=1e-3, **simulation):
    return simulator(document, period, **{"stabilisation": "baumgarte", **simulation})


def off_the_closures(mechanism, state, size):
    """Return a configuration with loops open by about ``size`` (m or rad)."""
    space = mechanism.closing_terms(state.q, state.active).space
    change = space.correction(np.ones(space.rows.shape[0]))
    return mechanism.integrate(state.q, size * change / np.abs(change).max())


def test_an_open_loop_closes_as_the_equation_says():
    """φ'' + 2a φ' + a² φ = 0 from rest: φ = φ₀ (1 + a t) exp(-a t)."""
    rate, period, steps = 40.0, 1e-3, 50
    sim = held(FIVE_BAR, period, baumgarte_rate=rate, integrator="rk4")
    mechanism, state, stepper = sim.mechanism, sim.initial_state(), sim.stepper
    q, v = off_the_closures(mechanism, state, 1e-3), np.zeros(state.v.size)
    first = mechanism.closing_terms(q, state.active).residual
    for _ in range(steps):
        q, v, *_ = stepper.advance(Start(q, v, state.active), unpushed(sim))
    found = mechanism.closing_terms(q, state.active).residual
    turned = rate * period * steps
    expected = first * (1.0 + turned) * np.exp(-turned)
    assert np.abs(first).max() > 1e-5
    # rk4 at a h = 0.04, and on a mechanism that moves under gravity.
    assert np.abs(found - expected).max() < 1e-5 * np.abs(first).max()


@pytest.mark.parametrize("integrator", ["rk2", "linearly_implicit"])
def test_loops_end_closer_with_pull(integrator):
    ends = {}
    for rate in (1e-3, 50.0):
        sim = held(FIVE_BAR, baumgarte_rate=rate, integrator=integrator)
        ends[rate] = run(sim, 0.5)[-1].closure_error
    assert 0.0 < ends[50.0] < 0.4 * ends[1e-3]
    assert ends[50.0] < 2e-6


@pytest.mark.parametrize(("share", "lost"), [(0.1, False), (30.0, True)])
def test_a_loop_that_is_lost_is_named(share, lost):
    sim = held(FIVE_BAR)
    state, limit = sim.initial_state(), BAUMGARTE_FAILURE * sim.mechanism.length
    q = off_the_closures(sim.mechanism, state, share * limit / sim.mechanism.length)
    start = Start(q, np.zeros(state.v.size), state.active)
    if not lost:
        assert 0.0 < sim.stepper.advance(start, unpushed(sim)).error < limit
        return
    with pytest.raises(ClosureError, match="came apart") as caught:
        sim.stepper.advance(start, unpushed(sim))
    assert caught.value.closures == ("pin",)
    assert caught.value.residual > limit


def test_a_pull_too_strong_for_the_step_is_refused():
    """a h = 4 is beyond rk2's stability: loops are torn open, and that is said."""
    sim = held(FIVE_BAR, integrator="rk2", baumgarte_rate=4000.0)
    with pytest.raises(ClosureError, match="came apart"):
        run(sim, 0.2)


def test_latching_takes_an_impulse_onto_the_closures():
    document = five_bar(-9.81, closed=True)
    document["closures"][0]["active"] = False
    document = with_start(document, five_bar_bent(1.9, 0.9), np.array([0.9, -1.0, 1.0, 0.5]))
    sim = held(document)
    state = sim.switch(sim.initial_state(), {"pin": True})
    terms = sim.evaluate(state)
    assert np.abs(terms.closure_residual).max() < 1e-14
    assert np.abs(terms.closure_jacobian @ state.v).max() < 1e-12
    assert state.account.latch_loss > 0.0


@pytest.mark.parametrize("stabilisation", ["baumgarte", "projection"])
def test_both_follow_the_same_motion(stabilisation):
    """Held softly or put back, loops that hardly open say the same."""
    motion = run(held(FIVE_BAR, 2.5e-4, stabilisation=stabilisation), 0.2)[-1]
    finer = run(held(FIVE_BAR, 1.25e-4, stabilisation="projection"), 0.2)[-1]
    assert np.abs(motion.q - finer.q).max() < 1e-8
