"""Felt impedance over a graph: what is compared where samples are missing."""

import numpy as np

from hapticmech_ros import Session, load_scene
from hapticmech_ros.analysis.impedance import amplitudes, mechanism_twists
from hapticmech_ros.analysis.over_graph import PUSH_N, _without_gaps
from hapticmech_ros.analysis.touch import Setup


def test_a_missing_sample_is_the_one_before_it():
    times = np.array([0.0, 0.001, 0.0040001, 0.005])
    forces = np.arange(24.0).reshape(4, 6)
    every, held = _without_gaps(times, forces, 0.001)
    assert np.allclose(every, 0.001 * np.arange(6))
    assert np.array_equal(held, forces[[0, 1, 1, 1, 2, 3]])


def test_the_mechanism_alone_is_its_inverse_inertia_for_a_small_push():
    """X at the start, as far as the push leaves the mechanism where it is."""
    scene = load_scene("two_link")
    times = scene.simulation.period * np.arange(2000)
    push = PUSH_N * 1e-3 * np.cos(2.0 * np.pi * 20.0 * times)
    pushes = np.zeros((2000, 6))
    pushes[:, 0] = push
    twists = mechanism_twists(Setup(scene, "", 1), pushes)
    moved, pushed = (amplitudes(times, one, [20.0])[0] for one in (twists[:, 0], push))
    x = Session(scene).tick().analysis.inverse_inertia[0, 0]
    # Of damped joints, and pushed in steps of a period: within some percent.
    assert abs(moved / pushed * 2.0j * np.pi * 20.0 / x - 1.0) < 0.1
