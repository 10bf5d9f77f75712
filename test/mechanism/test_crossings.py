# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Samples that land at, or next to, positions where branches of the motion cross.

Each mechanism's motion through its crossing is one equation for one angle. Energy stays to 1e-8 of
the motion, and the branch is kept, however near a sample is.
"""

import json
import re
from itertools import product

import numpy as np
import pytest

from hapticmech_ros.mechanism.branches import BranchMotion
from hapticmech_ros.mechanism.motion import Start
from hapticmech_ros.mechanism.schemes import SCHEMES
from oracles.crossings import MECHANISMS, SPEED, Step, passed
from oracles.generator import blank
from oracles.planar_loops import Loop
from oracles.running import simulator, unpushed
from sampling import sampled

DISTANCES = (0.0, 1e-12, 1e-10, 1e-9, -1e-8, 1e-7, -1e-6, 1e-5, 1e-4, -1e-3)
KEPT = 1e-8
PLAIN = "one parallelogram"
INTEGRATORS = tuple(SCHEMES)


@pytest.mark.parametrize(
    ("name", "distance"), [(name, d) for name in MECHANISMS for d in sampled(DISTANCES, name)]
)
def test_a_sample_next_to_a_crossing_keeps_energy_and_branch(name, distance):
    mechanism = MECHANISMS[name]
    own, off = mechanism.own_error(distance, Step(1e-3, "rk4"))
    lost, apart, untold, *_ = passed(mechanism, distance, 1e-3)
    assert lost < 1.5 * own + KEPT
    assert apart < 1.5 * off + KEPT
    assert untold < KEPT


@pytest.mark.parametrize("distance", [1.55e-4, 1.6e-4, 1.65e-4])
def test_a_step_that_is_done_again_is_well_within_what_it_may_be_off_by(distance):
    """The check of its energy had been content with 4e-8, in two halves."""
    mechanism, step = MECHANISMS["spherical parallelogram"], Step(4e-3, "rk4")
    found = passed(mechanism, distance, *step[:2])
    assert found.led > 0
    assert found.by_care < 1.5 * mechanism.own_error(distance, step)[0] + KEPT


@pytest.mark.parametrize("other", ["beside a spinner", "with a flywheel"])
def test_care_next_to_a_crossing_knows_nothing_of_what_turns_fast_elsewhere(other):
    """Into how many parts a step is divided, and which direction is a branch's: the loop's own."""
    angle = -0.2 * SPEED * 1e-3
    motions = [led_from(MECHANISMS[name], angle) for name in (f"parallelogram {other}", PLAIN)]
    assert all(motion.has_branch for motion in motions)
    # To the second order in the step: the wheel has a mass.
    assert motions[0].span == pytest.approx(motions[1].span, rel=1e-6)


def led_from(mechanism, angle):
    """Return the motion, on its branch, of a step of 1 ms from an angle (rad)."""
    sim = simulator(mechanism.document())
    start = sim.initial_state()
    q, v = mechanism.configuration(angle), SPEED * mechanism.slope(angle)
    return BranchMotion(sim.mechanism, Start(q, v, start.active), unpushed(sim), 1e-3)


@pytest.mark.parametrize("distance", DISTANCES)
def test_a_contact_at_a_crossing_pushes_what_the_branch_moves(distance):
    """As in a link of the same inertia that has no branches; rows at 0 would let it move more."""
    mechanism = MECHANISMS["parallelogram pressed into a floor"]
    assert mechanism.apart_from_one_link(distance, 1e-3) < 1e-12


@pytest.mark.parametrize("distance", [1e-9, -1e-7])
@pytest.mark.parametrize(
    ("name", "period", "integrator"),
    [
        (name, *step)
        for name in MECHANISMS
        for step in sampled(product((1e-4, 4e-3), INTEGRATORS), name)
    ],
)
def test_no_rule_loses_more_at_a_crossing_than_elsewhere(name, period, integrator, distance):
    """Against the rule's own error, in a motion that does not come near a crossing."""
    mechanism = MECHANISMS[name]
    own, off = mechanism.own_error(distance, Step(period, integrator))
    lost, apart, *_ = passed(mechanism, distance, period, integrator)
    assert lost < 1.5 * own + KEPT
    assert apart < 1.5 * off + KEPT


def four_bar(scale, density):
    """Return links and closure of a four-bar, and its start, at ``scale`` (m, 1)."""
    lengths, pivot = scale * np.array([0.3, 0.8, 0.7]), scale * np.array([0.9, 0.0])
    masses = density * lengths
    loop = Loop(lengths, masses, masses * lengths**2 / 12.0, pivot, gravity=-9.81)
    return loop.document(np.array([1.0]), np.zeros(1))


def side_by_side(*documents):
    """Return one scene of mechanisms that have nothing to do with each other."""
    whole = blank(True, (0.0, -9.81, 0.0))
    start = {"q": {}, "v": {}}
    for index, document in enumerate(documents):
        names = rf'"m{index}_\1"'
        text = re.sub(r'"((?:link|joint|end|middle)\d+|pin)"', names, json.dumps(document))
        renamed = json.loads(text)
        for key in ("links", "closures", "operational_points"):
            whole[key] += renamed[key]
        for key, values in renamed["initial_state"].items():
            start[key] |= values
    return whole | {"initial_state": start}


def test_parts_of_a_scene_that_are_not_connected_do_not_know_of_each_other():
    """A four-bar of 2 m and 100 t beside one of 2 cm and 1 g: each moves as it does alone."""
    alone = [four_bar(2.0, 5e4), four_bar(0.02, 0.05)]
    both = simulator(side_by_side(*alone))
    start = both.initial_state()
    assert both.closing(start).least > 1e-2
    parts = [sim.run(sim.initial_state(), 200).end.q for sim in map(simulator, alone)]
    assert np.abs(both.run(start, 200).end.q - np.concatenate(parts)).max() < 1e-9
