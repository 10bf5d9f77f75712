# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Torques within limits: never beyond them, weight first, ratios kept, and told."""

import numpy as np
import pytest

from hapticmech_ros.robot.law import Target, limited_torque
from oracles.driven_robots import law_of, pose_of, poses


@pytest.mark.parametrize("seed", range(20))
def test_limits_hold_and_shares_are_the_largest(seed):
    rng = np.random.default_rng(seed)
    bias, task, null = (rng.normal(size=7) * size for size in (1.0, 3.0, 2.0))
    limits = rng.uniform(0.5, 4.0, 7)
    found = limited_torque(bias, task, null, limits)
    held = np.clip(bias, -limits, limits)
    # Sums of three numbers of the order of 1.
    assert (np.abs(found.torque) <= limits + 1e-14).all()
    np.testing.assert_allclose(found.torque, held + found.task * task + found.null * null)
    assert found.overloaded == bool((np.abs(bias) > limits).any())
    more = 1.0 + 1e-9
    if 0.0 < found.task < 1.0:
        assert (np.abs(held + more * found.task * task) > limits).any()
    if 0.0 < found.null < 1.0:
        rest = held + found.task * task
        assert (np.abs(rest + more * found.null * null) > limits).any()
    assert found.saturated


def test_what_is_within_limits_is_not_touched():
    rng = np.random.default_rng(0)
    parts = [rng.normal(size=7) for _ in range(3)]
    found = limited_torque(*parts, np.full(7, np.inf))
    assert (found.torque == sum(parts)).all()
    assert not found.saturated


def test_the_law_tells_what_its_limits_took():
    limits = np.array([320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0])
    law = law_of("iiwa14", torque_limits=limits)
    ((q, v),) = poses("iiwa14", 1)
    state = law.state(q, 0.0 * v)
    near = law.command(state, Target(pose_of(law, q)))
    assert not near.limited.saturated
    far = law.command(state, Target(pose_of(law, q), acceleration=np.full(6, 1e4)))
    assert far.limited.saturated
    assert far.limited.task < 0.1
    assert (np.abs(far.torque) <= limits * (1.0 + 1e-12)).all()
