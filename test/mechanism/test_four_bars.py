# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Linkages that pass next to a singular position: no integrator loses energy in silence."""

import numpy as np
import pytest

from hapticmech_ros.errors import ClosureError, InaccurateStepError
from hapticmech_ros.mechanism.schemes import SCHEMES
from oracles.planar_loops import Loop
from oracles.running import simulator
from sampling import sampled

STEPS = (5e-4, 1e-3, 4e-3)
# What is not counted may be off by the share that the rule states: 1e-3, of order 1 1e-2.
MARGIN = 1.1


def four_bar(crank, coupler, follower, ground, angle, speed):
    """Return uniform rods of 1 kg/m in the open assembly, no losses; crank at rad and rad/s."""
    lengths, pivot = np.array([crank, coupler, follower]), np.array([ground, 0.0])
    loop = Loop(lengths, lengths, lengths**3 / 12.0, pivot, side=int(np.sign(angle)))
    return loop.document(np.array([angle]), np.array([speed]))


def off_by(sim, document, turns):
    """Return the largest error of the energy (exact: constant), a share of it, and the account."""
    state = sim.initial_state()
    begun = sum(sim.mechanism.energy(state.q, state.v))
    speed = abs(document["initial_state"]["v"]["joint1"])
    steps = int(2.0 * np.pi * turns / (speed * sim.period))
    run = sim.run(state, steps, every=max(1, steps // 100))
    found = [sum(sim.mechanism.energy(q, v)) for q, v in zip(run.q, run.v, strict=True)]
    return max(abs(energy - begun) for energy in found) / begun, run.end.account


def linkage(seed):
    """Return one that is 1e-7 to 1e-3 m from a parallelogram."""
    rng = np.random.default_rng([seed, 31])
    crank, ground = rng.uniform(0.1, 0.4, 2)
    off = 10.0 ** rng.uniform(-7.0, -3.0) * rng.choice([-1, 1])
    longer = off * rng.uniform(-1.0, 1.0) * rng.integers(2)
    angle = rng.uniform(0.5, 2.7) * rng.choice([-1, 1])
    speed = 10.0 ** rng.uniform(-0.5, 1.0) * rng.choice([-1, 1])
    return four_bar(crank, ground, crank + off, ground + longer, angle, speed)


@pytest.mark.parametrize("period", STEPS)
@pytest.mark.parametrize("integrator", SCHEMES)
@pytest.mark.parametrize("seed", sampled(range(1000), every=300))
def test_energy_is_constant_or_the_steps_are_counted(seed, integrator, period):
    document = linkage(seed)
    try:
        off, account = off_by(simulator(document, period, integrator), document, 2.0)
    except (ClosureError, InaccurateStepError):
        return  # Refused, by name.
    allowed = max(1e-3, SCHEMES[integrator].drift)
    assert off < MARGIN * allowed or account.inaccurate > 0


@pytest.mark.parametrize(
    ("integrator", "most"), [("rk4", 1e-4), ("tsit5", 1e-4), ("linearly_implicit", 1e-3)]
)
def test_two_turns_at_2e_5_from_a_parallelogram(integrator, most):
    document = four_bar(0.2275, 0.2963, 0.22751, 0.2963, 2.68, -2.2)
    off, _ = off_by(simulator(document, 1e-3, integrator), document, 2.0)
    assert off < most


def test_what_a_rule_of_order_1_loses_is_counted():
    document = four_bar(0.2275, 0.2963, 0.22751, 0.2963, 2.68, -2.2)
    off, account = off_by(simulator(document, 1e-3, "semi_implicit_euler"), document, 2.0)
    assert off > 0.01
    assert account.inaccurate > 0


def test_an_implicit_rule_says_what_it_took_from_stiff_springs():
    # A spring of 1e6 N m/rad, 50 times faster than the step, is let go: all of it is lost at once.
    document = four_bar(0.2, 0.3, 0.25, 0.35, 1.0, 0.5)
    joint = document["links"][0]["joint"]
    document["links"][0]["joint"] = joint | {"stiffness": 1e6, "rest": 1.01}
    sim = simulator(document, 1e-3, "linearly_implicit")
    start = sim.initial_state()
    end = sim.run(start, 500).end
    lost = sum(sim.mechanism.energy(start.q, start.v)) - sum(sim.mechanism.energy(end.q, end.v))
    assert lost > 40.0
    assert end.account.damping_loss == pytest.approx(lost, rel=1e-3)
    assert end.account.inaccurate == 0
