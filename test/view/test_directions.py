# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rigid and free directions: the span is the analysis's, and the picture does not flicker."""

from __future__ import annotations

import numpy as np
import pytest

from hapticmech_ros import Mechanism, analyse, load_scene
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.projection import consistent_initial_state
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.view.shapes import directions, gathered
from oracles.generator import random_mechanism


def analysed(name):
    mechanism = Mechanism(load_scene(name))
    return analyse(mechanism, consistent_initial_state(mechanism)[0])


def random_turn(rng, size):
    turn, _ = np.linalg.qr(rng.normal(size=(size, size)))
    return turn


@pytest.mark.parametrize("size", [1, 2, 3, 6])
def test_turning_columns_changes_neither_span_nor_metric(size):
    columns = np.random.default_rng(size).normal(size=(6, size))
    found = gathered(columns)
    # An orthogonal matrix from an SVD: rounding on numbers around 1.
    assert np.abs(found @ found.T - columns @ columns.T).max() < 1e-13


@pytest.mark.parametrize("size", [2, 3])
def test_any_basis_of_a_span_gives_the_same_picture(size):
    rng = np.random.default_rng(size)
    columns = rng.normal(size=(6, size))
    first = gathered(columns)
    for _ in range(5):
        other = gathered(columns @ random_turn(rng, size))
        signs = np.sign(np.sum(first * other, axis=0))
        assert np.abs(first - signs * other).max() < 1e-12


def test_forces_are_gathered_in_few_columns():
    rng = np.random.default_rng(3)
    force, torque = np.zeros((6, 1)), np.zeros((6, 1))
    force[0], torque[5] = 2.0, 0.5
    mixed = np.hstack((force, torque)) @ random_turn(rng, 2)
    found = np.abs(gathered(mixed))
    assert np.abs(found - np.hstack((force, torque))).max() < 1e-14


@pytest.mark.parametrize("name", ["five_bar", "two_link", "spatial_arm"])
def test_every_direction_is_rigid_or_free(name):
    analysis = analysed(name)
    for count in range(analysis.rows.size + 1):
        rigid, free = directions(analysis, count)
        assert len(rigid) == count
        assert len(free) == analysis.rows.size - count


def test_a_rigid_direction_is_one_that_the_joints_balance():
    analysis = analysed("two_link")
    ((force, _),), _ = directions(analysis, 1)
    expected = analysis.constraint_wrenches[:3, 0]
    cosine = force @ expected / (np.linalg.norm(force) * np.linalg.norm(expected))
    assert abs(cosine) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_shares_are_at_most_one(seed):
    sample = random_mechanism(seed, closed=False)
    mechanism = Mechanism(scene_from_document(sample.document))
    analysis = analyse(mechanism, sample.q)
    rigid, free = directions(analysis, analysis.rows.size - analysis.rank)
    lengths = [np.linalg.norm(part) for found in rigid + free for part in found]
    assert max(lengths) <= 1.0 + 1e-12


@pytest.mark.parametrize("count", [-1, 4])
def test_a_count_that_cannot_be_is_refused(count):
    with pytest.raises(InvalidInputError, match=f"count.*0 to 3.*{count}"):
        directions(analysed("five_bar"), count)
