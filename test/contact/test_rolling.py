# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rolling: neither energy from nothing nor a brake, however far a body turns in a step."""

import numpy as np
import pytest

from oracles.touching import (
    FLOOR,
    SHAPES,
    UPRIGHT,
    G,
    body,
    pair,
    run,
    run_with_energies,
    scene,
    shape,
)

RADIUS = 0.05


def rolling(speed, stiffness=1e6, period=1e-3):
    """Return a sphere of 1 kg that rolls on a floor, in equilibrium."""
    height = RADIUS - G / stiffness
    # Points of contact are midway between both surfaces.
    turning = speed / (RADIUS - 0.5 * G / stiffness)
    return scene(
        [body("one")],
        [FLOOR, shape("one", SHAPES["sphere"])],
        [pair("one_shape", stiffness=stiffness, damping=0.5 * np.sqrt(stiffness), friction=0.5)],
        {"one": [0, 0, height, *UPRIGHT]},
        {"one": [speed, 0, 0, 0, turning, 0]},
        period=period,
    )


@pytest.mark.parametrize(
    ("speed", "stiffness", "duration"),
    [(4.0, 1e6, 2.0), (4.0, 1e4, 2.0), (25.0, 1e6, 2.0), (50.0, 1e5, 2.0)],
)
def test_a_sphere_rolls_on(speed, stiffness, duration):
    """At 50 m/s it turns by a radian in a step."""
    sim, states, energies = run_with_energies(rolling(speed, stiffness), duration, 100)
    moving = 0.5 * (1.0 + (0.1**2 / 6.0) / RADIUS**2) * speed**2
    account = states[-1].account
    assert energies.max() <= energies[0] + 1e-6 * moving
    turn = speed / RADIUS * sim.period
    assert energies[-1] > energies[0] - (1e-3 + 2e-2 * turn**4) * moving
    # What is lost beyond a thousandth, where a step turns it by a radian, is counted.
    assert (account.inaccurate > 0) == (-account.surplus > 1e-3 * moving)
    travelled = states[-1].q[0] - states[0].q[0]
    assert travelled == pytest.approx(speed * duration, rel=1e-3 + 5e-3 * turn**2)
    # It neither hops nor sinks in.
    heights = np.array([state.q[2] for state in states])
    assert np.ptp(heights) < 1e-6 + 1e-4 * turn**2


def test_what_contacts_lose_is_never_below_nothing():
    _, states = run(rolling(4.0), 2.0, 10)
    lost = np.array([state.account.contact_loss for state in states])
    assert lost.min() >= -1e-6
