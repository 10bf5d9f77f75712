# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The sparse factorisation against the dense one: same rank, same motion, and when it gives up."""

from dataclasses import replace
from itertools import product

import numpy as np
import pinocchio as pin
import pytest

from benchmarks.accuracy.n_four_bar import n_four_bar
from benchmarks.speed.platform import stewart_platform
from hapticmech_ros.loading import load_scene
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.constraint_space import Closing, factored
from hapticmech_ros.mechanism.kernels import layout
from hapticmech_ros.mechanism.kernels.band_kernels import NOT_DECIDED
from hapticmech_ros.mechanism.kernels.factor_kernels import factor
from hapticmech_ros.mechanism.kernels.layout import MANY_RATES
from hapticmech_ros.mechanism.kernels.metric_kernels import accelerate
from hapticmech_ros.mechanism.kernels.model import Data
from hapticmech_ros.numerics.layout import OperationalModelSample
from hapticmech_ros.operational import Analyser
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.simulation import Simulator
from oracles.closed_form import inverse_inertia
from oracles.generator import closed_chain, random_mechanism
from oracles.planar_linkages import chain
from oracles.posed import apart, condition, posed, posed_sample
from sampling import sampled

# As in test_terms.py; articulated inertias about the world's origin lose a digit more.
ROUNDING = 1e-11
KINDS = ("spherical", "revolute", "weld", "planar_pin")


PARTS = [
    OperationalModelSample.layout.slice("s"),
    OperationalModelSample.layout.slice("inverse_inertia"),
    OperationalModelSample.layout.slice("free_acceleration"),
    OperationalModelSample.layout.slice("position", "twist"),
]


def windows(number, kind="planar_pin", turn=0.4):
    """Return A02's mechanism on its closures, moved; by another kind all rows but two repeat."""
    scene = n_four_bar(number)
    closures = tuple(closure.model_copy(update={"kind": kind}) for closure in scene.closures)
    pair = posed(scene.model_copy(update={"closures": closures}))
    return replace(pair, q=pair.mechanism.integrate(pair.q, turn * pair.v))


def long_chain(number):
    turns = np.linspace(0.2, 0.9, number)
    document = chain([0.3] * number, [1.0] * number, [0.01] * number)
    pair = posed(scene_from_document(document))
    return replace(pair, q=turns, v=np.cos(turns))


def walker(*knees):
    """Return a body that stands on legs of three hinges each, one for each knee angle."""
    moments = dict.fromkeys(("ixx", "iyy", "izz"), 0.01)
    links = [{"name": "body", "inertial": {"mass": 5.0, "inertia": moments}}]
    links[0]["joint"] = {"name": "body", "type": "free"}
    closures, upper, lower, lift = [], 0.2, 0.25, 0.3
    axes = {"yaw": [0.0, 0.0, 1.0], "hip": [0.0, 1.0, 0.0], "knee": [0.0, 1.0, 0.0]}
    height = 0.4
    for leg, knee in enumerate(knees):
        reach = upper * np.cos(lift) + lower * np.cos(lift + knee)
        depth = upper * np.sin(lift) + lower * np.sin(lift + knee)
        parent, place = "body", [0.1, 0.0, 0.0]
        turn = 2.0 * np.pi * leg / len(knees)
        for part, axis in axes.items():
            origin = {"xyz": place, "rpy": [0.0, 0.0, 0.0]}
            if part == "yaw":
                origin = {"xyz": [0.1 * np.cos(turn), 0.1 * np.sin(turn), 0.0]}
                origin["rpy"] = [0.0, 0.0, turn]
            joint = {"name": f"{part}{leg}", "type": "revolute", "axis": axis, "origin": origin}
            inertia = dict.fromkeys(("ixx", "iyy", "izz"), 1e-3)
            inertial = {"mass": 0.3, "com": [0.1, 0.0, 0.0], "inertia": inertia}
            link = {"name": f"{part}{leg}", "parent": parent, "joint": joint, "inertial": inertial}
            links.append(link)
            parent, place = f"{part}{leg}", [upper if part == "hip" else 0.0, 0.0, 0.0]
        out = 0.1 + reach
        foot = {"xyz": [out * np.cos(turn), out * np.sin(turn), height - depth]}
        tip = {"link": parent, "origin": {"xyz": [lower, 0.0, 0.0]}}
        ground = {"link": "world", "origin": foot}
        closures.append({"name": f"foot{leg}", "kind": "spherical", "a": tip, "b": ground})
    q = {"body": [0.0, 0.0, height, 0.0, 0.0, 0.0, 1.0]}
    for leg, knee in enumerate(knees):
        q |= {f"hip{leg}": lift, f"knee{leg}": knee}
    return scene_from_document(
        {
            "format": "hapticmech-scene/1",
            "name": "walker",
            "description": "A body on legs",
            "links": links,
            "closures": closures,
            "operational_points": [{"name": "top", "link": "body"}],
            "initial_state": {"q": q},
            "hand": {"kind": "constant_wrench"},
        }
    )


def bordered():
    """Yield closures of which many share the same rates, on the closures and off them."""
    scenes = [stewart_platform(legs) for legs in (6, 8, 24)]
    for scene in (*scenes, load_scene("stewart_platform"), walker(*[1.0] * 4), walker(*[0.8] * 10)):
        for away in (0.0, 0.02):
            yield posed(scene, 3, away)
    yield posed(load_scene("shared_payload"), 2, 0.01)


def small_ones():
    yield posed(load_scene("five_bar"), 0, 0.0)
    yield posed(load_scene("spatial_arm"), 1, 0.3)
    for kind in KINDS:
        yield from (posed_sample(closed_chain(seed, kind)) for seed in sampled(range(6), kind))
    for duplicated, planar in product((False, True), repeat=2):
        for seed in sampled(range(6), (planar, duplicated), 2):
            yield posed_sample(random_mechanism(seed, planar, duplicated=duplicated))


PAIRS = [windows(number) for number in (1, 2, 5, 15, 40)]
PAIRS += [windows(number, "revolute") for number in (2, 15)]
PAIRS += [long_chain(number) for number in (3, 40)]
BORDERED = list(bordered())
PAIRS += BORDERED + list(small_ones())


def sparse(pair):
    """Return the pair's closures, all active, with a sparse factorisation."""
    dense = pair.mechanism.active_set((True,) * len(pair.mechanism.closures)).dense
    found = layout.sparse(dense, pair.q)
    assert found is not None
    assert found.is_sparse
    return found


@pytest.mark.parametrize("pair", PAIRS)
def test_it_is_the_dense_one(pair):
    active_set = sparse(pair)
    found = factored(pair.mechanism.tree, active_set, pair.q)
    expected = factored(pair.mechanism.tree, active_set.dense, pair.q)
    assert found.active_set is active_set
    assert found.rank == expected.rank
    assert found.error == expected.error
    magnified = ROUNDING * condition(expected.space)
    v = np.cos(np.arange(pair.v.size))
    rows = expected.jacobian @ v
    assert apart(found.space.correction(rows), expected.space.correction(rows)) < magnified
    kept = [closing.space.closed_rates(pair.v + v) for closing in (found, expected)]
    assert apart(*kept) < magnified
    size = expected.space.size(v)
    assert abs(found.space.size(v) - size) < ROUNDING * size


@pytest.mark.parametrize("pair", PAIRS)
def test_accelerations_are_the_same(pair):
    active_set = sparse(pair)
    closings = [
        factored(pair.mechanism.tree, kind, pair.q) for kind in (active_set, active_set.dense)
    ]
    bias = closings[1].jacobian @ np.sin(np.arange(pair.v.size))
    zero, results = np.zeros(pair.v.size), []
    for closing in closings:
        result = np.concatenate((np.cos(np.arange(pair.v.size)), np.zeros(active_set.m)))
        accelerate(closing.active_set.model, closing.parts, zero, zero, bias, result)
        results.append(result[: pair.v.size])
    assert apart(*results) < ROUNDING * condition(closings[1].space)


@pytest.mark.parametrize("pair", PAIRS[::3])
def test_what_it_does_not_have_is_the_dense_ones(pair):
    """Matrices of the mass metric, and the smallest λ."""
    active_set = sparse(pair)
    one = factored(pair.mechanism.tree, active_set, pair.q)
    other = factored(pair.mechanism.tree, active_set.dense, pair.q)
    assert (one.jacobian == other.jacobian).all()
    assert (one.space.factor == other.space.factor).all()
    assert (one.space.basis == other.space.basis).all()
    force = np.cos(np.arange(pair.v.size))
    active = (True,) * len(pair.mechanism.closures)
    terms = [pair.mechanism.evaluate(pair.q, pair.v, active, closing) for closing in (one, other)]
    results = [np.concatenate(term.acceleration(force)) for term in terms]
    assert (results[0] == results[1]).all()


@pytest.mark.parametrize("number", [15, 40])
@pytest.mark.parametrize("kind", ["planar_pin", "revolute"])
def test_points_are_analysed_alike(number, kind):
    pair = windows(number, kind)
    assert pair.mechanism.active_set(pair.mechanism.initially_active).is_sparse
    state = pair.q, pair.v, pair.mechanism.initially_active
    seen = Analyser(pair.mechanism).observe(*state).model
    dense = factored(pair.mechanism.tree, sparse(pair).dense, pair.q)
    terms = pair.mechanism.evaluate(*state, dense)
    found, point = Analyser(pair.mechanism).analyse(terms), terms.points[0]
    rows = found.rows
    x = inverse_inertia(terms.inertia, terms.closure_jacobian, point.jacobian[rows])
    falls = point.jacobian @ terms.acceleration(np.zeros(pair.v.size))[0] + point.drift
    moving = np.concatenate((pin.SE3ToXYZQUAT(point.pose), point.twist))
    expected = [found.spectrum.s, x, falls, moving]
    seen_x = seen[PARTS[1]].reshape(6, 6)[np.ix_(rows, rows)]
    given = [seen[PARTS[0]][: rows.size], seen_x, *(seen[part] for part in PARTS[2:])]
    magnified = ROUNDING * number
    # s, X, a_0, and where the point is: P_c and Π turn with rounding where s repeats.
    for one, other in zip(given, expected, strict=True):
        assert apart(one, other, 1.0) < magnified


def test_a_step_is_the_dense_ones():
    """Whose rule is the same, and whose loops are closed to rounding as well."""
    scene = n_four_bar(15)
    one, other = Simulator(scene), Simulator(scene)
    active = one.mechanism.initially_active
    assert one.mechanism.active_set(active).is_sparse
    other.mechanism.take(active, other.mechanism.active_set(active).dense)
    assert not other.mechanism.active_set(active).is_sparse
    push = np.array([[3.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    state, expected = (sim.run(sim.initial_state(), 20, push).end for sim in (one, other))
    assert apart(state.q, expected.q) < 1e-11
    assert apart(state.v, expected.v) < 1e-10
    assert state.account.work_in == pytest.approx(expected.account.work_in, rel=1e-9)


@pytest.mark.parametrize("kind", ["planar_pin", "revolute"])
def test_a_long_run_keeps_its_energy(kind):
    """Through singular positions, where the dense factorisation has to help."""
    scene = windows(15, kind, turn=0.0).mechanism.scene
    simulator = Simulator(scene)
    start = simulator.initial_state()
    before = sum(simulator.mechanism.energy(start.q, start.v))
    found = simulator.run(start, 2000, every=100)
    energies = [
        sum(simulator.mechanism.energy(q, v)) for q, v in zip(found.q, found.v, strict=True)
    ]
    kinetic = simulator.mechanism.energy(start.q, start.v)[0]
    assert np.abs(np.array(energies) - before).max() < 1e-7 * kinetic
    assert found.end.closure_error < 1e-12


@pytest.mark.parametrize("angle", [0.0, 1e-7])
def test_next_to_a_singular_position_it_gives_up(angle):
    """All uprights in line: rows depend on each other, or nearly; who asks gets the dense one."""
    pair = windows(15, turn=0.0)
    level = pair.mechanism.integrate(pair.q, (np.pi / 2 - angle) * pair.v / np.abs(pair.v).max())
    active_set = sparse(pair)
    terms = Data(active_set.model.numbers, np.empty(active_set.size))
    assert factor(active_set.model, level, terms) == NOT_DECIDED
    closing = pair.mechanism.closing_terms(level, pair.mechanism.initially_active)
    assert isinstance(closing, Closing)
    assert not closing.active_set.is_sparse


@pytest.mark.parametrize("pair", BORDERED)
def test_shared_rates_are_left_to_the_border(pair):
    """So that the band is as wide as one leg, whatever their number."""
    active_set = sparse(pair)
    assert active_set.model.border in (6, 12)
    assert active_set.model.width < 12


def test_a_leg_in_line_is_for_the_dense_one():
    """Its own three rates do not give its foot every velocity; with the body's all rows count."""
    pair, straight = (posed(walker(knee, 1.0, 1.0, 1.0)) for knee in (1.0, 0.0))
    active_set = sparse(pair)
    assert active_set.model.border == 6
    terms = Data(active_set.model.numbers, np.empty(active_set.size))
    assert factor(active_set.model, straight.q, terms) == NOT_DECIDED
    closing = factored(pair.mechanism.tree, active_set, straight.q)
    assert not closing.active_set.is_sparse
    assert closing.rank == 12


def test_small_and_implicit_ones_are_dense():
    small = Mechanism(load_scene("five_bar"))
    assert not small.active_set((True,)).is_sparse
    scene = n_four_bar(40)
    assert Mechanism(scene).nv > MANY_RATES
    implicit = Mechanism(scene.stepped(integrator="linearly_implicit"))
    assert not implicit.active_set(implicit.initially_active).is_sparse


def test_long_ones_are_sparse():
    assert Mechanism(n_four_bar(40)).active_set((True,) * 40).is_sparse
    active_set = long_chain(40).mechanism.active_set(())
    assert active_set.is_sparse
    assert active_set.model.width == 0
