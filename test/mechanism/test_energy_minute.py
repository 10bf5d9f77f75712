# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A minute at 1 ms by rk4: what no force takes stays, and no branch is changed."""

import numpy as np
import pytest

from benchmarks.accuracy import cases
from hapticmech_ros import load_scene
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.simulation import Simulator
from oracles.planar_linkages import five_bar, five_bar_bent
from oracles.running import total_energy, varied, with_start, wrenches_on
from sampling import sampled

CASES = {case.name: case for case in cases()}
STEPS = 60_000
LOOK = 20


def swinging_five_bar():
    """Return a five-bar as slow as a hand moves: under -9.81 m/s^2 it whirls by 0.07 rad a step."""
    rates = 0.3 * np.array([0.9, -1.0, 1.0, 0.5])
    document = with_start(five_bar(gravity_y=-0.3), five_bar_bent(1.9, 0.9), rates)
    return scene_from_document(document | {"simulation": {"period": 0.001, "integrator": "rk4"}})


def thrown_arm():
    """Return the shipped spatial arm without damping, thrown by its joints under gravity."""
    scene = load_scene("spatial_arm")
    links = tuple(varied(link, joint={"damping": 0.0}) for link in scene.links)
    start = {"v": dict.fromkeys(scene.initial_state.q, 0.5)}
    return varied(scene, links=links, initial_state=start).stepped(integrator="rk4")


SCENES = {
    "pendulum": lambda: CASES["pendulum"].scene,
    "n_four_bar_2": lambda: CASES["n_four_bar_2"].scene,
    "bricard": lambda: CASES["bricard"].scene,
    "five_bar": swinging_five_bar,
    "spatial_arm": thrown_arm,
}


@pytest.mark.parametrize("name", sampled(SCENES, every=4))
def test_energy_stays_for_a_minute(name):
    sim = Simulator(SCENES[name]())
    assert (sim.period, sim.scene.simulation.integrator) == (0.001, "rk4")
    state, nothing = sim.initial_state(), wrenches_on(sim)
    rank, first = sim.evaluate(state).space.rank, total_energy(sim, state)
    kinetic, off, closure_error = 0.0, 0.0, 0.0
    for step in range(STEPS):
        state = sim.step(state, nothing)
        closure_error = max(closure_error, state.closure_error)
        if step % LOOK == 0:
            kinetic = max(kinetic, sim.mechanism.energy(state.q, state.v)[0])
            off = max(off, abs(total_energy(sim, state) - first))
    assert kinetic > 0.0
    assert off / kinetic < 1e-8, f"{off} J of {kinetic} J"
    assert closure_error < 1e-10
    assert sim.evaluate(state).space.rank == rank
