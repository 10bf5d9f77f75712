# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A platform on six legs: free in all directions, heavy by its legs, rigid once they are locked."""

import numpy as np

from hapticmech_ros import Mechanism, Simulator, analyse, load_scene
from hapticmech_ros.mechanism.projection import consistent_initial_state
from hapticmech_ros.mechanism.redundancy import redundancy
from hapticmech_ros.operational.observation import rigid_count
from hapticmech_ros.scene import document_of, scene_from_document

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
