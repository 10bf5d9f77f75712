# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rates of the last states: which of them a state's delay compensation is told."""

import numpy as np
import pytest

from hapticmech_ros.operational.observation import PastRates

PERIOD_NS = 1_000_000
CLOSED, OPEN = (True,), (False,)


def filled(numbers, periods=3, later=()):
    """Return what remembers the rates k at k periods, and later ones (time, rates, closures)."""
    past = PastRates(periods, PERIOD_NS, 2)
    for time, rate, closures in (*((k, k, CLOSED) for k in numbers), *later):
        past.add(time * PERIOD_NS, np.full(2, float(rate)), closures)
    return past


NOTHING = [0.0, 0.0, 0.0]
TEN, OPENED = filled(range(10)), filled(range(7), later=[(7, 0, OPEN), (8, 1, CLOSED)])
# What is remembered, what is asked at which time (in periods) and of which closures; what is told.
TOLD = {
    "as many periods ago": (TEN, 10.0, CLOSED, [3e-3, 7.0, 7.0]),
    # Stamps of a real machine are not even: a quarter of a period may be missing.
    "a little early": (TEN, 9.8, CLOSED, [2.8e-3, 7.0, 7.0]),
    "too early": (TEN, 9.7, CLOSED, [3.7e-3, 6.0, 6.0]),
    "the one before a missing one": (filled([0, 1, 5, 6, 8, 9]), 10.0, CLOSED, [4e-3, 6.0, 6.0]),
    "too many are missing": (filled([0, 1, 8, 9]), 10.0, CLOSED, NOTHING),
    "none yet": (filled([]), 0.0, CLOSED, NOTHING),
    "other closures": (TEN, 10.0, OPEN, NOTHING),
    # A mechanism that starts anew begins its time anew.
    "later times": (filled(range(10), later=[(2, 0, CLOSED)]), 10.0, CLOSED, NOTHING),
    "over a connection none are wanted": (filled(range(10), periods=0), 10.0, CLOSED, NOTHING),
    "opened and closed meanwhile": (OPENED, 10.0, CLOSED, NOTHING),
    "since then": (OPENED, 11.0, CLOSED, [3e-3, 1.0, 1.0]),
}


@pytest.mark.parametrize(("past", "now", "closures", "told"), TOLD.values(), ids=TOLD)
def test_rates_are_those_of_as_many_periods_ago(past, now, closures, told):
    assert past.before(round(now * PERIOD_NS), closures) == pytest.approx(told)


def test_what_is_forgotten_is_not_told():
    past = filled(range(10))
    past.forget()
    assert not past.before(10 * PERIOD_NS, CLOSED).any()


def test_remembered_rates_are_their_own():
    past, rates = PastRates(1, PERIOD_NS, 2), np.ones(2)
    past.add(0, rates, CLOSED)
    rates[:] = 5.0
    assert past.before(PERIOD_NS, CLOSED) == pytest.approx([1e-3, 1.0, 1.0])
