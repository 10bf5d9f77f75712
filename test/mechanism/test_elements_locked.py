# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Locked joints: fixed where the scene starts; and joints that move no mass."""

import copy

import numpy as np
import pytest

from hapticmech_ros.mechanism.inertia import SingularInertiaError, cholesky_of_upper
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.model import authored_state
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.view.placement import Placer, moving_frames
from hapticmech_ros.view.urdf import JointStates, urdf_of
from hapticmech_ros.wire.state import coordinate_names
from oracles.generator import RATE_SIZE, random_mechanism
from oracles.kinematics import POSITION_SIZE, link_poses, origin_in
from oracles.planar_linkages import INERTIAS, LENGTHS, MASSES, chain
from oracles.posed import apart
from oracles.running import with_start

NOTHING = {"mass": 0.0, "inertia": {"ixx": 0.0, "iyy": 0.0, "izz": 0.0}}
# The second of five links, so that one parent and one child move.
LOCKED = 1
CASES = [(seed, planar) for seed in range(8) for planar in (False, True)]


def part(document, sizes):
    """Return where the locked joint is in q or v of the whole tree."""
    kinds = [link["joint"]["type"] for link in document["links"]]
    start = sum(sizes[kind] for kind in kinds[:LOCKED])
    return slice(start, start + sizes[kinds[LOCKED]])


def locked_and_fixed(seed, planar):
    """Return a scene with a locked joint, one with a fixed joint in its stead, and (q, v)."""
    base = random_mechanism(seed, planar, closed=False)
    locked, fixed = copy.deepcopy(base.document), copy.deepcopy(base.document)
    # A fixed link may not be the world's.
    locked["links"][LOCKED]["parent"] = fixed["links"][LOCKED]["parent"] = "link0"
    poses = link_poses(locked, base.q)
    locked["links"][LOCKED]["joint"]["locked"] = True
    v = base.v.copy()
    v[part(locked, RATE_SIZE)] = 0.0
    origin = origin_in(poses["link0"], poses[f"link{LOCKED}"])
    fixed["links"][LOCKED]["joint"] = {"name": "joint1", "type": "fixed", "origin": origin}
    q = np.delete(base.q, part(locked, POSITION_SIZE))
    rates = np.delete(base.v, part(locked, RATE_SIZE))
    return with_start(locked, base.q, v), with_start(fixed, q, rates), q, rates


@pytest.mark.parametrize(("seed", "planar"), CASES)
def test_a_locked_joint_is_a_fixed_one(seed, planar):
    locked, fixed, q, v = locked_and_fixed(seed, planar)
    mechanism, other = (Mechanism(scene_from_document(document)) for document in (locked, fixed))
    assert "joint1" not in mechanism.tree.joint_names
    assert mechanism.tree.joint_names == other.tree.joint_names
    assert mechanism.tree.joint_types == other.tree.joint_types
    for found, expected in zip(
        authored_state(mechanism.scene, mechanism.tree), (q, v), strict=True
    ):
        assert np.abs(found - expected).max() < 1e-15
    terms, expected = mechanism.evaluate(q, v, ()), other.evaluate(q, v, ())
    # Origins are written as rpy: some roundings more than the same transform as numbers.
    square = float(v @ v)
    assert apart(terms.inertia, expected.inertia) < 1e-12
    assert apart(terms.bias_force, expected.bias_force) < 1e-11
    force = np.cos(np.arange(v.size))
    assert apart(terms.acceleration(force)[0], expected.acceleration(force)[0]) < 1e-10
    for one, two in zip(terms.points, expected.points, strict=True):
        assert apart(one.pose.homogeneous, two.pose.homogeneous) < 1e-13
        assert apart(one.jacobian, two.jacobian) < 1e-12
        assert apart(one.drift, two.drift, square) < 1e-11


@pytest.mark.parametrize(("seed", "planar"), CASES[::3])
def test_views_take_a_locked_joint(seed, planar):
    locked, fixed, q, _ = locked_and_fixed(seed, planar)
    mechanism, other = (Mechanism(scene_from_document(document)) for document in (locked, fixed))
    placement, expected = Placer(mechanism).at(q), Placer(other).at(q)
    for name, pose in placement.links.items():
        assert np.abs(pose.homogeneous - expected.links[name].homogeneous).max() < 1e-13
    assert coordinate_names(mechanism) == coordinate_names(other)
    assert JointStates(mechanism).names == JointStates(other).names
    moving = {frame.child for frame in moving_frames(mechanism.scene, placement)}
    assert f"link{LOCKED}" in moving
    assert '<joint name="joint1" type="fixed">' in urdf_of(mechanism)


def test_a_locked_joint_to_the_world_and_what_acts_in_it_do_nothing():
    document = chain(LENGTHS, MASSES, INERTIAS)
    joint = document["links"][0]["joint"]
    joint |= {"locked": True, "stiffness": 9.0, "effort": 3.0, "damping": 1.0, "friction": 1.0}
    name = joint["name"]
    document["initial_state"] = {"q": {name: 0.7}, "v": {name: 0.0}}
    mechanism = Mechanism(scene_from_document(document))
    assert mechanism.nv == len(document["links"]) - 1
    terms = mechanism.evaluate(np.zeros(mechanism.nv), np.ones(mechanism.nv), ())
    assert not terms.effort.any()
    assert not terms.passive_force.any()
    rotation = mechanism.frame_pose(np.zeros(mechanism.nv), document["links"][0]["name"]).rotation
    assert np.arctan2(rotation[1, 0], rotation[0, 0]) == pytest.approx(0.7, rel=1e-15)


def test_a_joint_that_moves_no_mass_is_named_when_the_mechanism_is_built():
    document = chain(LENGTHS, MASSES, INERTIAS)
    document["links"][-1]["inertial"] = NOTHING
    document["operational_points"] = document["operational_points"][:2]
    joint, link = document["links"][-1]["joint"]["name"], document["links"][-1]["name"]
    with pytest.raises(SingularInertiaError) as caught:
        Mechanism(scene_from_document(document))
    assert str(caught.value).startswith(f"joint '{joint}' moves no mass: give link '{link}'")
    assert str(caught.value).endswith("or lock the joint")
    assert caught.value.rate == 3
    # What it says helps.
    document["links"][-1]["joint"]["locked"] = True
    mechanism = Mechanism(scene_from_document(document))
    assert np.linalg.eigvalsh(mechanism.evaluate(np.ones(3), np.zeros(3), ()).inertia)[0] > 0.0


def test_a_massless_link_that_carries_mass_is_no_problem():
    document = chain(LENGTHS, MASSES, INERTIAS)
    document["links"][0]["inertial"] = NOTHING
    document["operational_points"] = document["operational_points"][2:]
    mechanism = Mechanism(scene_from_document(document))
    assert np.linalg.eigvalsh(mechanism.evaluate(np.zeros(4), np.zeros(4), ()).inertia)[0] > 0.0


def test_a_point_mass_on_the_axis_is_not_moved_by_it():
    document = chain(LENGTHS, MASSES, INERTIAS)
    document["links"][-1]["inertial"] = {
        "mass": 1.0,
        "com": [0.0, 0.0, 0.1],
        "inertia": {"ixx": 1e-3, "iyy": 1e-3, "izz": 0.0},
    }
    document["operational_points"] = document["operational_points"][:2]
    with pytest.raises(SingularInertiaError, match="moves no mass"):
        Mechanism(scene_from_document(document))
    document["links"][-1]["inertial"]["inertia"]["izz"] = 1e-9
    Mechanism(scene_from_document(document))


def test_joints_that_move_the_same_mass_are_named_at_the_step():
    # Two hinges on one axis: each moves the body, but both do it in the same way.
    document = chain(LENGTHS, MASSES, INERTIAS)
    document["links"][1]["joint"]["origin"] = {"xyz": [0.0, 0.0, 0.0]}
    document["links"][0]["inertial"] = NOTHING
    document["operational_points"] = document["operational_points"][2:]
    name = document["links"][1]["joint"]["name"]
    mechanism = Mechanism(scene_from_document(document))

    def evaluate():
        # Rounding decides whether a single one fails.
        for angle in np.linspace(0.0, 1.0, 20):
            mechanism.evaluate(np.full(4, angle), np.zeros(4), ())

    with pytest.raises(SingularInertiaError, match=f"joint '{name}' moves no mass that others"):
        evaluate()


def test_a_matrix_alone_has_no_names():
    with pytest.raises(SingularInertiaError, match="degree of freedom 1") as caught:
        cholesky_of_upper(np.array([[1.0, 2.0], [0.0, 1.0]]))
    assert caught.value.rate == 1
