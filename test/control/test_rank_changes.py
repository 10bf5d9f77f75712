# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Directions that become constrained, and free again: no step of the force, and no energy."""

import numpy as np
import pytest

from hapticmech_ros import Session, load_scene

# Samples on either side of a change.
AROUND = 30
# s, scene: each passes singular positions, or latches.
RUNS = {"five_bar": 3.0, "four_bar_closing": 2.2, "spatial_arm": 5.0}


@pytest.mark.parametrize("name", RUNS)
def test_a_change_of_the_rank_is_no_bump_and_brings_no_energy(name):
    session = Session(load_scene(name))
    run = session.run(round(RUNS[name] / session.period))
    forces, torques = np.split(run["device_applied"], 2, axis=1)
    injected, changes = run["injected"], np.flatnonzero(np.diff(run["count"]))
    assert len(changes) >= (2 if name == "spatial_arm" else 1)
    for change in changes:
        near = slice(change - AROUND, change + AROUND)
        size = np.linalg.norm(forces[near], axis=1)
        steps = np.linalg.norm(np.diff(forces[near], axis=0), axis=1)
        # A twentieth of the force then present, as was promised.
        assert (steps <= 0.05 * size[:-1]).all()
        turns = np.linalg.norm(np.diff(torques[near], axis=0), axis=1)
        assert turns.max() < 0.01
        # Of some 20 to 60 mJ that the hand puts in; what is taken away is none brought.
        assert injected[change + AROUND] - injected[change - AROUND] < 1e-5
