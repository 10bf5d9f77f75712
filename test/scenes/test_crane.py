# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A crane: the rope that is a constraint where it hangs, and the swing."""

import numpy as np
import pytest
import scipy.linalg

from hapticmech_ros import Mechanism, Simulator, analyse, load_scene
from hapticmech_ros.operational.observation import rigid_count
from hapticmech_ros.scene import document_of, scene_from_document

NAME = "crane"

TROLLEY, LOAD, MOMENT = 1.5, 0.6, 3.6e-4
ROPE, HOOK = 0.25, 0.03
GRAVITY = 9.81
RAIL = 0.15  # of the trolley above the load
PLANE = np.ix_([0, 1, 5], [0, 1, 5])


def configuration(rope, turn, trolley=RAIL):
    """Return q where the rope leans by an angle and the load is turned by another."""
    hook = np.array([trolley - RAIL + ROPE * np.sin(rope), -ROPE * np.cos(rope)])
    middle = hook - HOOK * np.array([-np.sin(turn), np.cos(turn)])
    return np.array([trolley, *middle, np.cos(turn), np.sin(turn)])


def changed(trolley=None, q=None, **simulation):
    """Return the scene with other values of the trolley's joint, another start, another rule."""
    document = document_of(load_scene("crane"))
    document["links"][0]["joint"] |= trolley or {}
    document["simulation"] |= simulation
    if q is not None:
        rail, *swing = (float(value) for value in q)
        document["initial_state"]["q"] = {"rail": rail, "swing": swing}
    return scene_from_document(document)


@pytest.mark.parametrize(("rope", "turn"), [(0.0, 0.0), (0.1, 0.0), (-0.3, 0.2), (0.5, 0.5)])
def test_the_rope_is_a_constraint_where_it_hangs_and_a_mass_elsewhere(rope, turn):
    """X of a body on a rod to a mass on a rail, by one row and one multiplier."""
    q = configuration(rope, turn)
    found = analyse(Mechanism(load_scene("crane")), q, point="load_middle")
    along = np.array([np.sin(rope), -np.cos(rope)])
    hook = HOOK * np.array([-np.sin(turn), np.cos(turn)])
    row = np.array([*along, hook[0] * along[1] - hook[1] * along[0]])
    free = np.diag([1.0 / LOAD, 1.0 / LOAD, 1.0 / MOMENT])
    shared = row @ free @ row + along[0] ** 2 / TROLLEY
    expected = free - free @ np.outer(row, row) @ free / shared
    # Two links and one row: rounding, of the largest entry.
    assert found.inverse_inertia[PLANE] == pytest.approx(expected, abs=1e-11 / MOMENT)
    assert found.rank == (2 if rope == 0.0 else 3)


@pytest.mark.parametrize(("angle", "count"), [(0.0, 1), (0.03, 1), (0.15, 0), (-0.15, 0)])
def test_the_rope_is_felt_as_rigid_within_some_degrees(angle, count):
    """Along it the trolley is as heavy as M / sin², against 750 kg and 120 kg: at 2.6° and 6.4°."""
    scene = load_scene("crane")
    found = analyse(Mechanism(scene), configuration(angle, 0.0), point="load_middle")
    assert rigid_count(found.spectrum.s, scene.perception) == count
    assert (scene.perception.s_on, scene.perception.s_off) == (0.02, 0.05)


def matrices(trolley_moves):
    """Return inertia and stiffness of small swings: trolley, rope's lean, load's turn."""
    m, rope, hook = LOAD, ROPE, HOOK
    inertia = np.array(
        [
            [TROLLEY + m, m * rope, m * hook],
            [m * rope, m * rope**2, m * rope * hook],
            [m * hook, m * rope * hook, m * hook**2 + MOMENT],
        ]
    )
    stiffness = np.diag([0.0, m * GRAVITY * rope, m * GRAVITY * hook])
    first = 0 if trolley_moves else 1
    return inertia[first:, first:], stiffness[first:, first:]


@pytest.mark.parametrize(("mode", "trolley_moves"), [(1, True), (2, True), (0, False), (1, False)])
def test_it_swings_as_a_double_pendulum_does(mode, trolley_moves):
    """After a period each mode is back where it began."""
    inertia, stiffness = matrices(trolley_moves)
    squares, shapes = scipy.linalg.eigh(stiffness, inertia)
    period = 2.0 * np.pi / np.sqrt(squares[mode])
    shape = shapes[:, mode] / np.abs(shapes[-2:, mode]).max() * 1e-3
    trolley, rope, turn = shape if trolley_moves else (0.0, *shape)
    steps = 1000
    scene = changed(
        {"damping": 0.0, "locked": not trolley_moves},
        configuration(rope, turn, RAIL + trolley),
        period=float(period / steps),
        integrator="rk4",
    )
    simulator = Simulator(scene)
    start = simulator.initial_state()
    half, end = (simulator.run(start, count).end for count in (steps // 2, steps))
    # Swings of 1 mrad: frequencies are off by some 1e-6 / 16, and so is all else.
    assert end.q == pytest.approx(start.q, abs=2e-9)
    assert half.q[-1] == pytest.approx(-start.q[-1], abs=1e-9)
    assert np.abs(half.q - start.q).max() > 1e-4


def lean_of(q):
    hook = q[1] - HOOK * q[4]
    return np.arcsin((hook - (q[0] - RAIL)) / ROPE)


def test_the_rope_comes_and_goes(run):
    """The count falls where the rope leans and rises where it hangs, and ends as it began."""
    assert {(before, after) for _, before, after in run.changes} == {(0, 1), (1, 0)}
    assert np.abs(run.of(lambda s: lean_of(s.mechanism.q))).max() > 0.15
    assert run.count[0] == run.count[-1] == 1
