# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""X and a_0 for a late loop: what the mechanism will do by then, and never more than X."""

import copy

import numpy as np
import pytest

from hapticmech_ros import load_scene
from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.mechanism.projection import project
from hapticmech_ros.numerics.layout import OperationalModelSample
from hapticmech_ros.operational import Analyser
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.simulation import Simulator
from oracles.generator import closed_chain, random_mechanism
from oracles.posed import apart, condition, posed, posed_sample
from oracles.running import with_joints, with_start
from oracles.slopes import tangents
from sampling import sampled

# As in test_observation: sums in another order, and what conditions take.
ROUNDING = 1e-12
COMPENSATED_DELAY = 0.0025


def resisting(seed, planar):
    """Return a sample with springs, friction and dampers wherever they can be."""
    base = random_mechanism(seed, planar, duplicated=seed % 3 == 0)
    document = with_joints(base.document, stiffness=3.0, friction=1.0, damping=0.4)
    ends = {"a": {"link": "link4"}, "b": {"link": "world"}}
    document["springs"] = [{"name": "s", "stiffness": 5.0, "damping": 1.0} | ends]
    return posed(scene_from_document(with_start(document, base.q, base.v)))


def pairs():
    for name in shipped_scenes():
        yield from (posed(load_scene(name), k, 0.2 * k) for k in sampled(range(3), name))
    for seed in sampled(range(8), every=2):
        yield resisting(seed, seed % 2 == 0)
        yield posed_sample(closed_chain(seed, ("spherical", "revolute", "weld")[seed % 3]))


def rates(pair, active):
    """Return rates that keep the loops closed: only then is it known where they will be."""
    return pair.evaluate(active).space.closed_rates(pair.v)


def compensated(pair, active, compensated_delay=COMPENSATED_DELAY, v=None, before=None):
    """Return terms, analysis and late answer at a state, of rates that keep the loops closed."""
    v = rates(pair, active) if v is None else v
    analyser = Analyser(pair.mechanism, "", compensated_delay)
    terms = pair.mechanism.evaluate(pair.q, v, active)
    found = analyser.analyse(terms)
    return terms, found, analyser.compensated(terms, before)


def earlier(pair, active, ago):
    """Return rates that were, and how long ago, s."""
    rng = np.random.default_rng(1)
    return np.concatenate(((ago,), rates(pair, active) + 0.1 * rng.normal(size=pair.v.size)))


@pytest.mark.parametrize("pair", list(pairs()))
def test_in_one_go_or_not_is_the_same_to_the_bit(pair):
    for active in pair.sets:
        analyser = Analyser(pair.mechanism, "", COMPENSATED_DELAY)
        before = earlier(pair, active, 2e-3)
        _, _, answer = compensated(pair, active, before=before)
        seen = analyser.observe(pair.q, rates(pair, active), active, before=before).model
        inverse_inertia = seen[OperationalModelSample.layout.slice("inverse_inertia")].reshape(6, 6)
        assert (inverse_inertia == answer.inverse_inertia).all()
        free = seen[OperationalModelSample.layout.slice("free_acceleration")]
        assert (free == answer.free_acceleration).all()


@pytest.mark.parametrize("pair", list(pairs()))
def test_no_gain_is_larger_than_that_of_a_loop_in_time(pair):
    """X - X_τ and X_τ are positive semi-definite, and X_τ falls as τ grows."""
    before = None
    for compensated_delay in (0.0, 1e-3, 1e-2, 1e-1):
        terms, found, answer = compensated(pair, pair.mechanism.initially_active, compensated_delay)
        size = np.abs(found.inverse_inertia).max()
        bound = ROUNDING * condition(terms.space) * size
        assert np.linalg.eigvalsh(answer.inverse_inertia)[0] > -bound
        if before is not None:
            assert np.linalg.eigvalsh(before - answer.inverse_inertia)[0] > -bound
        before = answer.inverse_inertia


@pytest.mark.parametrize("name", ["two_link", "ur5e"])
def test_as_many_joints_as_ways_make_it_the_inertia_with_dampers_on(name):
    """X_τ is then J (D + τ C)⁻¹ Jᵀ to the last digit, not only to first order."""
    pair = posed(load_scene(name))
    terms, found, answer = compensated(pair, (), compensated_delay=0.01)
    _, damping = tangents(pair.mechanism, pair.q, pair.v)
    jacobian = terms.points[0].jacobian
    expected = jacobian @ np.linalg.solve(terms.inertia + 0.01 * damping, jacobian.T)
    rows = np.ix_(found.rows, found.rows)
    bound = ROUNDING * condition(terms.space)
    assert apart(answer.inverse_inertia[rows], expected[rows]) < bound
    assert apart(found.inverse_inertia[rows], expected[rows]) > 0.01


def resting(name):
    """Return a scene at rest as it starts: with springs in its joints where it has no weight."""
    document = load_scene(name).model_dump(mode="json", exclude_none=True)
    # Ten steps in the shortest time that is looked at.
    document["simulation"] |= {"period": 5e-5, "integrator": "rk4"}
    if not any(document["gravity"]):
        start = document["initial_state"]["q"]
        for link in document["links"]:
            joint = link["joint"]
            if joint["name"] in start:
                joint |= {"stiffness": 0.5, "rest": start[joint["name"]]}
    return scene_from_document(document)


# The step from which on answers are for accelerations so many steps later.
FIRST, LATER = 400, (10, 20, 40)


class Pushed:
    """A scene at rest as it starts, and moving by so little that nothing bends.

    Args:
        name: of the scene.
        size: of the wrench, N; its direction is drawn at random.
        growth: what it is multiplied by at a time, s.
    """

    def __init__(self, name, size, growth):
        self.simulator = Simulator(resting(name))
        self.rows, self.period = Analyser(self.simulator.mechanism).rows, self.simulator.period
        drawn = size * np.random.default_rng(0).normal(size=6) * np.repeat((1.0, 0.05), 3)
        self.direction = np.where(np.isin(np.arange(6), self.rows), drawn, 0.0)
        self.growth, self.states = growth, [self.simulator.initial_state()]
        held = np.zeros((len(self.simulator.mechanism.point_names), 6))
        for number in range(FIRST + LATER[-1] + 1):
            # Held over a period: of its middle.
            held[0] = self.direction * growth((number + 0.5) * self.period)
            self.states.append(self.simulator.step(self.states[-1], held))

    def error(self, count, back=0):
        """Return by what share X_τ F(τ) + a_τ differs from V̇ after τ, so many periods later.

        ``back``: how many periods ago the rates are that it is told; none if 0.
        """
        later = [self.states[FIRST + count + side] for side in (1, -1)]
        ahead, behind = (self.simulator.evaluate(state).points[0].twist for state in later)
        then = (ahead - behind) / (2.0 * self.period)
        analyser = Analyser(self.simulator.mechanism, "", count * self.period)
        terms = self.simulator.evaluate(self.states[FIRST])
        before = np.concatenate(((back * self.period,), self.states[FIRST - back].v))
        answer = analyser.compensated(terms, before if back else None)
        wrench = self.direction * self.growth((FIRST + count) * self.period)
        now = answer.inverse_inertia @ wrench + answer.free_acceleration
        return np.linalg.norm((then - now)[self.rows]) / np.linalg.norm(then[self.rows])


@pytest.mark.parametrize("name", ["two_link", "spatial_arm", "five_bar", "crane", "door"])
def test_the_answer_of_now_is_the_acceleration_of_then(name):
    """Under a wrench that stays: the error is second order in τ."""
    pushed = Pushed(name, 1e-5, lambda time: 1.0)
    errors = [pushed.error(count) for count in LATER]
    assert np.log2(np.divide(errors[1:], errors[:-1])) == pytest.approx(2.0, abs=0.15)
    # At 0.5 ms.
    assert errors[0] < 1e-3


@pytest.mark.parametrize("name", ["two_link", "spatial_arm", "five_bar", "door"])
@pytest.mark.parametrize("ago", [0.5, 1.0, 2.0])
def test_rates_that_were_tell_it_of_a_wrench_that_grows(name, ago):
    """With them the error is of third order in τ, without of second."""
    pushed = Pushed(name, 1e-3, lambda time: time)
    told = [pushed.error(count, round(ago * count)) for count in LATER]
    untold = [pushed.error(count) for count in LATER]
    for errors, order, near in ((told, 3.0, 0.4), (untold, 2.0, 0.15)):
        assert np.log2(errors[2] / errors[1]) == pytest.approx(order, abs=near)
    assert told[-1] < 0.1 * untold[-1]


def test_a_loop_in_time_gets_x_and_a_0_themselves():
    pair = posed(load_scene("spatial_arm"))
    _, found, answer = compensated(pair, (), compensated_delay=0.0)
    assert np.array_equal(answer.inverse_inertia, found.inverse_inertia)
    assert np.array_equal(answer.free_acceleration, found.free_acceleration)


@pytest.mark.parametrize("kind", ["spherical", "revolute", "planar_pin"])
def test_a_loop_without_springs_and_dampers_is_met_where_it_will_be(kind):
    """a_τ is a_0 where the loop will be closed after τ: the error is of third order in τ."""
    sample, errors = closed_chain(1, kind), []
    document = with_start(sample.document, sample.q, sample.v)
    document["links"] = copy.deepcopy(document["links"])
    for link in document["links"]:
        link["joint"]["damping"] = 0.0
        if link["joint"]["type"] in ("revolute", "prismatic"):
            link["joint"]["effort"] = 0.3
    pair = posed(scene_from_document(document))
    active, mechanism = pair.mechanism.initially_active, pair.mechanism
    v = rates(pair, active)
    for delay in (8e-3, 4e-3, 2e-3):
        q = project(mechanism, mechanism.integrate(pair.q, delay * v), v, active).q
        there = mechanism.evaluate(q, v, active)
        point = there.points[0]
        expected = point.jacobian @ there.acceleration(np.zeros(v.size))[0] + point.drift
        found = compensated(pair, active, delay)[2].free_acceleration
        errors.append(np.linalg.norm(found - expected))
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx(3.0, abs=0.3)


def test_where_closures_will_not_be_known_the_state_is_taken_as_it_is():
    """Rates that tear a loop open lead where nothing closes: a_τ is then found at q itself."""
    pair = posed(load_scene("five_bar"))
    active = pair.mechanism.initially_active
    torn = pair.v + np.array([2.0, -1.0, 0.5, 3.0])
    terms, found, answer = compensated(pair, active, v=torn)
    own, _ = terms.acceleration(np.zeros(4))
    _, damping = tangents(pair.mechanism, pair.q, torn)
    space, rows = terms.space, np.ix_(found.rows, found.rows)
    # In as many ways as the loop leaves free, B says it all: (D + τ C) v̇ = -τ C v̇_0.
    free = np.linalg.qr(np.hstack((space.basis, np.eye(4))))[0][:, space.rank : 4]
    way = np.linalg.solve(space.factor.T, free)
    slope = COMPENSATED_DELAY * damping
    change = way @ np.linalg.solve(np.eye(free.shape[1]) + way.T @ slope @ way, way.T @ slope @ own)
    expected = found.free_acceleration - terms.points[0].jacobian @ change
    assert apart(answer.free_acceleration, expected) < 1e-10
    assert apart(answer.inverse_inertia[rows], found.inverse_inertia[rows]) > 1e-3
