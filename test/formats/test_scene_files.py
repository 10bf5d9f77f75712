# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scene files beside a model: its names stand for what became of them; the scene goes before."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

from formats.imports import Read, beside, saved
from formats.test_urdf import inertial_of
from hapticmech_ros import load_scene
from hapticmech_ros.loading.loader import copy_scene
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.model import authored_state

ROOT = Path(__file__).resolve().parents[2]
# Rounding of transforms of a few metres, of angles taken from rotations and put in again.
SAME = 1e-13
# A post in the world, an arm of three: names as files have them, two with a frame of their own.
ARM = """<robot name="an arm"><link name="base link"/><link name="post"/><link name="upper arm"/>
    <link name="fore-arm"/><link name="hand"/><link name="tool"/>
    <joint name="to post" type="fixed"><parent link="base link"/><child link="post"/>
    <origin xyz="1 2 3" rpy="0.1 0.2 0.3"/></joint>
    <joint name="shoulder pan" type="revolute"><parent link="post"/><child link="upper arm"/>
    <origin xyz="0 0 1" rpy="0.3 0 0"/><axis xyz="0 1 0"/><limit lower="-1" upper="2"/>
    <dynamics damping="0.5" friction="0.2"/></joint>
    <joint name="elbow" type="revolute"><parent link="upper arm"/><child link="fore-arm"/>
    <origin xyz="1 0 0" rpy="0 0.2 0"/><axis xyz="0 1 1"/><limit lower="-2" upper="1"/></joint>
    <joint name="wrist" type="continuous"><parent link="fore-arm"/><child link="hand"/>
    <origin xyz="1 0 0"/><axis xyz="1 0 0"/></joint>
    <joint name="grip" type="fixed"><parent link="hand"/><child link="tool"/>
    <origin xyz="0 0.1 0.2" rpy="0.5 0 0"/></joint></robot>"""


@pytest.fixture
def scene_of(tmp_path):
    text = ARM
    for seed, name in enumerate(("upper arm", "fore-arm", "hand")):
        text = text.replace(
            f'<link name="{name}"/>', f'<link name="{name}">{inertial_of(seed)}</link>'
        )
    path = saved(tmp_path, "arm.urdf", text)
    loaded = partial(beside, path)
    loaded.read = Read(path)
    return loaded


def joints_of(scene):
    return {link.joint.name: link.joint for link in scene.links}


@pytest.mark.parametrize("body", ["post", "base link", "upper arm", "fore-arm", "tool", "world"])
def test_frames_of_the_file_may_be_closed_sprung_and_held(scene_of, body):
    """The post is part of the world by then: its frame is where the file has it."""
    at = "{link: %s, origin: {xyz: [0.1, 0.2, 0.3], rpy: [0.3, 0.2, 0.1]}}"
    other = "tool" if body != "tool" else "post"
    said = (
        f"closures: [{{name: c, kind: spherical, a: {at % body}, b: {{link: {other}}}}}]\n"
        f"springs: [{{name: s, a: {{link: {other}}}, b: {at % body}, stiffness: 7.0}}]\n"
    )
    if body not in ("post", "base link", "world"):
        said += f"operational_points: [{{name: p, {(at % body)[1:-1]}}}]\n"
    scene = scene_of(said)
    mechanism, read = Mechanism(scene), scene_of.read
    q = np.array((0.3, -0.4, 0.5))
    local = pin.SE3(pin.rpy.rpyToMatrix(0.3, 0.2, 0.1), np.array((0.1, 0.2, 0.3)))
    place, there = read.pose(body, q) * local, read.pose(other, q)
    terms = mechanism.evaluate(q, np.zeros(3), (True,))
    gap = place.translation - there.translation
    assert abs(np.linalg.norm(terms.closure_residual) - np.linalg.norm(gap)) < 10 * SAME
    # A spring of no length pulls along the closure's rows: its force is Wᵀ of its gap.
    pulled = 7.0 * terms.closure_jacobian.T @ terms.closure_residual
    stopped = mechanism.evaluate(np.array((0.3, -0.4, 0.5)), np.zeros(3), (False,)).passive_force
    assert np.abs(stopped + pulled).max() < 1e-11 * np.abs(pulled).max()
    if "operational_points" in said:
        assert np.abs(terms.points[0].pose.homogeneous - place.homogeneous).max() < 10 * SAME


def test_a_scene_starts_where_it_says_by_the_files_names(scene_of):
    scene = scene_of("initial_state: {q: {shoulder pan: 0.3, elbow: -0.2}, v: {wrist: 2.0}}\n")
    q, v = authored_state(scene, Mechanism(scene).tree)
    assert (q.tolist(), v.tolist()) == ([0.3, -0.2, 0.0], [0.0, 0.0, 2.0])


def test_what_a_scene_says_of_a_joint_goes_before_the_file(scene_of):
    model = """
  file: arm.urdf
  joints:
    shoulder pan: {damping: 0.7, stiffness: 3.0, rest: 0.1, limits: null}
    elbow: {effort: 0.3, friction: 0.1, friction_speed: 0.5,
      limits: {lower: -0.5, upper: 0.5, stiffness: 9.0}}
    wrist: {limits: {lower: -0.1, upper: 0.2, stiffness: 8.0, damping: 0.1}}
"""
    joints = joints_of(scene_of("", model))
    one = joints["shoulder_pan"]
    assert (one.damping, one.friction, one.stiffness, one.rest) == (0.7, 0.2, 3.0, 0.1)
    assert one.limits is None
    two = joints["elbow"]
    assert (two.effort, two.friction, two.friction_speed) == (0.3, 0.1, 0.5)
    assert (two.limits.lower, two.limits.upper, two.limits.stiffness) == (-0.5, 0.5, 9.0)
    assert two.limits.damping == 0.0
    assert joints["wrist"].limits.stiffness == 8.0


def test_a_locked_joint_is_no_degree_of_freedom_and_is_where_the_scene_starts(scene_of):
    model = "{file: arm.urdf, joints: {elbow: {locked: true}}}"
    scene = scene_of("initial_state: {q: {elbow: 0.4}}\n", model)
    mechanism = Mechanism(scene)
    assert mechanism.tree.joint_names == ("shoulder_pan", "wrist")
    q = np.array((0.3, 0.5))
    full = scene_of.read.inertia(np.array((0.3, 0.4, 0.5)))[np.ix_((0, 2), (0, 2))]
    terms = mechanism.evaluate(q, np.zeros(2), ())
    assert np.abs(terms.inertia - full).max() < 1e-12 * np.abs(full).max()


def test_a_free_base_is_no_longer_the_world(scene_of, tmp_path):
    text = (tmp_path / "arm.urdf").read_text()
    base = f'<link name="base link">{inertial_of(7)}</link>'
    (tmp_path / "arm.urdf").write_text(text.replace('<link name="base link"/>', base))
    scene = scene_of("", "{file: arm.urdf, base: free}")
    assert (scene.links[0].name, scene.links[0].joint.type) == ("base_link", "free")
    assert Mechanism(scene).nv == 9


@pytest.mark.parametrize("name", ["pantograph.yaml", "pantograph.urdf"])
def test_a_scene_with_a_model_can_be_written_out(tmp_path, name):
    """Into another folder, without its model: the same scene to the bit."""
    path, copy = ROOT / "examples" / name, tmp_path / "copy.yaml"
    copy_scene(path, copy, ["device.mass=0.2"], expanded=True)
    assert "model" not in yaml.safe_load(copy.read_text(encoding="utf-8"))
    assert load_scene(copy) == load_scene(path, changes=["device.mass=0.2"])
