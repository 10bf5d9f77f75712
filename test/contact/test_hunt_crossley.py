# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Damping in proportion to the push: exact rebounds, rest, energy, and what scenes may say."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import brentq

from hapticmech_ros.errors import SceneError
from hapticmech_ros.scene import scene_from_document
from oracles.touching import G, held, on_floor, run


def law(dissipation, stiffness=1e4):
    return {"law": "hunt_crossley", "stiffness": stiffness, "dissipation": dissipation}


def thrown(speed, dissipation, period=1e-4, mass=1.0, stiffness=1e4):
    """Return the speed at which a sphere comes off a floor, without gravity."""
    document = on_floor(
        "sphere",
        0.05,
        (0, 0, -speed),
        mass,
        gravity=(0, 0, 0),
        period=period,
    )
    document["contacts"][0] |= law(dissipation, stiffness)
    sim, states = run(document, 4.0 * np.sqrt(mass / stiffness))
    energies = np.array([held(sim, state) for state in states])
    assert np.diff(energies).max() <= 1e-12
    assert not states[-1].touching.pairs.size
    return states[-1].v[2]


def rebound(speed, dissipation):
    """Return what m v dv/dx = -k x (1 + χ v) gives, whatever m and k are."""

    def left(v):
        return v / dissipation - np.log1p(dissipation * v) / dissipation**2

    return -brentq(lambda v: left(v) - left(speed), -0.999999 / dissipation, 0.0, xtol=1e-14)


@pytest.mark.parametrize("dissipation", [0.1, 0.5, 2.0])
@pytest.mark.parametrize("speed", [0.3, 1.0])
def test_rebound_is_the_exact_one_to_first_order(dissipation, speed):
    wanted = rebound(speed, dissipation)
    assert wanted < min(speed, 1.0 / dissipation)
    errors = [thrown(speed, dissipation, h) - wanted for h in (2e-4, 1e-4, 5e-5)]
    assert abs(errors[0]) < 0.05 * speed
    for coarse, fine in pairwise(errors):
        assert abs(fine) < 0.65 * abs(coarse)


@pytest.mark.parametrize("dissipation", [1.0, 1e3])
@pytest.mark.parametrize("stiffness", [1e4, 1e8])
def test_it_rests_where_springs_carry_it_and_is_stable(dissipation, stiffness):
    document = on_floor("box", 0.06, mass=0.1)
    document["contacts"][0] |= law(dissipation, stiffness)
    sim, states = run(document, 3.0, 10)
    energies = np.array([held(sim, state) for state in states])
    assert energies.max() <= energies[0] + 1e-12
    assert states[-1].q[2] == pytest.approx(0.05 - 0.1 * G / (4.0 * stiffness), abs=1e-5)


@pytest.mark.parametrize(
    ("given", "key"),
    [
        ({"law": "hunt_crossley", "damping": 5.0}, "damping"),
        ({"dissipation": 1.0}, "dissipation"),
        ({"law": "hunt_crossley", "dissipation": -1.0}, "dissipation"),
        ({"law": "hooke"}, "law"),
    ],
)
def test_a_scene_says_only_what_its_law_has(given, key):
    document = on_floor()
    document["contacts"][0] |= given
    with pytest.raises(SceneError) as caught:
        scene_from_document(document)
    assert f"contacts[0].{key}" in str(caught.value)
