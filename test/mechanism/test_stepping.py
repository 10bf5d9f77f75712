# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps: what is known changes no bit, what was pushed is forgotten, errors are named."""

from itertools import product

import numpy as np
import pytest

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.motion import ExternalWrenches, Start
from hapticmech_ros.mechanism.stepping import Stepper
from oracles.generator import closed_chain, random_mechanism
from oracles.planar_linkages import (
    five_bar,
    five_bar_bent,
)
from oracles.running import simulator, with_start, wrenches_on
from sampling import sampled

KINDS = ("spherical", "revolute", "weld", "planar_pin")


def documents():
    for planar, odd in product((False, True), repeat=2):
        for seed in sampled(range(odd, 8, 2), (planar, odd)):
            yield random_mechanism(seed, planar, duplicated=odd)
    for index, kind in enumerate(KINDS):
        yield from (closed_chain(seed, kind) for seed in sampled(range(index, 8, 4), kind))


FIVE_BAR = with_start(five_bar(), five_bar_bent(1.9, 0.9), np.array([0.9, -1.0, 1.0, 0.5]))
DOCUMENTS = [FIVE_BAR, *(with_start(s.document, s.q, 0.3 * s.v) for s in documents())]


def stepping(document, integrator):
    return simulator(document, integrator=integrator, accuracy={"tolerance": 0})


def push(sim, seed=0):
    rng = np.random.default_rng(seed)
    size = np.array([0.5, 0.5, 0.5, 0.05, 0.05, 0.05])
    return rng.normal(size=(len(sim.mechanism.point_names), 6)) * size


def start_of(state, terms=None, closing=None):
    return Start(state.q, state.v, state.active, terms, closing)


@pytest.mark.parametrize("document", DOCUMENTS)
def test_what_is_known_changes_no_bit(document):
    sim = stepping(document, "rk4")
    state = sim.initial_state()
    mechanism, wrenches = sim.mechanism, push(sim)
    stepper = Stepper(mechanism)
    closing = mechanism.closing_terms(state.q, state.active)
    terms = mechanism.evaluate(state.q, state.v, state.active)
    mechanism.evaluate(mechanism.integrate(state.q, state.v), state.v, state.active)  # scratch
    starts = [start_of(state), start_of(state, closing=closing), start_of(state, terms, closing)]
    bits = set()
    for start in starts:
        q, v, error, _, *energies = stepper.advance(start, ExternalWrenches(wrenches))
        bits.add((q.tobytes(), v.tobytes(), error, *energies))
    assert len(bits) == 1


def test_wrenches_on_links_are_forgotten():
    document = DOCUMENTS[0]
    link = document["links"][-1]["name"]
    sim = stepping(document, "rk4")
    start, wrenches = start_of(sim.initial_state()), push(sim)
    before, pushed, after = (
        sim.stepper.advance(start, ExternalWrenches(wrenches, links))
        for links in ({}, {link: np.ones(6)}, {})
    )
    assert after.v.tobytes() == before.v.tobytes()
    assert pushed.v.tobytes() != before.v.tobytes()
    links = {link: np.ones(6), "nothing": np.ones(6)}
    with pytest.raises(InvalidInputError, match="nothing"):
        sim.stepper.advance(start, ExternalWrenches(wrenches, links))
    assert sim.stepper.advance(start, ExternalWrenches(wrenches)).v.tobytes() == before.v.tobytes()


def test_a_closing_of_the_step_is_that_of_its_state():
    for document in DOCUMENTS[::5]:
        sim = stepping(document, "rk2")
        state = sim.initial_state()
        stepped = sim.stepper.advance(start_of(state), ExternalWrenches(push(sim)))
        anew = sim.mechanism.closing_terms(stepped.q, state.active)
        assert stepped.closing.error == anew.error == stepped.error
        assert stepped.closing.jacobian.tobytes() == anew.jacobian.tobytes()
        assert stepped.closing.space.factor.tobytes() == anew.space.factor.tobytes()


def test_steps_leave_earlier_ones_alone():
    sim = stepping(DOCUMENTS[0], "rk4")
    first = sim.initial_state()
    one = sim.stepper.advance(start_of(first), ExternalWrenches(push(sim)))
    held = one.q.tobytes(), one.v.tobytes(), one.closing.packed.tobytes()
    sim.stepper.advance(start_of(first), ExternalWrenches(push(sim, 3)))
    assert (one.q.tobytes(), one.v.tobytes(), one.closing.packed.tobytes()) == held


class TestErrors:
    """What cannot be stepped is told."""

    def start(self, integrator="rk4"):
        sim = stepping(FIVE_BAR, integrator)
        return sim, sim.initial_state(), wrenches_on(sim)

    @pytest.mark.parametrize(
        ("integrator", "what"),
        [("rk4", "rates"), ("rk2", "rates"), ("semi_implicit_euler", "state")],
    )
    @pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
    @pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
    def test_what_is_not_finite_is_refused(self, integrator, what, bad):
        sim, state, wrenches = self.start(integrator)
        wrenches[0, 0] = bad
        with pytest.raises(InvalidInputError, match=f"mechanism {what}: must stay finite"):
            sim.step(state, wrenches)

    def test_wrenches_of_another_shape_are_refused(self):
        sim, state, wrenches = self.start()
        points = len(wrenches)
        for shape in ((points + 1, 6), (points, 3), (6,)):
            with pytest.raises(InvalidInputError, match="wrenches: must have shape"):
                sim.step(state, np.zeros(shape))
