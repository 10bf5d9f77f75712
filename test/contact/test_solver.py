# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Forces are what the law says, at every point and in every step, hard scenes included."""

from itertools import pairwise

import numpy as np
import pytest

from contact.test_many_bodies import LAW, stack
from hapticmech_ros import Session
from hapticmech_ros.contact.solver_kernels import MOST_SWEEPS
from hapticmech_ros.scene import scene_from_document
from oracles.touching import (
    FLOOR,
    SHAPES,
    UPRIGHT,
    G,
    body,
    broken_law,
    on_links,
    pair,
    run,
    scene,
    shape,
    valley,
)
from sampling import only_long, sampled

NAMES = ("one", "two", "three")


def heavy(*masses):
    """Return three boxes on each other, turned, of these masses, kg."""
    document = stack(0.1, gap=0.001)
    links = [body(name, mass) for name, mass in zip(NAMES, masses, strict=True)]
    return document | {"links": links}


def corner(friction, tilt=0.05):
    """Return a box that falls askew into a V of two slopes of 45°."""
    law = {"stiffness": 1e5, "damping": 300.0, "friction": friction}
    angle = 0.5 * (np.pi / 4 + 2.0 * tilt)
    q = [0, 0, 0.05 * np.sqrt(2.0) + 0.01, np.sin(angle), 0, 0, np.cos(angle)]
    return scene(
        [body("one")],
        [*valley(), shape("one", SHAPES["box"])],
        [pair("one_shape", "left", **law), pair("one_shape", "right", **law)],
        {"one": q},
    )


def tumbling():
    """Return three boxes that are thrown at each other and at the floor, turning."""
    pairs = [pair(f"{name}_shape", **LAW) for name in NAMES]
    pairs += [pair(f"{a}_shape", f"{b}_shape", **LAW) for a, b in (NAMES[:2], NAMES[1:])]
    turns = [np.array([0.1 * i, 0.2, 0.0, 1.0]) for i in range(3)]
    q = {
        name: [0.17 * i, 0.0, 0.1 + 0.03 * i, *(turns[i] / np.linalg.norm(turns[i]))]
        for i, name in enumerate(NAMES)
    }
    v = {name: [1.0 - i, 0.0, 0.0, 3.0, 2.0, 0.5] for i, name in enumerate(NAMES)}
    shapes = [FLOOR, *(shape(name, SHAPES["box"]) for name in NAMES)]
    return scene([body(name) for name in NAMES], shapes, pairs, q, v)


def sliding():
    """Return a box on a box, eight points, both sliding, the upper one turning."""
    names = NAMES[:2]
    shapes = [FLOOR, *(shape(name, SHAPES["box"]) for name in names)]
    pairs = [pair("one_shape", **LAW), pair("two_shape", "one_shape", **LAW)]
    q = {"one": [0, 0, 0.05, *UPRIGHT], "two": [0, 0, 0.15, *UPRIGHT]}
    v = {"one": [1.0, 0.3, 0, 0, 0, 0], "two": [2.0, 0, 0, 0, 0, 3.0]}
    return scene([body(name) for name in names], shapes, pairs, q, v)


STIFF = {"stiffness": 1e6, "friction": 0.8}
# Boxes sink into each other by a tenth of their size, and Newton's rule alone does not always end.
SOFT = {"stiffness": 1e3, "friction": 0.5}
HARD = {
    "stack": (lambda: stack(0.1, gap=0.001), 0.6),
    "stiff stack": (lambda: stack(0.05, law=STIFF, gap=0.002), 0.4),
    "heavy on light": (lambda: heavy(1.0, 1.0, 100.0), 0.5),
    "light on heavy": (lambda: heavy(100.0, 1.0, 0.01), 0.5),
    "corner": (lambda: corner(0.0), 0.5),
    "corner, rough": (lambda: corner(0.3), 0.5),
    "corner, sticking": (lambda: corner(1.0), 0.5),
    "soft stack": (lambda: stack(0.3, law=SOFT, gap=0.003), 0.7),
    "tumbling": (tumbling, 1.0),
    "sliding": (sliding, 0.6),
}


@pytest.mark.parametrize("name", sampled(HARD, every=2))
def test_the_solver_always_gets_there(name):
    """Rates as the law has them to 1e-8 of the largest one: no step runs out of sweeps."""
    make, duration = HARD[name]
    _, states = run(make(), duration)
    touched = [state.touching for state in states[1:] if state.touching.pairs.size]
    assert len(touched) > 100
    assert max(len(found.pairs) for found in touched) >= 4
    assert max(found.sweeps for found in touched) < MOST_SWEEPS
    # What is largest is no more than all rates that there are, at 0.1 m or less from any joint.
    fastest = max(np.abs(state.v).max() for state in states)
    assert max(found.residual for found in touched) < 1e-8 * (2.0 * fastest + 2e-3 * G)


@pytest.mark.parametrize(("period", "needed"), [(1e-2, True), (1e-3, False)])
def test_sweeps_help_where_newton_does_not_end(period, needed):
    """With steps of 10 ms; at 1 ms nothing needs them."""
    document = corner(1.5)
    document["simulation"]["period"] = period
    _, states = run(document, 0.5)
    assert any(state.touching.sweeps for state in states[1:]) == needed
    assert max(state.touching.residual for state in states[1:]) < 1e-6


def unsolved(period):
    """Return a box that sticks in a V at steps for which no sweeps suffice."""
    document = corner(1.5)
    document["simulation"] = {"period": period, "integrator": "rk4"}
    return document


def test_forces_that_are_not_what_the_law_says_make_a_step_inaccurate():
    """Rates that are off by a share of 1e-6 are energy that is: what rk4 allows a step."""
    _, states = run(unsolved(3e-2), 1.0)
    off = [
        state.touching.residual > 1e-6 * (np.abs(state.v).max() + 3e-2 * G) for state in states[1:]
    ]
    assert sum(off) > 0
    assert states[-1].account.inaccurate >= sum(off)
    counted = np.diff([state.account.inaccurate for state in states])
    assert counted[off].all()
    _, states = run(unsolved(1e-3), 1.0)
    assert states[-1].account.inaccurate == 0


def test_a_session_counts_forces_that_are_not_what_the_law_says():
    document = unsolved(3e-2)
    session = Session(scene_from_document(document | {"hand": {"kind": "constant_wrench"}}))
    session.run(33)
    assert session.mechanism.account.inaccurate > 0


def test_what_was_there_before_leaves_no_friction():
    """A box at rest after a fall and a slide is held by what its weight asks for, and no more."""
    _, states = run(HARD["heavy on light"][0](), 2.0, 1000)
    turned = np.array([0.0, 0.0, 1.0])
    for index in range(3):
        found = states[-1].touching
        forces = found.forces[found.pairs == index]
        across = forces - np.outer(forces @ turned, turned)
        assert np.linalg.norm(across, axis=1).max() < 0.1 * np.linalg.norm(forces, axis=1).max()


@pytest.mark.parametrize(
    "name", ["stack", "corner, rough", *only_long("stiff stack", "corner, sticking")]
)
def test_forces_are_what_the_law_says(name):
    """Checked with the links' own rates, once they turn little in a step."""
    make, duration = HARD[name]
    sim, states = run(make(), 2.0 * duration)
    for before, after in zip(states[-50:-1], states[-49:], strict=True):
        weight = np.abs(after.touching.forces).max()
        assert after.touching.pairs.size >= 4
        assert broken_law(sim, before, after) < 1e-6 * weight


def test_forces_are_what_the_law_says_while_they_slide():
    sim, states = run(sliding(), 0.04)
    turns = max(np.abs(state.v[[3, 4, 5, 9, 10, 11]]).max() for state in states)
    for before, after in pairwise(states[10:]):
        assert len(after.touching.pairs) >= 6
        # ω h of the rates of 1 m/s, times c = 300 N s/m.
        assert broken_law(sim, before, after) < 300.0 * turns * sim.period


@pytest.mark.parametrize("name", ["stack", "tumbling", "corner, rough"])
def test_what_forces_do_in_joints_is_what_they_do_on_links(name):
    """Σ J_cᵀ λ of the kernel, beside Jacobians and wrenches of links."""
    make, duration = HARD[name]
    sim, states = run(make(), duration)
    for before, after in zip(states[-5:-1], states[-4:], strict=True):
        found = after.touching.joint_force
        wanted = sum(
            wrench @ sim.mechanism.link_jacobian(before.q, link)
            for link, wrench in on_links(sim, before, after).items()
        )
        assert np.abs(found).max() > 0.1
        assert found == pytest.approx(wanted, abs=1e-11)


def test_points_of_a_pair_are_on_one_plane():
    """So that a body which rocks on them need not slip at some of them against others."""
    _, states = run(HARD["stack"][0](), 0.1)
    for state in states[20:]:
        found = state.touching
        for index in range(3):
            mine = found.pairs == index
            if mine.sum() > 1:
                heights = (found.points[mine] * found.normals[mine]).sum(axis=1)
                assert np.ptp(heights) < 1e-15
                assert np.ptp(found.normals[mine], axis=0).max() == 0.0
