# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes that may touch, springs between points and slides are drawn where they are."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros import Mechanism, load_scene
from hapticmech_ros.mechanism.projection import consistent_initial_state
from hapticmech_ros.scene import document_of, scene_from_document
from hapticmech_ros.view import Picture, Placer, Snapshot

AT = {"xyz": [0.02, 0.01, 0.0], "rpy": [0.0, 0.0, 0.3]}
GEOMETRIES = {
    "ball": {"kind": "sphere", "radius": 0.01},
    "brick": {"kind": "box", "size": [0.01, 0.02, 0.03]},
    "tin": {"kind": "cylinder", "radius": 0.01, "length": 0.04},
    "pill": {"kind": "capsule", "radius": 0.01, "length": 0.04},
    "wall": {"kind": "half_space"},
}
SPRING = {
    "name": "band",
    "a": {"link": "world", "origin": {"xyz": [0.1, 0.1, 0.0]}},
    "b": {"link": "link2", "origin": {"xyz": [0.045, 0.0, 0.0]}},
}


def drawn(namespace, name="two_link", **parts):
    """Return shapes of a shipped scene with further parts at its start, and where its links are."""
    mechanism = Mechanism(scene_from_document(document_of(load_scene(name)) | parts))
    placement = Placer(mechanism).at(consistent_initial_state(mechanism)[0])
    shapes = Picture(mechanism, 0.0, 0.0).draw(Snapshot(mechanism.initially_active), placement)
    return [shape for shape in shapes if shape.namespace == namespace], placement, mechanism.length


@pytest.mark.parametrize("link", ["link2", "world"])
@pytest.mark.parametrize("kind", GEOMETRIES)
def test_a_shape_is_drawn_in_its_frame(kind, link):
    one = {"name": kind, "link": link, "origin": AT, "geometry": GEOMETRIES[kind]}
    shapes, placement, length = drawn("solids", shapes=[one])
    frame = placement.links["link2"] if link == "link2" else pin.SE3.Identity()
    frame = frame * pin.SE3(pin.rpy.rpyToMatrix(*map(float, AT["rpy"])), np.array(AT["xyz"]))
    body = shapes[0]
    expected = {
        "ball": ("sphere", (0.02, 0.02, 0.02)),
        "brick": ("box", (0.01, 0.02, 0.03)),
        "tin": ("cylinder", (0.02, 0.02, 0.04)),
        "pill": ("cylinder", (0.02, 0.02, 0.04)),
        "wall": ("box", body.size),
    }[kind]
    assert body.kind == expected[0]
    assert body.size == pytest.approx(expected[1])
    assert len(shapes) == (3 if kind == "pill" else 1)
    if kind == "wall":
        # Its upper face is the plane.
        face = body.pose * np.array((0.0, 0.0, 0.5 * body.size[2]))
        assert face == pytest.approx(frame.translation, abs=1e-15)
        assert body.size[0] > length
    else:
        assert body.pose.translation == pytest.approx(frame.translation, abs=1e-15)
    assert abs(body.pose.rotation[:, 2] @ frame.rotation[:, 2]) == pytest.approx(1.0)


def test_a_spring_goes_from_end_to_end_in_the_plane():
    (band,), placement, _ = drawn("springs", springs=[SPRING])
    start, end = np.array(SPRING["a"]["origin"]["xyz"]), placement.points["handle"].translation
    assert band.points[0] == pytest.approx(start, abs=1e-15)
    assert band.points[-1] == pytest.approx(end, abs=1e-15)
    along = (end - start) / np.linalg.norm(end - start)
    ways = np.diff(band.points, axis=0) @ along
    assert (ways > 0.0).all()
    assert np.abs(band.points[:, 2]).max() < 1e-15
    aside = np.linalg.norm(np.cross(band.points - start, along), axis=1)
    assert aside.max() > 0.001


def test_a_slide_is_a_line_from_its_zero():
    joints, placement, _ = drawn("joints", "scissor_lift")
    lines = [shape.points for shape in joints if shape.kind == "strip"]
    assert len(lines) == 3
    height = placement.links["platform"].translation
    assert any(np.array_equal(line, (np.zeros(3), height)) for line in lines)
