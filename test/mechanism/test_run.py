# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Many steps in one call: the same states as steps one by one."""

import numpy as np
import pytest

from hapticmech_ros import load_scene
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.simulation import Simulator
from oracles.generator import closed_chain, random_mechanism
from oracles.running import with_start, wrenches_on
from sampling import sampled

SAMPLES = [random_mechanism(seed, planar) for seed in range(4) for planar in (False, True)]
SAMPLES += [closed_chain(seed, kind) for seed, kind in enumerate(("weld", "revolute"))]
SCENES = [load_scene(name) for name in shipped_scenes()]
SCENES += [scene_from_document(with_start(s.document, s.q, 0.3 * s.v)) for s in SAMPLES]


def stepped(simulator, steps, wrenches):
    states = [simulator.initial_state()]
    for _ in range(steps):
        states.append(simulator.step(states[-1], wrenches))
    return states


@pytest.mark.parametrize("scene", sampled(SCENES, every=3), ids=lambda scene: scene.name)
def test_a_run_is_its_steps(scene):
    """Samples, the end, and what was done on the way, whatever the distance of samples."""
    simulator = Simulator(scene)
    wrenches = 0.2 * np.ones((len(simulator.mechanism.point_names), 6))
    states = stepped(simulator, 20, wrenches)
    again = Simulator(scene)
    for every in (1, 7):
        found = again.run(again.initial_state(), 20, wrenches, every)
        samples = states[::every]
        assert found.time == pytest.approx([state.time for state in samples], abs=1e-15)
        assert np.allclose(found.q, [state.q for state in samples], rtol=0.0, atol=1e-11)
        assert np.allclose(found.v, [state.v for state in samples], rtol=0.0, atol=1e-9)
        end, last = found.end, states[-1]
        assert np.allclose(end.q, last.q, rtol=0.0, atol=1e-11)
        assert end.active == last.active
        assert end.account.work_in == pytest.approx(last.account.work_in, rel=1e-9, abs=1e-12)
        assert end.account.damping_loss == pytest.approx(last.account.damping_loss, abs=1e-10)
        assert not end.q.flags.writeable


def test_a_loop_latches_in_a_run():
    """Closures that come near close in the step in which they would have one by one."""
    scene = load_scene("four_bar_closing")
    simulator, again = Simulator(scene), Simulator(scene)
    # The scene's hand, held.
    wrenches = wrenches_on(simulator, handle=(-0.5, 0.0, 0.0, 0.0, 0.0, -0.0025))
    state, taken = simulator.initial_state(), 0
    while not all(state.active) and taken < 3000:
        state = simulator.step(state, wrenches)
        taken += 1
    assert all(state.active), "the scene's loop never came near"
    assert not all(again.run(again.initial_state(), taken - 1, wrenches).end.active)
    end = again.run(again.initial_state(), taken, wrenches).end
    assert end.active == state.active
    assert end.account.latch_loss == pytest.approx(state.account.latch_loss, rel=1e-6)


def test_no_steps():
    """A run of no steps has its start as its one sample."""
    simulator = Simulator(load_scene("two_link"))
    start = simulator.initial_state()
    found = simulator.run(start, 0)
    assert found.end is start
    assert found.q.shape == (1, simulator.mechanism.nq)


@pytest.mark.parametrize(("steps", "every"), [(-1, 1), (3, 0), (3, -2)])
def test_refused(steps, every):
    """The offending value is named."""
    simulator = Simulator(load_scene("two_link"))
    with pytest.raises(InvalidInputError, match=str(min(steps, every))):
        simulator.run(simulator.initial_state(), steps, every=every)
    with pytest.raises(InvalidInputError, match="wrenches"):
        simulator.run(simulator.initial_state(), 1, np.zeros((7, 6)))
