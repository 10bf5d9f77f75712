# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Felt impedance over a graph: what is compared where samples are missing."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.analysis import transparency
from hapticmech_ros.analysis.impedance import amplitudes, mechanism_twists
from hapticmech_ros.analysis.touch import Setup
from hapticmech_ros.analysis.transparency import PUSH_N, FeelGraphError, _without_gaps


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


@pytest.mark.parametrize("swapped", [(2000, 2001), (2000, 2000), (4000, 10)])
def test_samples_out_of_order_or_twice_are_refused(monkeypatch, swapped):
    """Fitted to the pushes of other times they would give any impedance."""
    stamps = np.arange(6000) * 1_000_000

    class Bag:
        topics = ("/device/state",)

        def __init__(self, path):
            assert path == Path("bag")

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def serialized(self, name):
            assert name == "/device/state"
            return [(name, 0, number) for number in order]

    def sample(kind, number):
        measured = SimpleNamespace(hand_wrench=np.full(6, 0.1), twist=np.zeros(6))
        return SimpleNamespace(stamp_ns=stamps[number], sample=measured)

    monkeypatch.setattr(transparency, "BagReader", Bag)
    monkeypatch.setattr(transparency, "decode", lambda number: number)
    monkeypatch.setattr(transparency, "read", sample)
    order = list(range(6000))
    times, _, _ = transparency._samples(Path("bag"), 1e-3)
    assert len(times) == 6000
    first, second = swapped
    order.insert(first, second)
    with pytest.raises(FeelGraphError, match="twice, or out of order"):
        transparency._samples(Path("bag"), 1e-3)
