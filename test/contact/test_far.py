# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pairs out of reach: nothing is changed by them, and nothing that comes near is missed."""

import numpy as np
import pytest

from contact.test_felt import against_a_wall
from contact.test_solver import tumbling
from hapticmech_ros.contact import memory as contact_memory
from hapticmech_ros.scene import document_of
from oracles.touching import FLOOR, UPRIGHT, body, on_floor, pair, run, scene, shape

INTEGRATORS = ("rk2", "rk4", "semi_implicit_euler")


def stepped(document, count, wrench):
    wrenches = np.zeros((len(document["operational_points"]), 6))
    wrenches[0] = wrench
    return run(document, count * 1e-3, wrenches=wrenches)[1]


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("name", ["five_bar", "spatial_arm", "four_bar_closing"])
def test_out_of_reach_the_step_is_the_ordinary_one_to_the_bit(name, substeps, integrator):
    document = document_of(against_a_wall(name))
    wall = next(one for one in document["shapes"] if one["name"] == "wall")
    wall["origin"]["xyz"][0] -= 10.0
    document["simulation"] |= {"integrator": integrator, "substeps": substeps}
    without = document | {"contacts": [], "shapes": []}
    wrench = [0.3, -0.2, 0.0, 0.0, 0.0, 0.001]
    for far, free in zip(stepped(document, 60, wrench), stepped(without, 60, wrench), strict=True):
        assert (far.q == free.q).all()
        assert (far.v == free.v).all()
        assert far.account == free.account
    assert not far.touching.pairs.size


def always_searched(monkeypatch, document, duration, wrenches=None):
    """Return states of a run that searches for points in every step, however far shapes are."""
    with monkeypatch.context() as patched:
        patched.setattr(contact_memory, "FAR", 1e9)
        return run(document, duration, wrenches=wrenches)[1]


def fast():
    """Return the document of a small ball thrown at a thin plate on the floor."""
    ball, plate = {"kind": "sphere", "radius": 0.005}, {"kind": "box", "size": [0.2, 0.2, 0.002]}
    return scene(
        [body("one", 0.1), body("two")],
        [FLOOR, shape("one", ball), shape("two", plate)],
        [pair("one_shape", "two_shape"), pair("two_shape"), pair("one_shape")],
        {"one": [0.0, 0.0, 0.3, *UPRIGHT], "two": [0.0, 0.0, 0.001, *UPRIGHT]},
        {"one": [0.0, 0.0, -8.0, 0.0, 0.0, 0.0]},
    )


@pytest.mark.parametrize(
    ("make", "duration"),
    [
        (lambda: on_floor("box", 0.1, law={"friction": 0.5}), 0.4),
        (tumbling, 0.5),
        (fast, 0.2),
    ],
    ids=["box", "tumbling", "fast"],
)
def test_nothing_that_comes_near_is_missed(monkeypatch, make, duration):
    wanted = always_searched(monkeypatch, make(), duration)
    _, found = run(make(), duration)
    assert any(state.touching.pairs.size for state in found[1:])
    assert any(not state.touching.pairs.size for state in found[1:])
    for one, other in zip(found, wanted, strict=True):
        assert (one.q == other.q).all()
        assert (one.v == other.v).all()
        assert one.account == other.account


def test_what_a_push_brings_near_within_a_step_is_not_missed(monkeypatch):
    """From rest, 0.1 kg under 3e5 N: 3 m in a step, towards a floor 0.5 m below."""
    document = on_floor("sphere", 0.55, mass=0.1, law={"stiffness": 1e6})
    pushed = np.array([[0.0, 0.0, -3e5, 0.0, 0.0, 0.0]])
    _, found = run(document, 1e-3, wrenches=pushed)
    wanted = always_searched(monkeypatch, document, 1e-3, pushed)
    assert found[-1].touching.pairs.size == 1
    assert (found[-1].v == wanted[-1].v).all()
