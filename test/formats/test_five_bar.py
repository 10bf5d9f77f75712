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
    theirs, ours = Simulator(yaml_scene()), Simulator(scene)
    assert [link.name for link in scene.links] == ["link1", "link2", "link3", "link4"]
    pushes = np.array([[-0.5, 0.0, 0.0, 0.0, 0.0, -0.0025]])
    found = [sim.run(sim.initial_state(), 10_000, pushes, 100) for sim in (theirs, ours)]
    # SDF counts joints from where the file draws them.
    zero = START if kind == "sdf" else np.zeros(4)
    assert np.abs(found[0].q - found[1].q - zero).max() < SAME
    assert np.abs(found[0].v - found[1].v).max() < SAME
    assert np.ptp(found[0].q, axis=0).min() > 0.1


@pytest.mark.parametrize("kind", ["urdf", "xml", "sdf"])
def test_inertia_spectrum_and_directions_are_the_same(tmp_path, kind):
    sims = [Simulator(yaml_scene()), Simulator(load_scene(written(tmp_path, kind)))]
    moved = sims[0].run(sims[0].initial_state(), 3000, None, 500)
    zero = np.array(START) if kind == "sdf" else np.zeros(4)
    for q, v in zip(moved.q, moved.v, strict=True):
        felt = []
        for sim, at in zip(sims, (q, q - zero), strict=True):
            terms = sim.mechanism.evaluate(at, v, sim.mechanism.initially_active)
            felt.append(Analyser(sim.mechanism).analyse(terms))
        one, other = felt
        assert (
            np.abs(one.inverse_inertia - other.inverse_inertia).max()
            < SAME * np.abs(one.inverse_inertia).max()
        )
        assert np.abs(one.spectrum.s - other.spectrum.s).max() < SAME
        assert one.rank == other.rank
