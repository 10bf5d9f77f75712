# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The speed benchmark's first question: do all simulators compute the same motion?"""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.accuracy import cases
from benchmarks.speed import reference
from benchmarks.speed.benchmark import plan
from benchmarks.speed.contender import (
    Peer,
)
from benchmarks.speed.equality import Check, check
from benchmarks.speed.mujoco_peer import MUJOCO
from benchmarks.speed.own_peer import own_peer
from benchmarks.speed.pinocchio_peer import LOOPS, PINOCCHIO
from benchmarks.speed.problems import ASKED, Problem, problems
from sampling import sampled

PROBLEMS = {problem.name: problem for problem in problems()}
# Of large ones a second takes too long for a test; the same generator makes the small ones.
SMALL = [name for name, problem in PROBLEMS.items() if not problem.large]
PEERS = plan().peers


def of(problem: Problem, peer: Peer, method: str) -> Check:
    chosen = next(one for one in peer.methods if one.name == method)
    return check(problem, peer, chosen)


@pytest.mark.parametrize("name", sampled(SMALL, every=2))
@pytest.mark.parametrize("peer", PEERS, ids=lambda peer: peer.name)
def test_all_simulators_compute_the_same_motion(peer: Peer, name: str) -> None:
    found = {one.method: one for one in (check(PROBLEMS[name], peer, m) for m in peer.methods)}
    # lcaba needs loops, and does not give the accelerations of a rod on a ball.
    lcaba = found.pop(LOOPS, None)
    if lcaba is not None:
        loops = any(closure.active for closure in PROBLEMS[name].scene.closures)
        assert lcaba.passed == (loops and name != "spatial_four_bar"), lcaba.reason
    assert found
    assert all(one.passed for one in found.values()), [one.reason for one in found.values()]


def test_by_the_same_rule_we_and_others_have_the_same_error() -> None:
    # Without closures nothing differs but rounding.
    ours = of(PROBLEMS["spatial_arm"], own_peer(), "rk4")
    for peer in (MUJOCO, PINOCCHIO):
        theirs = of(PROBLEMS["spatial_arm"], peer, "rk4")
        assert theirs.coarse == pytest.approx(ours.coarse, rel=1e-2)
    assert ours.fine is not None
    assert ours.coarse is not None
    # Order 4: half the step leaves a sixteenth.
    assert ours.coarse / ours.fine == pytest.approx(16.0, rel=0.1)


def test_references_agree_with_published_values() -> None:
    compared = 0
    for case in cases():
        problem = PROBLEMS.get(case.name)
        for output in case.outputs if problem is not None else ():
            for other in problem.outputs:
                if other.name != output.name:
                    continue
                for time, values in zip(output.times, output.values, strict=True):
                    if time in other.times:
                        mine = other.values[other.times.index(time)]
                        assert np.abs(np.array(mine) - values).max() < output.tolerance
                        compared += 1
    # Two of the pendulum, three and one of A02, two of Bricard's mechanism, seven of Andrews'.
    assert compared >= 13


def test_the_stored_reference_is_what_its_command_computes() -> None:
    asked = next(one for one in ASKED if one.name == "pendulum")
    readings, _ = reference.reference(asked.scene, asked.outputs)
    assert PROBLEMS["pendulum"].error(readings) < 1e-12
    windows = reference.parallelograms(10, PROBLEMS["n_four_bar_10"].times)
    assert PROBLEMS["n_four_bar_10"].error(windows) < 1e-12
