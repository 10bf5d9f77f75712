# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The URDF text, read by Pinocchio, is the mechanism that the scene describes."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.loading import load_scene, shipped_scenes
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.view import Placer, urdf_of
from hapticmech_ros.view.urdf import HINGES, hinge_angles, hinge_rates
from oracles.generator import random_mechanism

# Numbers are written exactly; what differs is how roll, pitch and yaw are turned into matrices:
# a few roundings per joint, on lengths around 1 m and inertias around 1 kg m².
TOLERANCE = 1e-12
SEEDS = range(12)


def cases() -> list[object]:
    shipped = [pytest.param(load_scene(name), id=name) for name in shipped_scenes()]
    random = [
        pytest.param(scene_from_document(random_mechanism(seed).document), id=f"random{seed}")
        for seed in SEEDS
    ]
    return shipped + random


def random_configuration(model: pin.Model, rng: np.random.Generator) -> np.ndarray:
    return pin.integrate(model, pin.neutral(model), rng.uniform(-1.3, 1.3, model.nv))


def as_read(mechanism: Mechanism, read: pin.Model, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return q in the model that was read, and E with its rates = E v."""
    tree = mechanism.tree
    out, rates = pin.neutral(read), np.zeros((read.nv, mechanism.nv))
    for index, (name, kind) in enumerate(zip(tree.joint_names, tree.joint_types, strict=True)):
        position, velocity = q[tree.position_slice(index)], tree.velocity_slice(index)
        if kind == "spherical":
            rotation = pin.Quaternion(position).matrix()
            turn = np.column_stack([hinge_rates(rotation, axis) for axis in np.eye(3)])
            for row, (axis, angle) in enumerate(zip(HINGES, hinge_angles(rotation), strict=True)):
                joint = read.joints[read.getJointId(f"{name}_{axis}")]
                out[joint.idx_q : joint.idx_q + 2] = np.cos(angle), np.sin(angle)
                rates[joint.idx_v, velocity] = turn[row]
            continue
        joint = read.joints[read.getJointId(name)]
        if kind == "revolute":
            position = np.array((np.cos(position[0]), np.sin(position[0])))
        assert joint.nq == position.size
        out[joint.idx_q : joint.idx_q + joint.nq] = position
        size = velocity.stop - velocity.start
        rates[joint.idx_v : joint.idx_v + size, velocity] = np.eye(size)
    return out, rates


@pytest.mark.parametrize("scene", cases())
def test_poses_and_mass_matrix_are_the_trees(scene):
    mechanism = Mechanism(scene)
    read = pin.buildModelFromXML(urdf_of(mechanism))
    data = read.createData()
    rng = np.random.default_rng(5)
    for _ in range(5):
        q = random_configuration(mechanism.model, rng)
        there, rates = as_read(mechanism, read, q)
        pin.forwardKinematics(read, data, there)
        pin.updateFramePlacements(read, data)
        for name, pose in Placer(mechanism).at(q).links.items():
            found = data.oMf[read.getFrameId(name)]
            assert np.abs(found.homogeneous - pose.homogeneous).max() < TOLERANCE, name
        upper = np.triu(pin.crba(read, data, there))
        inertia = upper + np.triu(upper, 1).T
        closed = (False,) * len(mechanism.closures)
        expected = mechanism.evaluate(q, np.zeros(mechanism.nv), closed).inertia.copy()
        # URDF has no word for rotors.
        expected -= np.diag(mechanism.model.armature)
        # The rates of hinges grow as they come into line; so does the rounding.
        scale = np.linalg.norm(rates, 2) ** 2 * np.abs(expected).max()
        assert np.abs(rates.T @ inertia @ rates - expected).max() < TOLERANCE * scale


@pytest.mark.parametrize("scene", cases())
def test_bodies_and_joint_placements_are_the_trees(scene):
    mechanism = Mechanism(scene)
    read = pin.buildModelFromXML(urdf_of(mechanism))
    own = mechanism.model
    for index, (name, kind) in enumerate(
        zip(mechanism.tree.joint_names, mechanism.tree.joint_types, strict=True)
    ):
        first, last = (f"{name}_x", f"{name}_z") if kind == "spherical" else (name, name)
        place = read.jointPlacements[read.getJointId(first)].homogeneous
        assert np.abs(place - own.jointPlacements[index + 1].homogeneous).max() < TOLERANCE
        body, expected = read.inertias[read.getJointId(last)], own.inertias[index + 1]
        assert np.abs(body.matrix() - expected.matrix()).max() < TOLERANCE
    assert sum(body.mass for body in read.inertias) == pytest.approx(
        sum(link.inertial.mass for link in scene.links), rel=1e-14
    )


def test_closures_that_cannot_be_said_are_named_in_a_comment():
    text = urdf_of(Mechanism(load_scene("five_bar")))
    _, comment = text.split("<!--")
    assert "ground_pin" in comment.split("-->")[0]
    assert "link4" in comment.split("-->")[0]
    assert "closures" not in urdf_of(Mechanism(load_scene("two_link"))).split("-->")[0]


def test_every_link_can_be_seen():
    robot = ElementTree.fromstring(urdf_of(Mechanism(load_scene("spatial_arm"))))
    links = [link for link in robot.findall("link") if link.get("name") != "world"]
    assert len(links) == 7
    assert all(link.find("visual/geometry") is not None for link in links)
    materials = {m.get("name") for m in robot.findall("material")}
    assert {m.get("name") for m in robot.findall("link/visual/material")} <= materials
