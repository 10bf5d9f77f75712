# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A period in equal parts, and steps that end where no step should: jumps and turned axes."""

import numpy as np
import pytest

from hapticmech_ros.errors import ClosureError, InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.motion import Start
from hapticmech_ros.mechanism.projection import project
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.scene import scene_from_document
from oracles.generator import closed_chain, random_mechanism
from oracles.planar_linkages import bar, five_bar, five_bar_bent
from oracles.running import simulator, unpushed, with_start, wrenches_on

FIVE_BAR = with_start(
    five_bar(-9.81, 0.002), five_bar_bent(1.9, 0.9), np.array([0.9, -1.0, 1.0, 0.5])
)
SAMPLES = [random_mechanism(1, duplicated=True), closed_chain(1, "revolute")]
DOCUMENTS = [FIVE_BAR, *(with_start(s.document, s.q, 0.3 * s.v) for s in SAMPLES)]


# Steps that are done again in smaller ones are not those of the rule.
UNWATCHED = {"accuracy": {"tolerance": 0.0}}


@pytest.mark.parametrize("integrator", sorted(SCHEMES))
@pytest.mark.parametrize("document", DOCUMENTS)
def test_substeps_are_steps(document, integrator):
    """Four substeps of 2 ms are four steps of 0.5 ms, to the bit; energies to rounding."""
    split = simulator(document, period=2e-3, substeps=4, integrator=integrator)
    short = simulator(document, period=5e-4, integrator=integrator)
    rng = np.random.default_rng(0)
    wrenches = 0.3 * rng.normal(size=(len(split.mechanism.point_names), 6))
    links = {document["links"][-1]["name"]: wrenches[0]}
    state = one = split.initial_state()
    for _ in range(3):
        one = split.step(one, wrenches, links)
        for _ in range(4):
            state = short.step(state, wrenches, links)
    assert one.q.tobytes() == state.q.tobytes()
    assert one.v.tobytes() == state.v.tobytes()
    assert one.closure_error == state.closure_error
    assert one.time == pytest.approx(6e-3, rel=1e-12)
    assert one.account.work_in == pytest.approx(state.account.work_in, rel=1e-12)
    assert one.account.damping_loss == pytest.approx(state.account.damping_loss, rel=1e-12)


@pytest.mark.parametrize(("speed", "any_refused"), [(5.0, False), (40.0, True)])
def test_steps_far_off_the_closures_are_refused(speed, any_refused):
    """A quarter of a radian in one step is coarse, two are too many: any assembly could come."""
    rng, refused = np.random.default_rng(0), 0
    for _ in range(40):
        q = five_bar_bent(rng.uniform(1.0, 2.6), rng.uniform(-0.3, 1.2))
        document = with_start(five_bar(), q)
        sim = simulator(document, period=0.05, integrator="semi_implicit_euler", **UNWATCHED)
        state = sim.initial_state()
        v = sim.mechanism.closing_terms(q, (True,)).space.closed_rates(rng.normal(size=4))
        start = Start(state.q, speed / np.linalg.norm(v) * v, (True,))
        try:
            assert sim.stepper.advance(start, unpushed(sim)).error < 1e-12
        except ClosureError as error:
            refused += "jumped" in str(error)
    assert (refused > 0) == any_refused


def test_putting_right_more_than_half_the_step_is_a_jump():
    mechanism = Mechanism(scene_from_document(FIVE_BAR))
    q = five_bar_bent(1.9, 0.9)
    space = mechanism.closing_terms(q, (True,)).space
    off = space.correction(np.array([1e-3, 0.0]))
    long, short = 3.0 * off, 1.5 * off
    zeros = np.zeros(4)
    assert project(mechanism, q + off, zeros, (True,), long).error < 1e-14
    with pytest.raises(ClosureError, match="jumped") as caught:
        project(mechanism, q + off, zeros, (True,), short)
    assert caught.value.closures == ("pin",)
    # What is next to rounding is no jump, however short the step, nor is what nobody stepped to.
    assert project(mechanism, q + 1e-6 * off, zeros, (True,), 1e-9 * off).error < 1e-14
    assert project(mechanism, q + off, zeros, (True,)).error < 1e-14


def hinge():
    """Return a bar on a ball joint whose end is held by a hinge; only its spin is free."""
    document = bar() | {"task_space": "spatial"}
    document["links"][0]["joint"] |= {"type": "spherical"}
    document["operational_points"] = document["operational_points"][:1]
    document["closures"] = [
        {
            "name": "hinge",
            "kind": "revolute",
            "a": {"link": "link1", "origin": {"rpy": [0.0, np.pi / 2, 0.0]}},
            "b": {"link": "world", "origin": {"rpy": [0.0, np.pi / 2, 0.0]}},
        }
    ]
    return document


@pytest.mark.parametrize("stabilisation", ["projection", "baumgarte"])
def test_axes_the_other_way_are_refused(stabilisation):
    """Half a turn about y: φ = 0 again, with the hinge's axes opposed."""
    sim = simulator(hinge(), period=1e-3, stabilisation=stabilisation)
    turned = Start(np.array([0.0, 1.0, 0.0, 0.0]), np.zeros(3), (True,))
    with pytest.raises(ClosureError, match="other branch") as caught:
        sim.stepper.advance(turned, unpushed(sim))
    assert caught.value.closures == ("hinge",)
    state = sim.initial_state()
    assert sim.step(state, np.zeros((1, 6))).closure_error < 1e-12


class TestJointForces:
    @pytest.mark.parametrize("integrator", sorted(SCHEMES))
    def test_they_act_as_efforts_do(self, integrator):
        efforts = np.array([0.1, -0.2, 0.05, 0.02])
        driven = FIVE_BAR | {
            "links": [
                link | {"joint": link["joint"] | {"effort": float(effort)}}
                for link, effort in zip(FIVE_BAR["links"], efforts, strict=True)
            ]
        }
        ends = []
        for document, forces in ((FIVE_BAR, efforts), (driven, None), (FIVE_BAR, None)):
            sim = simulator(document, period=1e-3, integrator=integrator)
            state = sim.initial_state()
            for _ in range(5):
                state = sim.step(state, wrenches_on(sim), joint_forces=forces)
            ends.append(state)
        assert np.abs(ends[0].v - ends[1].v).max() < 1e-12
        assert ends[0].account.work_in == pytest.approx(ends[1].account.work_in, rel=1e-9)
        assert np.abs(ends[0].v - ends[2].v).max() > 1e-2

    def test_they_are_forgotten(self):
        sim = simulator(FIVE_BAR, period=1e-3)
        state = sim.initial_state()
        before = sim.step(state, wrenches_on(sim))
        sim.step(state, wrenches_on(sim), joint_forces=np.ones(4))
        assert sim.step(state, wrenches_on(sim)).v.tobytes() == before.v.tobytes()

    @pytest.mark.parametrize("forces", [np.ones(3), np.ones((4, 1)), [0.0, np.nan, 0.0, 0.0]])
    def test_wrong_ones_are_refused(self, forces):
        sim = simulator(FIVE_BAR, period=1e-3)
        with pytest.raises(InvalidInputError, match="joint_forces"):
            sim.step(sim.initial_state(), wrenches_on(sim), joint_forces=np.array(forces))
