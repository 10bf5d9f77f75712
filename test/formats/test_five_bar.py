# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The same five-bar as YAML, URDF, MJCF and SDF feels the same and moves alike."""

import numpy as np
import pytest

from formats.five_bars import START, written
from hapticmech_ros import load_scene
from hapticmech_ros.operational import Analyser
from hapticmech_ros.scene import document_of, scene_from_document
from hapticmech_ros.simulation import Simulator

SAME = 1e-9


def yaml_scene():
    document = document_of(load_scene("five_bar"))
    document["simulation"] |= {"integrator": "rk4"}
    return scene_from_document(document)


@pytest.mark.parametrize("kind", ["urdf", "xml", "sdf"])
def test_the_same_is_felt_and_moves_alike(tmp_path, kind):
    scene = load_scene(written(tmp_path, kind))
    assert [link.name for link in scene.links] == ["link1", "link2", "link3", "link4"]
    sims = [Simulator(yaml_scene()), Simulator(scene)]
    pushes = np.array([[-0.5, 0.0, 0.0, 0.0, 0.0, -0.0025]])
    theirs, ours = (sim.run(sim.initial_state(), 10_000, pushes, 100) for sim in sims)
    # SDF counts joints from where the file draws them.
    zero = np.array(START) if kind == "sdf" else np.zeros(4)
    assert np.abs(theirs.q - ours.q - zero).max() < SAME
    assert np.abs(theirs.v - ours.v).max() < SAME
    assert np.ptp(theirs.q, axis=0).min() > 0.1
    for q, v in zip(theirs.q[::15], theirs.v[::15], strict=True):
        one, other = (
            Analyser(sim.mechanism).analyse(sim.mechanism.evaluate(at, v, (True,)))
            for sim, at in zip(sims, (q, q - zero), strict=True)
        )
        error = np.abs(one.inverse_inertia - other.inverse_inertia).max()
        assert error < SAME * np.abs(one.inverse_inertia).max()
        assert np.abs(one.spectrum.s - other.spectrum.s).max() < SAME
        assert one.rank == other.rank
