# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rates of the last states: which of them a state's delay compensation is told."""

import numpy as np
import pytest

from hapticmech_ros.operational.observation import PastRates

PERIOD_NS = 1_000_000
CLOSED, OPEN = (True,), (False,)


def filled(numbers, periods=3):
    """Return what remembers the rates k at k periods."""
    past = PastRates(periods, PERIOD_NS, 2)
    for number in numbers:
        past.add(number * PERIOD_NS, np.full(2, float(number)), CLOSED)
    return past


def test_they_are_those_of_as_many_periods_ago():
    past = filled(range(10))
    assert past.before(10 * PERIOD_NS, CLOSED) == pytest.approx([3e-3, 7.0, 7.0])
    # Stamps of a real machine are not even: a quarter of a period may be missing.
    assert past.before(10 * PERIOD_NS - 200_000, CLOSED) == pytest.approx([2.8e-3, 7.0, 7.0])
    assert past.before(10 * PERIOD_NS - 300_000, CLOSED) == pytest.approx([3.7e-3, 6.0, 6.0])


def test_a_missing_state_is_replaced_by_the_one_before_it_if_that_is_near_enough():
    past = filled([0, 1, 5, 6, 8, 9])
    assert past.before(10 * PERIOD_NS, CLOSED) == pytest.approx([4e-3, 6.0, 6.0])
    assert not filled([0, 1, 8, 9]).before(10 * PERIOD_NS, CLOSED).any()


def test_of_other_closures_of_later_times_and_of_none_nothing_is_told():
    assert not PastRates(3, PERIOD_NS, 2).before(0, CLOSED).any()
    past = filled(range(10))
    assert not past.before(10 * PERIOD_NS, OPEN).any()
    # A mechanism that starts anew begins its time anew.
    past.add(2 * PERIOD_NS, np.zeros(2), CLOSED)
    assert not past.before(10 * PERIOD_NS, CLOSED).any()
    past = filled(range(10))
    past.forget()
    assert not past.before(10 * PERIOD_NS, CLOSED).any()
    # Over a connection none are wanted.
    assert not filled(range(10), periods=0).before(10 * PERIOD_NS, CLOSED).any()


def test_a_loop_that_opened_and_closed_meanwhile_hides_what_was_before():
    past = filled(range(7))
    past.add(7 * PERIOD_NS, np.zeros(2), OPEN)
    past.add(8 * PERIOD_NS, np.ones(2), CLOSED)
    assert not past.before(10 * PERIOD_NS, CLOSED).any()
    assert past.before(11 * PERIOD_NS, CLOSED) == pytest.approx([3e-3, 1.0, 1.0])


def test_remembered_rates_are_their_own():
    past, rates = PastRates(1, PERIOD_NS, 2), np.ones(2)
    past.add(0, rates, CLOSED)
    rates[:] = 5.0
    assert past.before(PERIOD_NS, CLOSED) == pytest.approx([1e-3, 1.0, 1.0])
