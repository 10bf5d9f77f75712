# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps by kernels against steps in plain NumPy: same states, same energies, same errors."""

from itertools import product
from typing import ClassVar

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros import load_scene
from hapticmech_ros.errors import ClosureError, InvalidInputError
from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.mechanism.inertia import SingularInertiaError
from hapticmech_ros.mechanism.motion import ExternalWrenches, Plan, Start, plan_of
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.mechanism.stepping import Stepper
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.simulation import Simulator
from oracles.generator import closed_chain, random_mechanism
from oracles.implementations import apart, condition
from oracles.mechanism.integrators import INTEGRATORS
from oracles.mechanism.stepping import ReadableSimulator, ReadableStepper
from oracles.planar_linkages import (
    INERTIAS,
    LENGTHS,
    MASSES,
    chain,
    five_bar,
    five_bar_bent,
    pin_end,
)
from oracles.running import run, simulator, with_start
from sampling import sampled

# Sums of some ten products in another order; what closures carry is magnified by σ₁/σ_r.
ROUNDING = 1e-12
PERIOD = 1e-3
KINDS = ("spherical", "revolute", "weld", "planar_pin")
RULES = sorted(INTEGRATORS)
SHIPPED = [(name, rule) for name in shipped_scenes() for rule in sampled(RULES, of=name, every=3)]


def documents():
    for planar, odd in product((False, True), repeat=2):
        for seed in sampled(range(odd, 8, 2), (planar, odd)):
            yield random_mechanism(seed, planar, duplicated=odd)
    for index, kind in enumerate(KINDS):
        yield from (closed_chain(seed, kind) for seed in sampled(range(index, 8, 4), kind))


FIVE_BAR = with_start(five_bar(), five_bar_bent(1.9, 0.9), np.array([0.9, -1.0, 1.0, 0.5]))
DOCUMENTS = [FIVE_BAR, *(with_start(s.document, s.q, 0.3 * s.v) for s in documents())]


def both(document, integrator):
    """Return both simulators of a document."""
    # Not watched: the account of a rule that damps is another one then, see test_stiff.
    step = {"period": PERIOD, "integrator": integrator, "accuracy": {"tolerance": 0}}
    scene = scene_from_document(document | {"simulation": step})
    return ReadableSimulator(scene), Simulator(scene)


def push(sim, seed=0):
    rng = np.random.default_rng(seed)
    size = np.array([0.5, 0.5, 0.5, 0.05, 0.05, 0.05])
    return rng.normal(size=(len(sim.mechanism.point_names), 6)) * size


def start_of(state, terms=None, closing=None):
    return Start(state.q, state.v, state.active, terms, closing)


def compare(one, other, magnified):
    assert apart(other.q, one.q, 1.0) < magnified
    # A step's change of the rates is about as large as the rates.
    assert apart(other.v, one.v, 1.0) < magnified
    assert abs(other.work_in - one.work_in) < magnified
    assert abs(other.energy_lost - one.energy_lost) < magnified
    # Both stop next to rounding, where what is left is chance.
    assert max(one.error, other.error) < 1e-11


def test_the_documents_hold_what_is_promised():
    simulators = [both(document, "rk4")[0] for document in DOCUMENTS]
    assert {c.kind for sim in simulators for c in sim.mechanism.closures} == set(KINDS)
    flat = [sim.mechanism.nq == sim.mechanism.nv for sim in simulators]
    assert any(flat)
    assert not all(flat)
    assert any(not load_scene(name).closures for name in shipped_scenes())


@pytest.mark.parametrize("integrator", RULES)
@pytest.mark.parametrize("document", DOCUMENTS)
def test_steps_are_the_same(document, integrator):
    readable, found = both(document, integrator)
    state = readable.initial_state()
    links = {document["links"][-1]["name"]: push(readable, 1)[0]}
    terms = readable.evaluate(state)
    magnified = ROUNDING * condition(terms.space)
    for pushed in ({}, links):
        one, other = (
            sim.stepper.advance(start_of(state), ExternalWrenches(push(sim), pushed))
            for sim in (readable, found)
        )
        compare(one, other, magnified)
    assert np.abs(one.v - state.v).max() > 1e-6
    assert abs(one.work_in) > 0.0


@pytest.mark.parametrize(("name", "integrator"), SHIPPED)
def test_steps_of_shipped_scenes_are_the_same(name, integrator):
    """Of the mechanism alone: contacts are another stepper's, and do not go with every rule."""
    scene = load_scene(name)
    simulation = scene.simulation.model_copy(update={"integrator": integrator})
    scene = scene.model_copy(update={"simulation": simulation, "contacts": ()})
    readable, found = (ReadableSimulator(scene), Simulator(scene))
    plan = Plan(integrator, PERIOD)
    one = ReadableStepper(readable.mechanism, plan)
    other = Stepper(found.mechanism, plan)
    for state in run(readable, 0.02, push(readable))[::5]:
        magnified = ROUNDING * condition(readable.evaluate(state).space)
        wrenches = push(readable, 2)
        found = [
            stepper.advance(start_of(state), ExternalWrenches(wrenches)) for stepper in (one, other)
        ]
        compare(*found, magnified)


@pytest.mark.parametrize("document", DOCUMENTS)
def test_what_is_known_changes_no_bit(document):
    _, sim = both(document, "rk4")
    state = sim.initial_state()
    mechanism, wrenches = sim.mechanism, push(sim)
    stepper = Stepper(mechanism, plan_of(sim.scene.simulation))
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
    _, sim = both(document, "rk4")
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
        _, sim = both(document, "rk2")
        state = sim.initial_state()
        stepped = sim.stepper.advance(start_of(state), ExternalWrenches(push(sim)))
        anew = sim.mechanism.closing_terms(stepped.q, state.active)
        assert stepped.closing.error == anew.error == stepped.error
        assert stepped.closing.jacobian.tobytes() == anew.jacobian.tobytes()
        assert stepped.closing.space.factor.tobytes() == anew.space.factor.tobytes()


def test_steps_leave_earlier_ones_alone():
    _, sim = both(DOCUMENTS[0], "rk4")
    first = sim.initial_state()
    one = sim.stepper.advance(start_of(first), ExternalWrenches(push(sim)))
    held = one.q.tobytes(), one.v.tobytes(), one.closing.packed.tobytes()
    sim.stepper.advance(start_of(first), ExternalWrenches(push(sim, 3)))
    assert (one.q.tobytes(), one.v.tobytes(), one.closing.packed.tobytes()) == held


class TestVectors:
    """Where q and v are as long as each other, ⊕ is a sum, to the bit."""

    JOINTS: ClassVar = {
        "turning": lambda: pin.JointModelRevoluteUnaligned(np.array([0.6, 0.0, 0.8])),
        "sliding": lambda: pin.JointModelPrismaticUnaligned(np.array([0.0, 0.6, 0.8])),
    }

    def test_integration_is_a_sum(self):
        rng = np.random.default_rng(0)
        for kind in self.JOINTS.values():
            model = pin.Model()
            for joint in range(5):
                model.addJoint(joint, kind(), pin.SE3.Random(), f"joint{joint}")
            for _ in range(200):
                q, change = rng.normal(size=(2, 5)) * 10.0 ** rng.integers(-8, 4)
                assert pin.integrate(model, q, change).tobytes() == (q + change).tobytes()


@pytest.mark.parametrize("kind", [Simulator, ReadableSimulator])
class TestErrors:
    """Both say the same of what cannot be stepped."""

    def start(self, kind, integrator="rk4"):
        sim = both(FIVE_BAR, integrator)[kind is Simulator]
        return sim, sim.initial_state(), np.zeros((len(sim.mechanism.point_names), 6))

    @pytest.mark.parametrize(
        ("integrator", "what"),
        [("rk4", "rates"), ("rk2", "rates"), ("semi_implicit_euler", "state")],
    )
    @pytest.mark.parametrize("bad", [np.nan, np.inf])
    @pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
    def test_what_is_not_finite_is_refused(self, kind, integrator, what, bad):
        sim, state, wrenches = self.start(kind, integrator=integrator)
        wrenches[0, 0] = bad
        with pytest.raises(InvalidInputError, match=f"mechanism {what}: must stay finite"):
            sim.step(state, wrenches)

    def test_wrenches_of_another_shape_are_refused(self, kind):
        sim, state, wrenches = self.start(kind)
        with pytest.raises(InvalidInputError, match="wrenches: must have shape"):
            sim.step(state, wrenches[0])

    def test_an_unknown_link_is_refused(self, kind):
        sim, state, wrenches = self.start(kind)
        with pytest.raises(InvalidInputError, match="nothing"):
            sim.step(state, wrenches, {"nothing": np.zeros(6)})

    def test_a_loop_that_comes_apart_is_named(self, kind):
        document = pin_end(chain(LENGTHS, MASSES, INERTIAS), np.array([0.25, 0.0]))
        scene = scene_from_document(document | {"simulation": {"period": PERIOD}})
        stepper = kind(scene).stepper
        start = Start(np.array([0.3, 0.2, 0.1, -0.1]), np.zeros(4), (True,))
        with pytest.raises(ClosureError, match="came apart") as caught:
            stepper.advance(start, ExternalWrenches(np.zeros((len(scene.operational_points), 6))))
        assert caught.value.closures == ("pin",)

    def test_a_massless_end_link_is_singular(self, kind):
        document = chain(LENGTHS, MASSES, INERTIAS)
        nothing = {"mass": 0.0, "inertia": {"ixx": 0.0, "iyy": 0.0, "izz": 0.0}}
        document["links"][-1]["inertial"] = nothing
        document["operational_points"] = document["operational_points"][:2]
        scene = scene_from_document(document)
        with pytest.raises(SingularInertiaError, match="joint4"):
            kind(scene)


def test_wrenches_of_another_shape_are_refused():
    sim = simulator(FIVE_BAR)
    state = sim.initial_state()
    points = len(sim.mechanism.point_names)
    for shape in ((points + 1, 6), (points, 3), (6,)):
        with pytest.raises(InvalidInputError, match="wrenches"):
            sim.step(state, np.zeros(shape))


def test_every_rule_is_there_twice():
    assert set(SCHEMES) == set(INTEGRATORS)
    for scheme in SCHEMES.values():
        assert len(scheme.fractions) == len(scheme.weights) - 1
        assert abs(sum(scheme.weights) - 1.0) < 1e-15
