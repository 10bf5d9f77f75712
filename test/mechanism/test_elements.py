# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Springs, friction, stops and efforts: forces against energies, slopes, and kernels."""

import copy
from functools import cache

import numpy as np
import pytest

from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.model import authored_state
from hapticmech_ros.scene import scene_from_document
from oracles.differences import columns, relative
from oracles.generator import blank, random_inertial, random_mechanism, random_origin
from oracles.kinematics import POSITION_SIZE, frame_pose, link_poses
from oracles.posed import posed
from oracles.running import with_start
from oracles.slopes import slopes, tangents

# Sums of some ten products, each rounded to 1e-16, in another order.
ROUNDING = 1e-12
CASES = [(seed, planar) for seed in range(8) for planar in (False, True)]


def gap_of(document, q, part):
    poses = link_poses(document, q)
    return frame_pose(poses, part["a"])[1] - frame_pose(poses, part["b"])[1]


@cache
def sample(seed, planar=False, slack=False):
    """Return a random tree with every element, a rod in every other one; stops partly entered.

    ``slack``: springs between points are at their rest length.
    """
    base = random_mechanism(seed, planar, closed=False)
    rng = np.random.default_rng([seed, planar])
    document, at = copy.deepcopy(base.document), 0
    for link in document["links"]:
        joint, place = link["joint"], base.q[at : at + 1]
        at += POSITION_SIZE[joint["type"]]
        if joint["type"] in ("revolute", "prismatic"):
            joint |= {name: float(rng.uniform(1.0, 9.0)) for name in ("stiffness", "effort")}
            joint |= {"rest": float(rng.normal()), "friction": float(rng.uniform(0.1, 1.0))}
            joint["friction_speed"] = float(rng.uniform(0.05, 0.5))
            below, above = rng.uniform(-0.2, 0.1), rng.uniform(0.25, 0.4)
            ends = {"lower": float(place[0] + below), "upper": float(place[0] + above)}
            if rng.random() < 0.5:
                ends = {"lower": -ends["upper"], "upper": -ends["lower"]}
            joint["limits"] = ends | {"stiffness": 50.0, "damping": 3.0, "depth": 0.1}
    joined = (("link4", "world"), ("link0", "link3"), ("world", "link2"))
    parts = [
        {
            "a": {"link": a, "origin": random_origin(rng, planar)},
            "b": {"link": b, "origin": random_origin(rng, planar)},
        }
        for a, b in joined
    ]
    lengths = [float(np.linalg.norm(gap_of(document, base.q, part))) for part in parts]
    document["springs"] = [
        {
            "name": f"spring{index}",
            "stiffness": float(rng.uniform(1.0, 90.0)),
            "damping": float(rng.uniform(0.0, 5.0)),
            "rest_length": length if slack else float(rng.uniform(0.0, 1.0)),
            **part,
        }
        for index, (part, length) in enumerate(zip(parts, lengths, strict=True))
    ]
    if seed % 2:
        document["closures"] = [{"name": "rod", "kind": "rod", "length": lengths[0], **parts[0]}]
    return scene_from_document(with_start(document, base.q, base.v))


def at_start(scene):
    mechanism = Mechanism(scene)
    return mechanism, *authored_state(scene, mechanism.tree)


def passive(mechanism, q, v):
    return mechanism.evaluate(q, v, mechanism.initially_active).passive_force


def one_joint(kind="revolute", **joint):
    """Return a scene of one body on one joint, without gravity."""
    rng = np.random.default_rng(3)
    axis = {"axis": [0.0, 0.0, 1.0]}
    link = {
        "name": "body",
        "joint": {"name": "joint", "type": kind} | axis | joint,
        "inertial": random_inertial(rng, planar=False),
    }
    point = {"name": "tip", "link": "body", "origin": {"xyz": [0.3, 0.0, 0.0]}}
    return blank() | {"links": [link], "operational_points": [point]}


@pytest.mark.parametrize(("seed", "planar"), CASES)
def test_forces_at_rest_are_the_slope_of_the_potential_energy(seed, planar):
    mechanism, q, v = at_start(sample(seed, planar))
    rest = np.zeros(v.size)
    terms = mechanism.evaluate(q, rest, mechanism.initially_active)

    def potential(change):
        return np.array([mechanism.energy(mechanism.integrate(q, change), rest)[1]])

    # Gravity's part of h is known from other tests. eps V / h = 1e-11, h^4 V/30 far less.
    expected = -columns(potential, v.size, 1e-4)[0]
    assert relative(terms.passive_force - terms.bias_force, expected) < 1e-8
    assert not terms.dissipative_force.any()


@pytest.mark.parametrize(("seed", "planar"), CASES)
def test_energies_of_the_terms_are_pinocchios(seed, planar):
    mechanism, q, v = at_start(sample(seed, planar))
    space = mechanism.evaluate(q, v, mechanism.initially_active).space
    kinetic, potential = mechanism.energy(q, v)
    assert 0.5 * space.size(v) ** 2 == pytest.approx(kinetic, rel=ROUNDING)
    assert space.closing.potential_energy == pytest.approx(potential, rel=ROUNDING)


@pytest.mark.parametrize(("seed", "planar"), CASES)
def test_stiffness_and_damping_are_the_slopes_of_the_forces_at_rest(seed, planar):
    """Where springs between points are slack: what these only pull by is no slope of theirs."""
    mechanism, q, v = at_start(sample(seed, planar, slack=True))
    rest = np.zeros(v.size)
    stiffness, damping = slopes(mechanism, q, rest, 0.0)

    def moved(change):
        return -passive(mechanism, mechanism.integrate(q, change), rest)

    def sped(change):
        return -passive(mechanism, q, change)

    # eps τ / h = 1e-11 of forces up to 50 times as stiff.
    assert relative(columns(moved, v.size, 1e-4), stiffness) < 1e-8
    # Friction's fifth derivative is at most 16 f / v_f^5 = 5e7: h^4/30 of it is 2e-10.
    assert relative(columns(sped, v.size, 1e-4), damping) < 1e-8


@pytest.mark.parametrize(("seed", "planar"), CASES)
def test_tangents_are_the_slopes_of_the_forces_in_motion(seed, planar):
    mechanism, q, v = at_start(sample(seed, planar, slack=True))
    speed = 0.01 * v
    stiffness, damping = tangents(mechanism, q, speed)

    def sped(change):
        return -passive(mechanism, q, speed + change)

    # As at rest; friction's fifth derivative is largest there.
    assert relative(columns(sped, v.size, 1e-4), damping) < 1e-8

    def moved(change):
        return -passive(mechanism, mechanism.integrate(q, change), np.zeros(v.size))

    # Stops' damping is left out of the elastic part by standing still; slack springs only pull.
    assert relative(columns(moved, v.size, 1e-4), stiffness) < 1e-8


@pytest.mark.parametrize(("seed", "planar"), CASES)
def test_slopes_are_symmetric_and_resist(seed, planar):
    mechanism, q, v = at_start(sample(seed, planar))
    for matrix in slopes(mechanism, q, v, 0.01):
        assert np.abs(matrix - matrix.T).max() < ROUNDING * np.abs(matrix).max()
        assert np.linalg.eigvalsh(matrix)[0] > -ROUNDING * np.abs(matrix).max()


@pytest.mark.parametrize(("seed", "planar"), CASES)
def test_dissipative_forces_take_energy_at_any_state(seed, planar):
    mechanism, q, v = at_start(sample(seed, planar))
    rng = np.random.default_rng(seed)
    for _ in range(20):
        place = mechanism.integrate(q, 0.3 * rng.normal(size=v.size))
        rates = v * rng.normal(size=v.size)
        terms = mechanism.evaluate(place, rates, mechanism.initially_active)
        assert terms.dissipative_force @ rates < 0.0


@pytest.mark.parametrize("turns", [0, 3, -3])
def test_a_spring_of_a_hinge_counts_turns(turns):
    scene = scene_from_document(one_joint(stiffness=2.0, rest=0.5))
    mechanism = Mechanism(scene)
    q = np.array([0.1 + 2.0 * np.pi * turns])
    assert passive(mechanism, q, np.zeros(1))[0] == 2.0 * (0.5 - q[0])
    assert mechanism.energy(q, np.zeros(1))[1] == (0.5 - q[0]) ** 2


@pytest.mark.parametrize(
    ("speed", "force"), [(1.0, -3.0), (-1.0, 3.0), (0.01, -3.0 * np.tanh(1.0))]
)
def test_friction_is_coulombs_away_from_rest(speed, force):
    scene = scene_from_document(one_joint("prismatic", friction=3.0, friction_speed=0.01))
    mechanism = Mechanism(scene)
    found = passive(mechanism, np.zeros(1), np.array([speed]))
    assert found == pytest.approx([force], rel=1e-15)
    # The secant: force over speed, and at rest the slope.
    assert slopes(mechanism, np.zeros(1), np.ones(1), 0.0)[1] == pytest.approx(3.0)
    assert slopes(mechanism, np.zeros(1), np.zeros(1), 0.0)[1] == pytest.approx(300.0)


@pytest.mark.parametrize(
    ("q", "v", "force"), [(0.5, 0.0, -2.0), (-0.5, 0.0, 2.0), (0.1, 0.0, 2.0), (0.3, 1.0, -2.0)]
)
def test_a_spring_between_points_pulls_along_the_line(q, v, force):
    ends = {"a": {"link": "body", "origin": {"xyz": [0.0, 0.0, 0.0]}}, "b": {"link": "world"}}
    spring = {"name": "s", "stiffness": 10.0, "damping": 2.0, "rest_length": 0.3} | ends
    axis = {"axis": [1.0, 0.0, 0.0]}
    scene = scene_from_document(one_joint("prismatic", **axis) | {"springs": [spring]})
    mechanism = Mechanism(scene)
    found = passive(mechanism, np.array([q]), np.array([v]))
    assert found == pytest.approx([force], rel=1e-14)


@pytest.mark.parametrize("place", [0.0, 1e-13])
def test_a_spring_without_length_has_no_direction_and_no_force(place):
    ends = {"a": {"link": "body"}, "b": {"link": "world"}}
    spring = {"name": "s", "stiffness": 10.0, "damping": 2.0, "rest_length": 0.3} | ends
    document = one_joint("prismatic") | {"springs": [spring]}
    document["initial_state"] = {"q": {"joint": place}, "v": {"joint": 1.0}}
    state = posed(scene_from_document(document))
    terms = state.evaluate(())
    assert (terms.passive_force == 0.0).all()
    assert (terms.dissipative_force == 0.0).all()
    assert state.mechanism.energy(state.q, 0.0 * state.v)[1] == pytest.approx(0.45, rel=1e-9)


def test_without_elements_nothing_but_damping_acts():
    mechanism, q, v = at_start(scene_from_document(one_joint(damping=0.5)))
    terms = mechanism.evaluate(q, v + 2.0, ())
    assert mechanism.elements.joints == ()
    assert (terms.passive_force == -1.0).all()
    assert (terms.dissipative_force == -1.0).all()
    assert (terms.effort == 0.0).all()
