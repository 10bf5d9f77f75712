# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps from 4 ms to 62.5 us, and loops that latch at speed."""

import numpy as np
import pytest

from oracles.planar_linkages import five_bar, five_bar_bent
from oracles.running import run, simulator, total_energy, with_start


def approaching(seed, latch_distance):
    """Return an open five-bar whose pin comes in at 1 m/s, 5 mm before it is there."""
    rng = np.random.default_rng(seed)
    document = five_bar()
    (pin,) = document["closures"]
    pin = pin | {"active": False}
    if latch_distance is not None:
        pin |= {"latch_distance": latch_distance}
    document = document | {"closures": [pin]}
    q = np.asarray(five_bar_bent(1.9, 0.6))
    mechanism = simulator(with_start(document, q)).mechanism
    closing = mechanism.closing_terms(q, (True,))
    direction = rng.normal(size=2)
    direction /= np.linalg.norm(direction)
    v = closing.space.correction(direction) + 0.5 * closing.space.closed_rates(rng.normal(size=4))
    back = mechanism.integrate(q, -5e-3 * v)
    return with_start(document, back, v)


@pytest.mark.parametrize("seed", range(8))
def test_a_loop_that_latches_at_a_metre_a_second_creates_no_energy(seed):
    latching = simulator(approaching(seed, 2e-3))
    free = simulator(approaching(seed, None))
    states, unlatched = run(latching, 0.02), run(free, 0.02)
    latched = next(k for k, state in enumerate(states) if state.active == (True,))
    after, before = states[latched], unlatched[latched]
    mechanism = latching.mechanism
    closing = mechanism.closing_terms(after.q, after.active)
    speed = np.linalg.norm(closing.jacobian @ before.v)
    assert speed == pytest.approx(1.0, abs=0.2)
    # What is free keeps its momentum in the mass metric, what is closed has none.
    inertia = closing.space.factor @ closing.space.factor.T
    scale = np.abs(inertia @ before.v).max()
    kept = closing.space.closed_rates(np.eye(4)[0])
    for axis in np.eye(4):
        kept = closing.space.closed_rates(axis)
        assert abs(kept @ inertia @ (after.v - before.v)) < 1e-10 * scale
    assert np.abs(closing.jacobian @ after.v).max() < 1e-12
    assert after.account.latch_loss > 0.0
    energies = [total_energy(latching, state) for state in states]
    assert energies[latched] <= energies[latched - 1]
    assert energies[latched] == pytest.approx(energies[0] - after.account.latch_loss, rel=1e-7)
    # The pin stays closed, and no energy comes back.
    assert all(state.active == (True,) for state in states[latched:])
    assert np.ptp(energies[latched:]) < 1e-9 * energies[0]
