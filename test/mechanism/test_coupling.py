# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Couplings: joints that keep a ratio, as gears and mimic joints do."""

import numpy as np
import pytest

from hapticmech_ros.errors import SceneError
from hapticmech_ros.mechanism.redundancy import redundancy
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.simulation import Simulator
from oracles.implementations import apart, condition
from oracles.mechanism.stepping import ReadableSimulator
from oracles.planar_linkages import INERTIAS, LENGTHS, MASSES, chain
from oracles.running import run, unaccounted

BOTH = pytest.mark.parametrize("kind", [Simulator, ReadableSimulator])
RATIO, OFFSET = -2.5, 0.3


def geared(links=2, gravity_y=-9.81, sliding=False, **changes):
    """Return a chain whose second joint is geared to its first."""
    document = chain(LENGTHS[:links], MASSES[:links], INERTIAS[:links], gravity_y)
    if sliding:
        document["links"][1]["joint"] |= {"type": "prismatic", "axis": [1.0, 0.0, 0.0]}
    names = [link["joint"]["name"] for link in document["links"]]
    coupling = {"name": "gear", "joint": names[1], "leader": names[0]}
    document["couplings"] = [coupling | {"ratio": RATIO, "offset": OFFSET} | changes]
    return document


def simulator(document, kind=Simulator):
    return kind(scene_from_document(document))


@BOTH
@pytest.mark.parametrize("sliding", [False, True])
def test_joints_keep_their_ratio_and_energy_stays(kind, sliding):
    sim = simulator(geared(sliding=sliding), kind)
    states = run(sim, 0.5)
    assert max(abs(s.q[1] - RATIO * s.q[0] - OFFSET) for s in states) < 1e-13
    assert max(abs(s.v[1] - RATIO * s.v[0]) for s in states) < 1e-12
    # What rk4 leaves: these bars of 45 mm swing at 15 rad/s.
    fastest = max(sim.mechanism.energy(s.q, s.v)[0] for s in states)
    assert np.abs(unaccounted(sim, states)).max() < 1e-7 * fastest
    assert np.ptp([s.q[0] for s in states]) > 0.03


@BOTH
def test_it_moves_as_one_joint_with_the_inertia_of_both(kind):
    """With θ₂ = r θ₁ + c, [1 r] D [1 r]ᵀ θ̈₁ = [1 r] τ where nothing moves yet."""
    sim = simulator(geared(), kind)
    state = sim.initial_state()
    terms = sim.evaluate(state)
    along = np.array((1.0, RATIO))
    expected = along @ -terms.bias_force / (along @ terms.inertia @ along)
    found, force = terms.acceleration(np.zeros(2))
    assert found == pytest.approx(along * expected, rel=1e-12)
    residual = terms.inertia @ found + terms.bias_force + terms.closure_jacobian.T @ force
    assert np.abs(residual).max() < 1e-12 * np.abs(terms.bias_force).max()


def test_terms_are_those_of_the_readable_ones():
    document = geared(links=4)
    ours, plain = simulator(document), simulator(document, ReadableSimulator)
    state = ours.initial_state()
    generator = np.random.default_rng(5)
    for _ in range(20):
        q, v = state.q + generator.normal(size=4), generator.normal(size=4)
        one, other = (s.mechanism.evaluate(q, v, state.active) for s in (ours, plain))
        assert np.array_equal(one.closure_jacobian, other.closure_jacobian)
        assert np.abs(one.closure_residual - other.closure_residual).max() < 1e-14
        assert np.array_equal(one.closure_bias, np.zeros(1))
        push = generator.normal(size=4)
        accelerations = [terms.acceleration(push)[0] for terms in (one, other)]
        assert apart(*accelerations) < 1e-12 * condition(other.space)


def test_a_gear_beside_a_closed_loop_counts_as_any_other_row():
    sim = simulator(geared(links=4))
    state = sim.initial_state()
    found = redundancy(sim.mechanism, state.q, state.active)
    assert (found.rank, found.mobility) == (1, 3)
    twice = geared(links=4)
    twice["couplings"] = [twice["couplings"][0], {**twice["couplings"][0], "name": "again"}]
    sim = simulator(twice)
    found = redundancy(sim.mechanism, sim.initial_state().q, (True, True))
    assert (found.rank, found.redundant) == (1, ("again/gear",))


def test_baumgarte_pulls_it_as_it_pulls_closures():
    document = geared()
    document["simulation"] = {"stabilisation": "baumgarte", "baumgarte_rate": 50.0}
    found = [run(simulator(document, kind), 0.3)[-1] for kind in (Simulator, ReadableSimulator)]
    assert np.abs(found[0].q - found[1].q).max() < 1e-10
    assert abs(found[0].q[1] - RATIO * found[0].q[0] - OFFSET) < 1e-6


def test_a_switched_off_gear_lets_go():
    sim = simulator(geared())
    state = sim.switch(sim.initial_state(), {"gear": False})
    state = sim.run(state, 100).end
    assert abs(state.q[1] - RATIO * state.q[0] - OFFSET) > 1e-3


@pytest.mark.parametrize(
    ("changes", "rule"),
    [
        ({"joint": "nobody"}, "unknown joint"),
        ({"leader": "nobody"}, "unknown joint"),
        ({"ratio": float("nan")}, "finite"),
        ({"sign": 1.0}, "unknown key"),
    ],
)
def test_what_cannot_be_coupled_is_refused(changes, rule):
    with pytest.raises(SceneError, match=rule):
        scene_from_document(geared(**changes))


def test_a_joint_is_not_coupled_with_itself_or_where_it_cannot_move():
    document = geared()
    document["couplings"][0]["leader"] = document["couplings"][0]["joint"]
    with pytest.raises(SceneError, match="must be another joint"):
        scene_from_document(document)
    document = geared()
    document["links"][1]["joint"]["locked"] = True
    with pytest.raises(SceneError, match="not locked can be coupled"):
        scene_from_document(document)
