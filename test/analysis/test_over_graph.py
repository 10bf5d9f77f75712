# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Felt impedance over a graph: what is compared where samples are missing."""

import numpy as np
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.analysis.impedance import amplitudes, mechanism_twists
from hapticmech_ros.analysis.touch import Setup
from hapticmech_ros.analysis.transparency import (
    PUSH_N,
    FeelGraphError,
    _without_gaps,
    from_the_push_on,
    transparency,
)


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
def test_samples_out_of_order_or_twice_are_refused(swapped):
    """Fitted to the pushes of other times they would give any impedance."""
    order, (first, second) = list(range(6000)), swapped
    pushes, still = np.full((6001, 6), 0.1), np.zeros((6001, 6))
    times, _, _ = from_the_push_on(1e-3 * np.array(order), pushes[1:], still[1:], 1e-3)
    assert len(times) == 6000
    order.insert(first, second)
    with pytest.raises(FeelGraphError, match="twice, or out of order"):
        from_the_push_on(1e-3 * np.array(order), pushes, still, 1e-3)


@pytest.mark.parametrize(
    ("push", "period", "rule"),
    [(0.0, 2e-3, "no hand wrench"), (0.1, 1e-3, "kept 500 of 1000 samples per second")],
)
def test_a_graph_without_a_push_or_too_slow_is_refused(push, period, rule):
    stamps, still = 2e-3 * np.arange(3000), np.zeros((3000, 6))
    with pytest.raises(FeelGraphError, match=rule):
        from_the_push_on(stamps, still + push, still, period)


def test_a_scene_that_cannot_be_measured_costs_the_others_nothing(monkeypatch):
    found = transparency(["two_link"], [1]).rows[0].felt

    def felt_over_graph(scene, over):
        if scene.name == "five_bar":
            raise FeelGraphError("machine too busy")
        return [found]

    monkeypatch.setattr("hapticmech_ros.analysis.transparency.felt_over_graph", felt_over_graph)
    results = transparency(["five_bar", "two_link"], [1], over="processes")
    assert [(row.scene, row.felt) for row in results.rows] == [("two_link", found)]
    assert [*results.notes()] == ["not measured: five_bar: machine too busy"]
    assert not results.sound
    with pytest.raises(FeelGraphError, match="five_bar: machine too busy"):
        transparency(["five_bar"], [1], over="processes")
