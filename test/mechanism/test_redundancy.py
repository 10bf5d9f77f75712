# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Redundant rows: counted by the solver's rank, named in the scene's order."""

import numpy as np
import pytest

from benchmarks.accuracy import cases
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.model import authored_state
from hapticmech_ros.mechanism.projection import consistent_initial_state
from hapticmech_ros.mechanism.redundancy import independent, redundancy
from hapticmech_ros.scene import scene_from_document
from oracles.generator import random_mechanism
from oracles.planar_linkages import PIVOT, five_bar, five_bar_bent
from oracles.planar_loops import Loop
from oracles.running import with_start

BENCHMARKS = {case.name: case.scene for case in cases()}


def report(scene):
    mechanism = Mechanism(scene)
    q, _ = authored_state(scene, mechanism.tree)
    return redundancy(mechanism, q, mechanism.initially_active)


def pinned(copies):
    """Return the paper's five-bar with its pin ``copies`` times."""
    document = with_start(five_bar(), five_bar_bent(1.9, 0.6))
    (pin,) = document["closures"]
    return document | {"closures": [pin | {"name": f"pin{k}"} for k in range(copies)]}


def four_bar_in_space():
    """Return a planar four-bar whose last joint is a hinge in space: three rows say nothing."""
    ones = np.ones(3)
    document = Loop(ones, ones, ones, np.array([1.2, 0.1])).document(np.array([1.1]), np.zeros(1))
    (pin,) = document["closures"]
    hinge = pin | {"name": "hinge", "kind": "revolute"}
    return document | {"task_space": "spatial", "closures": [hinge]}


@pytest.mark.parametrize("copies", [1, 2, 21])
def test_of_equal_pins_the_first_counts(copies):
    found = report(scene_from_document(pinned(copies)))
    assert (found.rows, found.rank, found.mobility) == (2 * copies, 2, 2)
    assert found.closures[0].rows == ("pin0/x", "pin0/y")
    others = tuple(f"pin{k}" for k in range(1, copies))
    assert found.wholly_redundant == others
    assert found.redundant == tuple(f"{pin}/{axis}" for pin in others for axis in "xy")


def test_a_rod_is_one_row_and_one_beside_it_is_redundant():
    document = pinned(1)
    (pin,) = document["closures"]
    above = {"link": "world", "origin": {"xyz": [PIVOT[0], PIVOT[1] + 0.1, 0.0]}}
    rod = pin | {"kind": "rod", "length": 0.1 - 1e-6, "b": above}
    rods = [rod | {"name": f"rod{k}"} for k in range(2)]
    found = report(scene_from_document(document | {"closures": rods}))
    assert (found.rows, found.rank, found.mobility) == (2, 1, 3)
    assert found.redundant == ("rod1/length",)
    assert found.residual_m == pytest.approx(1e-6, rel=1e-4)
    assert found.residual_rad == 0.0


def test_only_active_closures_count():
    mechanism = Mechanism(scene_from_document(pinned(2)))
    q, _ = authored_state(mechanism.scene, mechanism.tree)
    found = redundancy(mechanism, q, (False, True))
    assert [closure.name for closure in found.closures] == ["pin1"]
    assert found.redundant == ()
    opened = redundancy(mechanism, q, (False, False))
    assert (opened.rows, opened.rank, opened.mobility, opened.closures) == (0, 0, 4, ())
    assert (opened.residual_m, opened.residual_rad) == (0.0, 0.0)


def test_a_hinge_in_space_that_closes_a_planar_loop():
    found = report(scene_from_document(four_bar_in_space()))
    assert (found.rows, found.rank, found.mobility) == (5, 2, 1)
    assert found.redundant == ("hinge/z", "hinge/tilt_x", "hinge/tilt_y")
    assert found.wholly_redundant == ()


def test_windows_in_line_lose_a_row():
    scene = BENCHMARKS["n_four_bar_2"]
    mechanism = Mechanism(scene)
    in_line, active = np.zeros(mechanism.nq), mechanism.initially_active
    upright = report(scene)
    assert (upright.rank, upright.mobility, upright.redundant) == (4, 1, ())
    # In line each pin's x row is nothing to first order, the y rows are not.
    flat = redundancy(mechanism, in_line, active)
    assert flat.rank < 4
    assert flat.mobility == mechanism.nv - flat.rank
    assert set(flat.redundant) == {"pin0/x", "pin1/x"}


@pytest.mark.parametrize("seed", range(12))
def test_as_many_rows_are_left_as_the_rank_and_they_have_it(seed):
    sample = random_mechanism(seed, duplicated=seed % 2 == 0)
    scene = scene_from_document(with_start(sample.document, sample.q, sample.v))
    mechanism = Mechanism(scene)
    q, _ = consistent_initial_state(mechanism)
    active = mechanism.initially_active
    found = redundancy(mechanism, q, active)
    closing = mechanism.closing_terms(q, active)
    names = [name for closure in found.closures for name in closure.rows]
    kept = [k for k, name in enumerate(names) if name not in found.redundant]
    assert found.rank == closing.space.rank == len(kept)
    assert np.linalg.matrix_rank(closing.jacobian[kept], tol=1e-9) == found.rank


def test_residuals_are_told_in_metres_and_radians_apart():
    scene = BENCHMARKS["bricard"]
    mechanism = Mechanism(scene)
    q, _ = authored_state(scene, mechanism.tree)
    moved = mechanism.integrate(q, np.full(mechanism.nv, 1e-3))
    residual = np.abs(mechanism.closing_terms(moved, (True,)).residual)
    found = redundancy(mechanism, moved, (True,))
    assert found.residual_m == residual[:3].max()
    assert found.residual_rad == residual[3:].max()
    assert found.residual_m != found.residual_rad


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_coupling_is_open_in_the_unit_of_the_joint_that_follows(kind):
    document = with_start(five_bar(), five_bar_bent(1.9, 0.6)) | {"closures": []}
    for link in document["links"][:2]:
        link["joint"] |= {"type": kind, "axis": [0.0, 0.0, 1.0]}
        if kind == "prismatic":
            link["joint"]["axis"] = [1.0, 0.0, 0.0]
    leader, joint = (link["joint"]["name"] for link in document["links"][:2])
    document["couplings"] = [{"name": "gear", "joint": joint, "leader": leader}]
    document["initial_state"] = {"q": {leader: 0.25, joint: 0.5}}
    found = report(scene_from_document(document))
    expected = (0.25, 0.0) if kind == "prismatic" else (0.0, 0.25)
    assert (found.residual_m, found.residual_rad) == expected


@pytest.mark.parametrize("seed", range(20))
def test_elimination_keeps_as_many_rows_as_the_rank_also_where_it_is_close(seed):
    """Graded rows of exact rank: nothing is lost beside much larger rows, nothing is invented."""
    rng = np.random.default_rng(seed)
    rank = int(rng.integers(1, 6))
    sizes = np.geomspace(1.0, 3e-8, rank)
    many = int(rng.integers(rank, 15))
    left, _ = np.linalg.qr(rng.normal(size=(many, rank)))
    right, _ = np.linalg.qr(rng.normal(size=(rank, rank)))
    rows = (left * sizes) @ right
    assert sum(independent(rows)) == rank


def test_elimination_is_in_order():
    rows = np.array([[0.0, 0.0], [1.0, 0.0], [-2.0, 0.0], [1.0, 1e-7], [0.0, 1.0]])
    assert independent(rows) == [False, True, False, True, False]


@pytest.mark.parametrize("q", [np.zeros(3), [0.0, 0.0, np.nan, 0.0]])
def test_a_configuration_of_wrong_size_or_not_finite_is_refused(q):
    mechanism = Mechanism(scene_from_document(pinned(1)))
    with pytest.raises(InvalidInputError):
        redundancy(mechanism, q, (True,))
