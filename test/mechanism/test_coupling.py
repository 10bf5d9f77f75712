# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Couplings: joints that keep a ratio, as gears and mimic joints do, or a curve, as cams do."""

import numpy as np
import pytest

from hapticmech_ros.errors import SceneError
from hapticmech_ros.mechanism.redundancy import redundancy
from hapticmech_ros.scene import scene_from_document
from oracles.factorisation import factored_as_dense
from oracles.planar_linkages import INERTIAS, LENGTHS, MASSES, chain
from oracles.posed import Posed
from oracles.running import run, simulator, unaccounted

RATIO, OFFSET = -2.5, 0.3
CURVE = [0.02, 0.1, -0.06, 0.04, 0.015]


def geared(links=2, gravity_y=-9.81, sliding=False, **changes):
    """Return a chain whose second joint is geared to its first."""
    document = chain(LENGTHS[:links], MASSES[:links], INERTIAS[:links], gravity_y)
    if sliding:
        document["links"][1]["joint"] |= {"type": "prismatic", "axis": [1.0, 0.0, 0.0]}
    names = [link["joint"]["name"] for link in document["links"]]
    coupling = {"name": "gear", "joint": names[1], "leader": names[0]}
    document["couplings"] = [coupling | {"ratio": RATIO, "offset": OFFSET} | changes]
    return document


def cam(links=2, sliding=True, **changes):
    """Return the chain with the second joint on a curve of degree 4."""
    document = geared(links, sliding=sliding)
    (gear,) = document["couplings"]
    kept = {key: value for key, value in gear.items() if key not in ("ratio", "offset")}
    document["couplings"] = [kept | {"polycoef": CURVE} | changes]
    return document


@pytest.mark.parametrize("sliding", [False, True])
def test_joints_keep_their_ratio_and_energy_stays(sliding):
    sim = simulator(geared(sliding=sliding))
    states = run(sim, 0.5)
    assert max(abs(s.q[1] - RATIO * s.q[0] - OFFSET) for s in states) < 1e-13
    assert max(abs(s.v[1] - RATIO * s.v[0]) for s in states) < 1e-12
    # What rk4 leaves: these bars of 45 mm swing at 15 rad/s.
    fastest = max(sim.mechanism.energy(s.q, s.v)[0] for s in states)
    assert np.abs(unaccounted(sim, states)).max() < 1e-7 * fastest
    assert np.ptp([s.q[0] for s in states]) > 0.03


def test_it_moves_as_one_joint_with_the_inertia_of_both():
    """With θ₂ = r θ₁ + c, [1 r] D [1 r]ᵀ θ̈₁ = [1 r] τ where nothing moves yet."""
    sim = simulator(geared())
    state = sim.initial_state()
    terms = sim.evaluate(state)
    along = np.array((1.0, RATIO))
    expected = along @ -terms.bias_force / (along @ terms.inertia @ along)
    found, force = terms.acceleration(np.zeros(2))
    assert found == pytest.approx(along * expected, rel=1e-12)
    residual = terms.inertia @ found + terms.bias_force + terms.closure_jacobian.T @ force
    assert np.abs(residual).max() < 1e-12 * np.abs(terms.bias_force).max()


def test_a_gear_is_one_row_of_its_ratio():
    sim = simulator(geared(links=4))
    state, generator = sim.initial_state(), np.random.default_rng(5)
    for _ in range(20):
        at = Posed(sim.mechanism, state.q + generator.normal(size=4), generator.normal(size=4))
        terms = at.evaluate(state.active)
        assert np.array_equal(terms.closure_jacobian, [[-RATIO, 1.0, 0.0, 0.0]])
        expected = at.q[1] - RATIO * at.q[0] - OFFSET
        assert terms.closure_residual == pytest.approx([expected], abs=1e-14)
        assert np.array_equal(terms.closure_bias, np.zeros(1))
        factored_as_dense(at, state.active)


@pytest.mark.parametrize("sliding", [False, True])
def test_a_curve_has_the_terms_of_its_derivatives(sliding):
    """W, Ẇv by hand; v̇ as one joint with the inertia along the curve."""
    document = cam(sliding=sliding)
    ours = simulator(document)
    p, generator = np.polynomial.Polynomial(CURVE), np.random.default_rng(8)
    active = ours.initial_state().active
    for _ in range(20):
        lead, rate = generator.normal(size=2)
        along = np.array((1.0, p.deriv()(lead)))
        q, v = np.array((lead, p(lead))), along * rate
        one = ours.mechanism.evaluate(q, v, active)
        turned = np.array((0.0, p.deriv(2)(lead) * rate**2))
        assert np.abs(one.closure_residual).max() < 1e-15
        assert np.abs(one.closure_jacobian - (-along[1], 1.0)).max() < 1e-14
        assert one.closure_bias == pytest.approx([-turned[1]], rel=1e-13)
        left = -one.bias_force - one.inertia @ turned
        expected = along * (along @ left / (along @ one.inertia @ along)) + turned
        found, _ = one.acceleration(np.zeros(2))
        assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()


def test_on_a_curve_energy_stays_for_seconds():
    sim = simulator(cam(), substeps=8)
    states = run(sim, 4.0)
    p = np.polynomial.Polynomial(CURVE)
    assert max(abs(s.q[1] - p(s.q[0])) for s in states) < 1e-12
    assert max(abs(s.v[1] - p.deriv()(s.q[0]) * s.v[0]) for s in states) < 1e-11
    fastest = max(sim.mechanism.energy(s.q, s.v)[0] for s in states)
    assert np.abs(unaccounted(sim, states)).max() < 1e-9 * fastest
    assert np.ptp([p.deriv()(s.q[0]) for s in states]) > 0.05


def test_a_straight_curve_is_a_gear():
    q = np.array((0.4, 0.7, -0.2, 0.1))
    straight = [OFFSET, RATIO, 0.0, 0.0, 0.0]
    documents = geared(links=4), cam(4, sliding=False, polycoef=straight)
    gear, curve = (simulator(one).mechanism for one in documents)
    one, other = (m.evaluate(q, np.ones(4), (True,)) for m in (gear, curve))
    assert np.array_equal(one.closure_jacobian, other.closure_jacobian)
    assert np.array_equal(one.closure_residual, other.closure_residual)


def test_baumgarte_pulls_it_onto_the_curve():
    pulled = simulator(cam(), stabilisation="baumgarte", baumgarte_rate=50.0)
    end = run(pulled, 0.3)[-1]
    p = np.polynomial.Polynomial(CURVE)
    assert abs(end.q[1] - p(end.q[0])) < 1e-6


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
        ({"leader": "joint2"}, "must be another joint"),
        ({"ratio": float("nan")}, "finite"),
        ({"sign": 1.0}, "unknown key"),
        ({"polycoef": CURVE}, r"ratio.*write it as polycoef\[1\]"),
        ({"polycoef": CURVE[:4]}, r"polycoef\[4\]"),
    ],
)
def test_what_cannot_be_coupled_is_refused(changes, rule):
    with pytest.raises(SceneError, match=rule):
        scene_from_document(geared(**changes))


def test_a_locked_joint_is_not_coupled():
    document = geared()
    document["links"][1]["joint"]["locked"] = True
    with pytest.raises(SceneError, match="not locked can be coupled"):
        scene_from_document(document)
