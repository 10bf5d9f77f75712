# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The safety envelope: nothing within limits is touched, nothing beyond them leaves."""

import math

import numpy as np
import pytest

from hapticmech_ros.device.safety import Reason, SafetyEnvelope, SafetyLimits
from hapticmech_ros.device.safety_kernels import stay_within

PERIOD = 1e-3
HERE = np.zeros(3)


def left_by(envelope, command, position):
    """Return what leaves of a command."""
    found = np.array(command, dtype=float)
    stay_within(envelope.numbers, found, position)
    return found


class Guard(SafetyEnvelope):
    """An envelope with limits of its own."""

    def __init__(self, **limits):
        super().__init__(PERIOD, SafetyLimits(**({"force": 20.0, "torque": 1.0} | limits)))


def test_what_is_within_all_limits_passes_to_the_bit():
    rng = np.random.default_rng(0)
    guard = Guard(force_slew=1e6, torque_slew=1e5, radius=1.0)
    for _ in range(100):
        command = np.concatenate((rng.uniform(-10, 10, 3), rng.uniform(-0.5, 0.5, 3)))
        assert left_by(guard, command, rng.uniform(-0.4, 0.4, 3)).tobytes() == command.tobytes()
    assert not any(guard.counts.values())


@pytest.mark.parametrize("seed", range(20))
def test_nothing_beyond_a_limit_leaves_whatever_is_commanded(seed):
    rng = np.random.default_rng(seed)
    limits = SafetyLimits(8.0, 0.3, 500.0, 20.0, 0.05, 0.1)
    guard, last = SafetyEnvelope(PERIOD, limits), np.zeros(6)
    for _ in range(200):
        if rng.random() < 0.02:
            guard.stop()
            last = np.zeros(6)
        command = rng.normal(size=6) * 10.0 ** rng.uniform(-3, 300 if rng.random() < 0.1 else 3)
        if rng.random() < 0.05:
            command[rng.integers(6)] = rng.choice([np.nan, np.inf, -np.inf])
        position = rng.normal(scale=0.1, size=3)
        with np.errstate(over="ignore", invalid="ignore"):
            given = left_by(guard, command, position)
        assert np.isfinite(given).all()
        assert np.linalg.norm(given[:3]) <= limits.force * (1 + 1e-12)
        assert np.linalg.norm(given[3:]) <= limits.torque * (1 + 1e-12)
        if np.isfinite(command).all():
            step = np.abs(given - last)
            assert np.linalg.norm(step[:3]) <= limits.force_slew * PERIOD * (1 + 1e-12)
            assert np.linalg.norm(step[3:]) <= limits.torque_slew * PERIOD * (1 + 1e-12)
        else:
            assert not given.any()
        last = given


def test_limits_open_over_the_ramp_after_each_start():
    guard, hard = Guard(ramp=0.01), np.array([100.0, 0.0, 0.0, 0.0, 0.0, 10.0])
    for _ in range(2):
        given = np.array([left_by(guard, hard, HERE) for _ in range(12)])
        share = np.minimum(np.arange(1, 13) / 10.0, 1.0)
        assert given[:, 0] == pytest.approx(20.0 * share, rel=1e-12)
        assert given[:, 5] == pytest.approx(share, rel=1e-12)
        guard.stop()


def test_a_force_is_turned_at_the_same_rate_as_it_is_raised():
    guard = Guard(force_slew=1000.0)
    given = np.array([left_by(guard, np.array([5.0, 0, 0, 0, 0, 0]), HERE) for _ in range(8)])
    assert given[:, 0] == pytest.approx([1, 2, 3, 4, 5, 5, 5, 5], rel=1e-12)
    back = left_by(guard, np.array([0.0, 5.0, 0, 0, 0, 0]), HERE)
    assert np.linalg.norm(back[:3] - [5.0, 0.0, 0.0]) == pytest.approx(1.0, rel=1e-12)
    assert guard.counts[Reason.FORCE_SLEW] == 5


def test_near_the_end_of_the_workspace_nothing_pushes_outwards():
    guard = Guard(radius=0.1)
    guard.place(np.array([0.5, 0.0, 0.0]))
    out, beside = np.array([3.0, 0, 0, 0, 0, 0]), np.array([0.0, 2.0, 1.0, 0.1, 0, 0])
    places = [np.array([0.5 + x, 0.0, 0.0]) for x in (0.05, 0.09, 0.095, 0.1, 1.0)]
    along = [left_by(guard, out, place)[0] for place in places]
    assert along == pytest.approx([3.0, 3.0, 1.5, 0.0, 0.0], abs=1e-12)
    far = np.array([0.75, 0.0, 0.0])
    assert left_by(guard, -out, far).tolist() == (-out).tolist()
    assert left_by(guard, beside, far).tolist() == beside.tolist()
    # On the other side the same force leads back.
    assert left_by(guard, out, np.array([0.3, 0.0, 0.0]))[0] == 3.0


def test_what_is_no_number_is_a_stop():
    guard = Guard(ramp=0.01)
    for _ in range(20):
        left_by(guard, np.full(6, 0.1), HERE)
    assert not left_by(guard, np.array([math.nan, 0, 0, 0, 0, 0]), HERE).any()
    assert guard.counts[Reason.NOT_FINITE] == 1
    # A start again, with its ramp.
    assert left_by(guard, np.array([100.0, 0, 0, 0, 0, 0]), HERE)[0] == pytest.approx(2.0)


def test_limits_come_one_after_the_other():
    """The workspace takes the outward part, then sizes are bounded, then their changes."""
    rng = np.random.default_rng(3)
    limits = SafetyLimits(2.0, 0.8, 600.0, 300.0, 0.02, 0.1)
    envelope, centre, last = SafetyEnvelope(PERIOD, limits), np.array([0.02, 0.0, 0.0]), np.zeros(6)
    envelope.place(centre)
    for tick in range(200):
        command, position = rng.normal(scale=3.0, size=6), rng.normal(scale=0.06, size=3)
        away = position - centre
        out = away / np.linalg.norm(away)
        beyond = np.clip((np.linalg.norm(away) / 0.1 - 0.9) / 0.1, 0.0, 1.0)
        force, torque = command[:3] - beyond * max(command[:3] @ out, 0.0) * out, command[3:]
        share, expected = min(1.0, (tick + 1) * PERIOD / 0.02), []
        for part, old, most, slew in ((force, last[:3], 2.0, 0.6), (torque, last[3:], 0.8, 0.3)):
            bounded = part * min(1.0, share * most / np.linalg.norm(part))
            change = bounded - old
            expected += [*(old + change * min(1.0, slew / np.linalg.norm(change)))]
        last = left_by(envelope, command, position)
        assert last == pytest.approx(expected, rel=1e-12, abs=1e-15)
    counts = envelope.counts
    assert counts.pop(Reason.NOT_FINITE) == 0
    assert all(counts.values())
