# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Positions and rates of the URDF's joints stand for the state that they were made from."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.view import JointStates
from hapticmech_ros.view.urdf import hinge_angles, hinge_rates
from oracles.generator import blank, random_inertial, random_mechanism, unit
from oracles.kinematics import turn


def composed(a: float, b: float, c: float) -> np.ndarray:
    return turn((1, 0, 0), a) @ turn((0, 1, 0), b) @ turn((0, 0, 1), c)


@pytest.mark.parametrize("seed", range(20))
def test_three_hinges_turn_as_far_as_the_ball(seed):
    rng = np.random.default_rng(seed)
    rotation = turn(unit(rng), rng.uniform(-np.pi, np.pi))
    # Products of three exact rotations: a few roundings.
    assert np.abs(composed(*hinge_angles(rotation)) - rotation).max() < 1e-14


@pytest.mark.parametrize("b", [-np.pi / 2, np.pi / 2])
def test_hinges_in_line_still_give_the_rotation_and_turn_as_far_as_they_can(b):
    rotation = composed(0.7, b, -0.4)
    a, found, c = hinge_angles(rotation)
    assert c == 0.0
    assert np.abs(composed(a, found, c) - rotation).max() < 1e-14
    # The link's own z is then the first hinge's axis, or against it; y the second's.
    first, second, third = hinge_rates(composed(0.7, b, 0.0), np.array((0.0, 0.3, 0.5)))
    assert (first, second, third) == pytest.approx((0.5 * np.sign(b), 0.3, 0.0), abs=1e-15)


@pytest.mark.parametrize("seed", range(20))
def test_rates_are_those_of_the_angles(seed):
    """By central differences of Pinocchio's integration: an error of the order of h²."""
    mechanism = Mechanism(scene_from_document(random_mechanism(seed).document))
    joints, rng, step = JointStates(mechanism), np.random.default_rng(seed), 1e-5
    q = pin.randomConfiguration(mechanism.model, -np.ones(mechanism.nq), np.ones(mechanism.nq))
    v = rng.normal(size=mechanism.nv)
    ahead, behind = (joints.at(pin.integrate(mechanism.model, q, s * v)) for s in (step, -step))
    turned = (ahead - behind + np.pi) % (2.0 * np.pi) - np.pi
    found = joints.rates(q, v)
    assert np.abs(turned / (2.0 * step) - found).max(initial=0.0) < 1e-5 * (1.0 + found @ found)


def test_only_what_one_number_can_say_is_listed():
    for seed in range(12):
        mechanism = Mechanism(scene_from_document(random_mechanism(seed).document))
        joints = JointStates(mechanism)
        sizes = {"revolute": 1, "prismatic": 1, "spherical": 3}
        expected = sum(sizes.get(kind, 0) for kind in mechanism.tree.joint_types)
        assert len(joints.names) == expected == joints.at(pin.neutral(mechanism.model)).size


def test_positions_follow_their_names():
    document = blank()
    for index, kind in enumerate(("revolute", "free", "prismatic")):
        document["links"].append(
            {
                "name": f"link{index}",
                "parent": f"link{index - 1}" if index else "world",
                "joint": {"name": f"joint{index}", "type": kind},
                "inertial": random_inertial(np.random.default_rng(1), False),
            }
        )
    document["operational_points"].append({"name": "tip", "link": "link2"})
    joints = JointStates(Mechanism(scene_from_document(document)))
    q = np.array((0.3, 9.0, 9.0, 9.0, 0.0, 0.0, 0.0, 1.0, -0.2))
    assert joints.names == ("joint0", "joint2")
    assert joints.at(q).tolist() == [0.3, -0.2]
    assert joints.rates(q, np.arange(8.0)).tolist() == [0.0, 7.0]
