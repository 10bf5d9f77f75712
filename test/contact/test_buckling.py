# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A heavy box on a light one on springs: up to which mass it stands is a question of statics."""

import numpy as np
import pytest
from scipy.optimize import brentq

from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.simulation import Simulator
from oracles.touching import FLOOR, SHAPES, UPRIGHT, G, body, pair, scene, shape
from sampling import sampled

SIDE = SHAPES["box"]["size"][0]
LIGHT = 1.0


def depths(mass, stiffness):
    """Return how deep (m) each of four corners is below the light box, and between the two."""
    return (mass + LIGHT) * G / (4.0 * stiffness), mass * G / (4.0 * stiffness)


def least_stiffness(mass, stiffness):
    """Return the determinant of the stiffness against tilts of the two boxes, N² m².

    Friction holds, so that each box turns about the middle between the faces that touch: P below
    the light box, Q between the two. Four springs k at the corners of a face of side a resist with
    k a² (relative tilt); weights, and normal forces whose centre is where the faces overlap, act on
    levers l from P to Q and from Q to the heavy box's centre.
    """
    below, between = depths(mass, stiffness)
    weight, all_weight = mass * G, (mass + LIGHT) * G
    to_q, to_centre = SIDE - 0.5 * (below + between), 0.5 * (SIDE - between)
    springs = stiffness * SIDE**2
    joint = springs - 0.25 * weight * between
    light = springs + joint - weight * to_q - 0.5 * all_weight * below
    return light * (joint - weight * to_centre) - joint**2


def tilts(mass, stiffness, seconds):
    """Return the heavy box's tilt (n,), rad, from a start 1e-5 m beside equilibrium."""
    law = {"stiffness": stiffness, "damping": 300.0, "friction": 0.8}
    below, between = depths(mass, stiffness)
    low = 0.5 * SIDE - below
    q = {"one": [0, 0, low, *UPRIGHT], "two": [1e-5, 0, low + SIDE - between, *UPRIGHT]}
    links = [body("one", LIGHT), body("two", mass)]
    shapes = [FLOOR, *(shape(name, SHAPES["box"]) for name in ("one", "two"))]
    pairs = [pair("one_shape", **law), pair("two_shape", "one_shape", **law)]
    sim = Simulator(scene_from_document(scene(links, shapes, pairs, q)))
    found = sim.run(sim.initial_state(), round(seconds / sim.period))
    return 2.0 * np.linalg.norm(found.q[:, 10:13], axis=1)


@pytest.mark.parametrize("stiffness", sampled([1e5, 1e6]))
def test_a_heavy_box_stands_on_a_light_one_up_to_the_mass_that_buckles_it(stiffness):
    """At 1e5 N/m, 680 kg stand on 1 kg: 1 t has to fall, as it would on such springs."""
    critical = brentq(least_stiffness, 1.0, 1e5 * stiffness / 1e6, args=(stiffness,))
    if stiffness == 1e5:
        assert critical == pytest.approx(680.0, abs=1.0)
    stands, falls = (tilts(share * critical, stiffness, 4.0) for share in (0.97, 1.03))
    second = 1000
    assert stands[-second:].max() < 2.0 * stands[: 2 * second].max()
    assert stands.max() < 0.01
    assert falls[-1] > 10.0 * falls[second]


def test_ten_tonnes_stand_on_a_kilogram():
    """A mass ratio of 1e4, on springs that bear it."""
    assert tilts(1e4, 1e7, 2.0).max() < 1e-4
