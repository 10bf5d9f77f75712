# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes: where their ends are, which way they turn, and what vanishes."""

from __future__ import annotations

import numpy as np
import pytest

from hapticmech_ros.view.shapes import (
    arrow,
    axes,
    capsule,
    double_arrow,
    ring,
    rotation_to,
    sphere,
)
from oracles.generator import unit

GREY = (0.5, 0.5, 0.5, 1.0)
SEEDS = range(6)


def vectors(seed, count):
    rng = np.random.default_rng(seed)
    return [rng.normal(size=3) for _ in range(count)]


@pytest.mark.parametrize(
    "direction", [*np.eye(3), *-np.eye(3), *(unit(np.random.default_rng(s)) for s in SEEDS)]
)
def test_rotation_puts_z_along_the_direction(direction):
    rotation = rotation_to(3.0 * direction)
    assert np.abs(rotation[:, 2] - direction).max() < 1e-15
    assert np.abs(rotation.T @ rotation - np.eye(3)).max() < 1e-15
    assert np.linalg.det(rotation) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_capsule_goes_from_end_to_end(seed):
    start, end = vectors(seed, 2)
    body, *ends = capsule(start, end, 0.1, GREY)
    half = 0.5 * body.size[2] * body.pose.rotation[:, 2]
    assert body.pose.translation - half == pytest.approx(start, abs=1e-14)
    assert body.pose.translation + half == pytest.approx(end, abs=1e-14)
    assert [ball.pose.translation.tolist() for ball in ends] == [start.tolist(), end.tolist()]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_ring_turns_right_handed_about_its_axis(seed):
    centre, axis = vectors(seed, 2)
    line, head = ring(centre, axis, 0.2, 0.01, GREY, sense=True)
    arms = line.points - centre
    assert np.linalg.norm(arms, axis=1) == pytest.approx(np.full(len(arms), 0.2), rel=1e-12)
    assert np.abs(arms @ axis).max() < 1e-14
    forward = np.diff(line.points, axis=0)
    assert (np.cross(arms[:-1], forward) @ axis > 0.0).all()
    tail, tip = head.points
    assert tail == pytest.approx(line.points[-1])
    assert np.cross(arms[-1], tip - tail) @ axis > 0.0


def test_a_ring_without_sense_is_closed_and_has_no_head():
    (line,) = ring(np.zeros(3), np.array((0.0, 0.0, 1.0)), 0.2, 0.01, GREY, sense=False)
    assert line.points[0] == pytest.approx(line.points[-1], abs=1e-15)


@pytest.mark.parametrize("length", [1e-3, 0.01, 1.0])
def test_the_head_of_an_arrow_is_shorter_than_the_arrow(length):
    (shape,) = arrow(np.zeros(3), np.array((length, 0.0, 0.0)), 0.05, GREY)
    assert 0.0 < shape.size[2] < length


def test_a_double_arrow_points_both_ways():
    half = np.array((0.1, 0.2, -0.3))
    one, other = double_arrow(np.ones(3), half, 0.01, GREY)
    assert one.points[1] - one.points[0] == pytest.approx(half, abs=1e-15)
    assert other.points[1] - other.points[0] == pytest.approx(-half, abs=1e-15)


def test_what_has_no_length_is_no_shape():
    zero = np.zeros(3)
    assert arrow(zero, zero, 0.1, GREY) == []
    assert double_arrow(zero, zero, 0.1, GREY) == []
    assert ring(zero, zero, 0.1, 0.01, GREY, sense=True) == []


def test_axes_begin_at_the_origin_and_are_x_y_z():
    pose = sphere(np.array((1.0, 2.0, 3.0)), 0.1, GREY).pose
    pose.rotation = rotation_to(np.array((0.2, 0.5, -0.4)))
    for index, shape in enumerate(axes(pose, 0.3, 0.01, (GREY, GREY, GREY))):
        half = 0.5 * shape.size[2] * shape.pose.rotation[:, 2]
        assert shape.pose.translation - half == pytest.approx(pose.translation, abs=1e-14)
        assert 2.0 * half == pytest.approx(0.3 * pose.rotation[:, index], abs=1e-14)
