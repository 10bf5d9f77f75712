# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A platform on six legs: free in all directions, heavy by its legs, rigid once they are locked."""

import numpy as np

from hapticmech_ros import Mechanism, Simulator, analyse, load_scene
from hapticmech_ros.mechanism.projection import consistent_initial_state
from hapticmech_ros.mechanism.redundancy import redundancy
from hapticmech_ros.operational.observation import rigid_count
from hapticmech_ros.scene import document_of, scene_from_document
from oracles import closed_form
from oracles.jacobians import Jacobians

NAME = "stewart_platform"


def test_the_hand_turns_it_too(run):
    assert np.ptp(run.of(lambda s: s.mechanism.q[5])) > 0.1


def test_springs_carry_the_weight(run):
    """Left alone it stays level, at its height: rests are written in tenths of a micrometre."""
    simulator = Simulator(load_scene("stewart_platform"))
    start = simulator.initial_state()
    end = simulator.run(start, 3000).end
    assert np.abs(end.q - start.q).max() < 1e-6
    early = run.of(lambda s: np.abs(s.output.device).max())[run.time < 0.25]
    assert early.max() < 1e-4


def test_springs_bring_it_back():
    """In a displaced rest hand, springs and weights do no work in any direction that is free."""
    scene = load_scene("stewart_platform")
    simulator, document = Simulator(scene), document_of(scene)
    push = np.array([[0.3, -0.2, 0.5, 0.01, 0.02, -0.03]])
    end = simulator.run(simulator.initial_state(), 12000, push).end
    oracle, spring = Jacobians(document, end.q), scene.links[3].joint
    # Rates are six of the platform, and three of each leg, the last one along it.
    along = np.arange(8, 24, 3)
    force = oracle.momenta()[:3].T @ document["gravity"]
    force[along] += spring.stiffness * (spring.rest - end.q[along + 1])
    force += oracle.of_frame(document["operational_points"][0]).T @ push[0]
    free = closed_form.null_space(oracle.closing_rows(), force.size)
    assert np.abs(end.v).max() < 1e-6
    # What dampers of 2 N s/m do at such speeds is below the tolerance.
    assert np.abs(free.T @ force).max() < 1e-6


def test_locked_legs_make_it_rigid():
    """Six legs of fixed length hold all six directions; 18 freedoms are left and 18 rows."""
    document = document_of(load_scene("stewart_platform"))
    for link in document["links"]:
        if link["joint"]["type"] == "prismatic":
            link["joint"]["locked"] = True
    scene = scene_from_document(document)
    mechanism = Mechanism(scene)
    q, _ = consistent_initial_state(mechanism)
    found = analyse(mechanism, q)
    assert (mechanism.nv, found.rank) == (18, 0)
    assert found.constraint_wrenches.shape == (6, 6)
    assert rigid_count(found.spectrum.s, scene.perception) == 6
    assert redundancy(mechanism, q, mechanism.initially_active).mobility == 0
