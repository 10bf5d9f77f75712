# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rods: a distance kept between two points, in space and in the plane."""

import copy
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.projection import project
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.simulation import Simulator
from hapticmech_ros.view.placement import Placer
from hapticmech_ros.view.shapes import closure_shapes
from mechanism.test_closures import sample_with
from oracles.factorisation import factored_as_dense
from oracles.generator import random_mechanism
from oracles.kinematics import frame_pose, link_poses
from oracles.posed import posed
from oracles.running import run, with_start
from sampling import sampled

CASES = [
    (seed, planar, off)
    for planar, off in product((False, True), (0.0, 0.2))
    for seed in sampled(range(6), (planar, off))
]


def rod_of(document):
    """Return the rod's closure and its gap (3,), a function of q."""
    closure = document["closures"][0]

    def gap(q):
        poses = link_poses(document, q)
        return frame_pose(poses, closure["a"])[1] - frame_pose(poses, closure["b"])[1]

    return closure, gap


@pytest.mark.parametrize(("seed", "planar", "off"), CASES)
def test_a_rod_is_one_row_and_its_distance_is_the_row_s(seed, planar, off):
    document, q, v = sample_with("rod", planar, seed, off)
    state = posed(scene_from_document(with_start(document, q, v)), seed, off)
    terms = state.evaluate((True,))
    factored_as_dense(state, (True,))
    assert terms.space.rank == 1
    (residual,), (rate,) = terms.closure_residual, terms.closure_jacobian @ state.v
    found = state.mechanism.distance_of(0, state.q, state.v)
    assert found[0] == pytest.approx(abs(residual), abs=1e-13)
    if off:
        assert found[1] == pytest.approx(rate * np.sign(residual), rel=1e-9)


@pytest.mark.parametrize("planar", [False, True])
def test_projection_brings_the_points_to_the_rods_length(planar):
    document, q, v = sample_with("rod", planar, 1, 0.02)
    closure, gap = rod_of(document)
    mechanism = Mechanism(scene_from_document(document))
    projected = project(mechanism, q, v, (True,))
    d = gap(projected.q)
    assert np.linalg.norm(d) == pytest.approx(closure["length"], rel=1e-12)
    jacobian = mechanism.evaluate(projected.q, projected.v, (True,)).closure_jacobian
    assert np.abs(jacobian @ projected.v).max() < 1e-12 * np.abs(v).max()


def test_rows_count_in_metres():
    document, _, _ = sample_with("rod", False, 0, 0.0)
    mechanism = Mechanism(scene_from_document(document))
    (loop,) = mechanism.closures
    assert loop.rows == 1
    assert loop.row_lengths(mechanism.length).tolist() == [mechanism.length]


def test_an_open_rod_latches_at_its_length():
    # A slider thrown outwards, caught at 0.3 m.
    document = copy.deepcopy(random_mechanism(0, closed=False, links=1).document)
    document["gravity"] = [0.0, 0.0, 0.0]
    joint = {"name": "slide", "type": "prismatic", "axis": [1.0, 0.0, 0.0]}
    document["links"][0]["joint"] = joint
    document["operational_points"] = document["operational_points"][:1]
    ends = {"a": {"link": "link0"}, "b": {"link": "world"}}
    rod = {"name": "rod", "kind": "rod", "length": 0.3, "active": False, "latch_distance": 0.01}
    document["closures"] = [rod | ends]
    document["initial_state"] = {"q": {"slide": 0.1}, "v": {"slide": 1.0}}
    sim = Simulator(scene_from_document(document))
    states = run(sim, 0.3)
    assert states[0].active == (False,)
    assert states[-1].active == (True,)
    assert states[-1].q == pytest.approx([0.3], abs=1e-9)
    assert states[-1].v == pytest.approx([0.0], abs=1e-12)
    assert states[-1].account.latch_loss > 0.0


def test_a_closed_rod_is_drawn_with_both_ends_and_others_as_one_ball():
    document, q, v = sample_with("rod", False, 0, 0.0)
    gap = rod_of(document)[1](q)
    scene = scene_from_document(with_start(document, q, v))
    mechanism = Mechanism(scene)
    placement = Placer(mechanism).at(q)
    assert placement.rods == {"loop"}
    closed, opened = (closure_shapes(placement, {"loop": on}, 1.0) for on in (True, False))
    assert [shape.kind for shape in closed] == [shape.kind for shape in opened]
    ends = np.array([shape.pose.translation for shape in closed[:2]])
    assert np.abs(ends[0] - ends[1] - gap).max() < 1e-14
    assert {shape.namespace for shape in closed} == {"closures"}
    ball = closure_shapes(replace(placement, rods=frozenset()), {"loop": True}, 1.0)
    assert len(ball) == 1
