# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Damping in proportion to the push: rest, energy, and what scenes may say."""

import pytest

from hapticmech_ros.errors import SceneError
from hapticmech_ros.scene import scene_from_document
from oracles.touching import G, on_floor, run_with_energies


def law(dissipation, stiffness=1e4):
    return {"law": "hunt_crossley", "stiffness": stiffness, "dissipation": dissipation}


@pytest.mark.parametrize("dissipation", [1.0, 1e3])
@pytest.mark.parametrize("stiffness", [1e4, 1e8])
def test_it_rests_where_springs_carry_it_and_is_stable(dissipation, stiffness):
    document = on_floor("box", 0.06, mass=0.1)
    document["contacts"][0] |= law(dissipation, stiffness)
    _, states, energies = run_with_energies(document, 3.0, 10)
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
