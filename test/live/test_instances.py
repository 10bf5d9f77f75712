# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes as instances of unit bodies: where they are, and that they keep their places."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.live.live_picture import (
    BODIES,
    Instances,
    instance_parts,
    line_segments,
    unit_body,
)
from hapticmech_ros.view.shapes import arrow, box, cylinder, numbered, sphere, strip, text

RED, BLUE = (1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 0.25)
TAIL, TIP = np.array((0.1, 0.2, 0.3)), np.array((0.4, 0.0, 0.5))


@pytest.mark.parametrize("body", BODIES)
def test_unit_bodies_are_closed_have_size_1_and_their_triangles_look_outwards(body):
    corners, triangles = unit_body(body)
    assert np.ptp(corners, axis=0) == pytest.approx(np.ones(3))
    a, b, c = corners[triangles].transpose(1, 0, 2)
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0
    whole = {"box": 1.0, "sphere": np.pi / 6, "cylinder": np.pi / 4, "cone": np.pi / 12}[body]
    # A polyhedron in place of what is round.
    assert 0.85 * whole < volume <= whole * (1.0 + 1e-12)
    # Each edge is passed once in either sense, by the places of its ends.
    places = {tuple(np.round(corner, 9)): i for i, corner in enumerate(corners)}
    at = [places[tuple(np.round(corner, 9))] for corner in corners]
    edges = [(at[i], at[j]) for t in triangles for i, j in zip(t, np.roll(t, -1), strict=True)]
    assert len(set(edges)) == len(edges)
    assert {(j, i) for i, j in edges} == set(edges)


def drawn(instances, shapes, body):
    sets = instance_parts(shapes).items()
    return instances.arranged([one for key, parts in sets if key.body == body for one in parts])


def corners_of(arrays, body, at):
    """Return the corners of an instance in the world."""
    w, x, y, z = arrays.quaternions[at].astype(float)
    turn = pin.Quaternion(w, x, y, z).matrix()
    return arrays.positions[at] + (unit_body(body)[0] * arrays.scales[at]) @ turn.T


def test_an_arrow_is_a_shaft_and_a_head_from_tail_to_tip():
    shapes = numbered("force", arrow(TAIL, TIP, 0.01, RED))
    along = (TIP - TAIL) / np.linalg.norm(TIP - TAIL)
    shaft, head = (drawn(Instances(body), shapes, body) for body in ("cylinder", "cone"))
    seen = np.vstack((corners_of(shaft, "cylinder", 0), corners_of(head, "cone", 0)))
    reach = (seen - TAIL) @ along
    assert (reach.min(), reach.max()) == pytest.approx((0.0, np.linalg.norm(TIP - TAIL)), abs=1e-6)
    aside = np.linalg.norm(seen - TAIL - np.outer(reach, along), axis=1)
    assert aside.max() == pytest.approx(0.5 * 2.5 * 0.01, rel=1e-4)
    assert np.abs(corners_of(head, "cone", 0) - TIP).sum(axis=1).min() == pytest.approx(0, abs=1e-6)


def test_cylinders_boxes_and_ellipsoids_are_where_they_are_said_to_be():
    pose = pin.SE3(pin.rpy.rpyToMatrix(0.1, 0.2, 0.3), TAIL)
    shapes = [
        *numbered("a", [cylinder(TAIL, TIP - TAIL, 0.2, RED)]),
        *numbered("b", [box(pose, (0.1, 0.2, 0.3), BLUE)]),
        *numbered("c", [sphere(TIP, 0.4, RED)]),
    ]
    along = np.linalg.norm(TIP - TAIL)
    for shape, body in zip(shapes, ("cylinder", "box", "sphere"), strict=True):
        arrays = drawn(Instances(body), shapes, body)
        local = (corners_of(arrays, body, 0) - shape.pose.translation) @ shape.pose.rotation
        assert np.ptp(local, axis=0) == pytest.approx(shape.size, rel=1e-5)
        assert arrays.shapes[0] is shape
    assert shapes[0].size[2] == pytest.approx(along)
    blue = drawn(Instances("box"), shapes, "box")
    assert (blue.colours[0].tolist(), blue.opacities[0]) == ([0, 0, 255], 0.25)


def test_a_shape_keeps_its_place_while_others_come_and_go():
    known, places = Instances("sphere"), {}
    rng = np.random.default_rng(1)
    for _ in range(50):
        numbers = sorted(rng.choice(60, size=rng.integers(1, 50), replace=False).tolist())
        shapes = [numbered("ball", [sphere(TAIL, 0.1, RED)], first=n)[0] for n in numbers]
        arrays = drawn(known, shapes, "sphere")
        now = {one.number: at for at, one in enumerate(arrays.shapes) if one is not None}
        assert sorted(now) == numbers
        assert all(places[n] == now[n] for n in places.keys() & now.keys())
        empty = [at for at, one in enumerate(arrays.shapes) if one is None]
        assert (arrays.opacities[empty] == 0.0).all()
        assert (arrays.scales[empty] < 1e-6).all()
        places = now


def test_lines_are_segments_and_texts_are_left_out():
    points = np.array(((0.0, 0, 0), (1, 0, 0), (1, 1, 0)))
    shapes = [
        *numbered("line", [strip(points, 0.1, RED)]),
        *numbered("count", [text(TAIL, "2", 0.1, RED)]),
    ]
    ends, colours = line_segments(shapes)
    assert ends.tolist() == [points[:2].tolist(), points[1:].tolist()]
    assert (colours == (255, 0, 0)).all()
    assert not any(instance_parts(shapes).values())
    assert not line_segments([])[0].any()
