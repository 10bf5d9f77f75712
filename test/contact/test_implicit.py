# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Contacts of mechanisms whose own springs are stiffer than a step resolves."""

import pytest

from oracles.touching import FLOOR, SHAPES, body, pair, run, run_with_energies, scene, shape

STEP = 1e-3
STIFFNESS, TOUCH, MASS = 1e6, 1e5, 1.0


def slider(spring=STIFFNESS, damping=2e3, start=0.0501):
    """Return a sphere on a slider, whose spring is at rest 1 mm below where it touches."""
    link = body("one", MASS, "prismatic")
    link["joint"] |= {
        "axis": [0.0, 0.0, 1.0],
        "stiffness": spring,
        "damping": damping,
        "rest": 0.049,
    }
    document = scene(
        [link],
        [FLOOR, shape("one", SHAPES["sphere"])],
        [pair("one_shape", stiffness=TOUCH)],
        gravity=(0, 0, 0),
        integrator="linearly_implicit",
    )
    document["initial_state"]["q"] = {"of_one": start}
    return document


@pytest.mark.parametrize("spring", [1e4, 1e6, 1e8])
def test_the_force_at_rest_is_that_of_statics(spring):
    _, states = run(slider(spring), 2.0)
    end = states[-1]
    assert abs(end.v[0]) < 1e-9
    force = end.touching.forces[:, 2].sum()
    assert force == pytest.approx(spring * (end.q[0] - 0.049), rel=1e-6)
    # Both springs in series, 1 mm; the depth may be off by h² f / m.
    depth = 1e-3 * spring / (spring + TOUCH)
    assert abs(0.05 - end.q[0] - depth) < STEP**2 * force / MASS + 1e-12


@pytest.mark.parametrize("spring", [1e4, 1e6, 1e8])
def test_energy_never_grows(spring):
    _, states, energies = run_with_energies(slider(spring, 10.0, 0.0505), 0.5)
    assert any(state.touching.pairs.size for state in states[1:])
    assert energies.max() <= energies[0] * (1.0 + 1e-6)
    assert energies[-1] < energies[0]
