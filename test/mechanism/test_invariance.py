# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a mechanism is does not depend on where it stands: rank and X turn with it, and no more.

Rows that are zero but for rounding are no constraints, whatever rounding makes of them there.
"""

import numpy as np
import pytest

from hapticmech_ros.operational import Analyser
from oracles.frames import in_units, placed
from oracles.generator import blank, floats, random_mechanism
from oracles.kinematics import place, rotation_of_rpy, rpy_of_rotation, turn
from oracles.running import simulator, with_start
from sampling import sampled


def felt(document):
    """Return ranks, of the closures at the start and of X, and X (6, 6) of the first point."""
    sim = simulator(document)
    terms = sim.evaluate(sim.initial_state())
    point = document["operational_points"][0]["name"]
    analysis = Analyser(sim.mechanism, point).analyse(terms)
    return (terms.space.rank, analysis.rank), analysis.inverse_inertia


def base_of(rng, planar, reach):
    """Return a random turn and displacement of at most ``reach``, m; in the plane if ``planar``."""
    rotation = turn((0, 0, 1), rng.uniform(-3.0, 3.0))
    away = rng.uniform(-reach, reach, 3)
    if planar:
        away[2] = 0.0
    else:
        rotation = rotation @ rotation_of_rpy(rng.uniform(-1.5, 1.5, 3))
    return rotation, away


def assert_invariant(document, planar, seed, bases=3):
    """Check that rank and X are the same wherever the mechanism stands."""
    rng = np.random.default_rng([seed, 45])
    rank, x = felt(document)
    # The same of the open tree: what closures hold is nothing beside it, not exactly zero.
    _, free = felt(document | {"closures": []})
    size = max(1.0, np.abs(free).max())
    for reach in np.geomspace(0.1, 100.0, bases):
        base = base_of(rng, planar, reach)
        there, moved = felt(placed(document, base))
        assert there == rank
        r = np.kron(np.eye(2), base[0])
        # Positions at the reach are rounded to eps of it: that share of lengths of 0.1 m.
        assert np.abs(moved - r @ x @ r.T).max() < 1e-9 * max(1.0, reach) * size
    for length, mass in 10.0 ** rng.uniform(-1.5, 1.5, (bases, 2)):
        there, scaled = felt(in_units(document, length, mass))
        assert there == rank
        back = np.repeat((1.0, length), 3)
        assert np.abs(mass * back[:, None] * scaled * back - x).max() < 1e-9 * size


CASES = [
    (planar, duplicated, seed)
    for planar in (False, True)
    for duplicated in (False, True)
    for seed in sampled(range(100), (planar, duplicated), every=10)
]


@pytest.mark.parametrize(("planar", "duplicated", "seed"), CASES)
def test_rank_and_inverse_inertia_turn_with_the_mechanism_and_units(planar, duplicated, seed):
    sample = random_mechanism(seed, planar, duplicated=duplicated)
    document = with_start(sample.document, sample.q, sample.v)
    assert_invariant(document, planar, seed)


def link(name, parent, joint, xyz=(0.0, 0.0, 0.0), rpy=(0.0, 0.0, 0.0), com=0.1):
    joint = {"name": f"to_{name}", "origin": {"xyz": floats(xyz), "rpy": floats(rpy)}} | joint
    inertia = dict.fromkeys(("ixx", "iyy", "izz"), 0.01)
    inertial = {"mass": 1.0, "com": [com, 0.0, 0.0], "inertia": inertia}
    return {"name": name, "parent": parent, "joint": joint, "inertial": inertial}


HINGE = {"type": "revolute", "axis": [0.0, 0.0, 1.0]}


def cranks():
    """Return two equal cranks in line with the rod between them, turning at 1 rad/s."""
    document = blank(planar=True)
    document["links"] = [
        link("a", "world", HINGE),
        link("b", "world", HINGE, xyz=(0.5, 0.0, 0.0)),
    ]
    at = {"xyz": [0.2, 0.0, 0.0]}
    ends = {side: {"link": side, "origin": at} for side in ("a", "b")}
    document["closures"] = [{"name": "rod", "kind": "rod", "length": 0.5, **ends}]
    document["operational_points"] = [{"name": "tip", "link": "a", "origin": at}]
    document["initial_state"] = {"q": {"to_a": 0.0, "to_b": 0.0}, "v": {"to_a": 1.0, "to_b": 1.0}}
    return document


TILTS = [0.0, *np.linspace(0.1, 3.1, 16).tolist(), 0.7, 2.7]


@pytest.mark.parametrize("tilt", TILTS)
@pytest.mark.parametrize("away", [0.0, 30.0])
def test_cranks_at_dead_centre_turn_on_whatever_the_tilt(tilt, away):
    base = turn((0, 0, 1), tilt), np.array((away, -0.3 * away, 0.0))
    sim = simulator(placed(cranks(), base))
    state = sim.initial_state()
    assert sim.evaluate(state).space.rank == 0
    state = sim.run(state, 500).end
    assert state.q == pytest.approx((0.5, 0.5), abs=1e-9 * max(1.0, away))
    assert state.account.inaccurate == 0


@pytest.mark.parametrize("kind", ["weld", "revolute", "spherical"])
@pytest.mark.parametrize("angle", [0.0, 0.3, 1.1, 2.2])
def test_a_closure_between_links_that_are_fixed_to_each_other_is_none(kind, angle):
    document = blank(gravity=(0.0, -9.81, 0.0))
    own = rotation_of_rpy((0.3, 0.2, 0.1)), np.array((0.2, 0.07, 0.0))
    at = {"xyz": [0.05, 0.11, -0.02]}
    rotation, position = place(own, at)
    there = {"xyz": floats(position), "rpy": rpy_of_rotation(rotation)}
    rod = {"type": "fixed"}
    document["links"] = [
        link("l0", "world", HINGE, (0.1, 0.2, 0.3), (0.0, 0.0, angle), com=0.2),
        link("l1", "l0", rod, own[1], rpy_of_rotation(own[0])),
    ]
    ends = {"a": {"link": "l1", "origin": at}, "b": {"link": "l0", "origin": there}}
    document["operational_points"] = [
        {"name": "p", "link": "l0", "origin": {"xyz": [0.3, 0.0, 0.0]}}
    ]
    free = simulator(document)
    document = document | {"closures": [{"name": "again", "kind": kind, **ends}]}
    sim = simulator(document)
    state = sim.initial_state()
    assert sim.evaluate(state).space.rank == 0
    # It swings as without the closure.
    assert sim.run(state, 300).end.q == pytest.approx(
        free.run(free.initial_state(), 300).end.q, abs=1e-12
    )


def test_a_pin_on_the_axis_of_the_hinge_before_it_is_none_until_it_is_off():
    # The pin says what the hinge says: two of its rows are rounding, the third is along the axis.
    document = blank()
    document["links"] = [link("arm", "world", HINGE, (0.1, -0.7, 0.2), (0.4, 0.2, 1.0))]
    axis = rotation_of_rpy((0.4, 0.2, 1.0))[:, 2]
    on = {"xyz": floats(np.array((0.1, -0.7, 0.2)) + 0.3 * axis)}
    ends = {
        "a": {"link": "arm", "origin": {"xyz": [0.0, 0.0, 0.3]}},
        "b": {"link": "world", "origin": on},
    }
    document["closures"] = [{"name": "pin", "kind": "spherical", **ends}]
    document["operational_points"] = [{"name": "p", "link": "arm", "origin": {"xyz": [0.3, 0, 0]}}]
    sim = simulator(document)
    assert sim.evaluate(sim.initial_state()).space.rank == 0
    assert_invariant(document, False, 1)
