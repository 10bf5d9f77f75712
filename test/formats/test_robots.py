# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Robots that people have: each weighs what it weighs in Pinocchio, or is refused by a rule."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from formats.imports import Read, in_order_of, mass_matrix, random_state
from formats.robots import robot, robot_files
from hapticmech_ros.errors import SceneError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.simulation import Simulator

# Of the largest entry: rounding along a chain of thirty joints, and of roll, pitch and yaw.
SAME = 1e-12
REFUSED = {
    "alex_description/urdf/alex_psyonic_hands.urdf": "no such joint",
    "ur_description/urdf/ur3.urdf": "there must be one at least",
    **dict.fromkeys(
        (
            "romeo_description/urdf/romeo_laas_small.urdf",
            "tiago_description/robots/tiago.urdf",
            "tiago_description/robots/tiago_dual.urdf",
            "tiago_description/robots/tiago_no_hand.urdf",
        ),
        "principal moments must not be negative",
    ),
}
# Both joints have their stops at 0.
LOCKED = tuple(
    f"double_pendulum_description/urdf/double_pendulum{end}.urdf" for end in ("", "_simple")
)
# Notes that say that an inertia is not as written.
OTHERWISE = {"inertia of no body", "inertia without mass"}
ROBOTS = sorted(robot_files(".urdf")) or ["any"]


@pytest.mark.parametrize("name", [name for name in ROBOTS if name not in {*REFUSED, *LOCKED}])
def test_robots_weigh_the_same_as_in_pinocchio(name):
    path = robot(".urdf", name)
    ours = Read(path, free_base=True)
    bases = [link.joint.name for link in ours.scene.links if link.joint.type == "free"]
    # A root that is called world stays where it is.
    root = (pin.JointModelFreeFlyer(),) if bases else ()
    theirs = pin.buildModelFromUrdf(str(path), *root)
    assert ours.model.nv == theirs.nv
    if bases:
        (ours.imported.joints["root_joint"],) = bases
    rates, convert = in_order_of(ours, theirs, list(theirs.names)[1:])
    data = theirs.createData()
    q, _ = random_state(theirs, np.random.default_rng(1))
    full = mass_matrix(theirs, data, q)
    inertia = ours.inertia(convert(q))[np.ix_(rates, rates)]
    error = np.abs(inertia - full).max() / np.abs(full).max()
    mended = OTHERWISE & ours.notes.keys()
    assert error <= SAME or mended
    # Mended or not, it is the same mechanism: what was raised is small, or of no mass.
    assert error < 0.05


@pytest.mark.parametrize("name", LOCKED)
def test_robots_whose_stops_leave_no_travel_are_one_body(name):
    path = robot(".urdf", name)
    with pytest.raises(SceneError, match=r"lower = upper\), are joint1, joint2"):
        Read(path)
    theirs = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    expected = mass_matrix(theirs, theirs.createData(), pin.neutral(theirs))[:6, :6]
    ours = Read(path, free_base=True)
    found = ours.inertia(pin.neutral(ours.model))
    assert np.abs(found - expected).max() < SAME


@pytest.mark.parametrize("name", REFUSED)
def test_robots_that_are_none_are_refused_by_a_rule(name):
    with pytest.raises(SceneError, match=REFUSED[name]):
        Read(robot(".urdf", name), free_base=True)


@pytest.mark.parametrize(
    ("name", "rates"),
    [
        ("cassie_reduced.sdf", 23),
        ("cassie_simple.sdf", 27),
        ("cassie_v2.sdf", 28),
        ("cassie_wo_gearbox_spring.sdf", 27),
    ],
)
def test_cassies_loops_are_closed_as_she_is_drawn(name, rates):
    """Closed to rounding at a start that is the drawn one to the six digits of her file."""
    ours = Read(robot(".sdf", f"cassie_description/robots/{name}"), free_base=True)
    mechanism = Mechanism(ours.scene)
    assert mechanism.nv == rates
    assert len(ours.scene.closures) == 4
    start = Simulator(ours.scene).initial_state().q
    assert mechanism.closing_terms(start, mechanism.initially_active).error < SAME
    drawn = pin.neutral(ours.model)
    assert np.abs(pin.difference(ours.model, drawn, start)).max() < 1e-6


def test_cassies_springs_are_slides_in_loops_and_her_gearboxes_couplings():
    """Other joints of these loops are cut; as she is drawn they are closed."""
    ours = Read(robot(".sdf", "cassie_description/robots/cassie.sdf"), free_base=True)
    assert ours.written("left-shin-spring-joint").type == "prismatic"
    kinds = [one.kind for one in ours.scene.closures]
    assert sorted(kinds) == ["revolute"] * 4 + ["spherical"] * 2
    mechanism, neutral = Mechanism(ours.scene), pin.neutral(ours.model)
    assert mechanism.closing_terms(neutral, mechanism.initially_active).error < SAME
    couplings = ours.imported.document["couplings"]
    assert len(couplings) == 10
