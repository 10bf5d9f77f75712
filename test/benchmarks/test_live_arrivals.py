# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""When the force of a jump of the mouse has come."""

import numpy as np
import pytest

from benchmarks.children import BenchError
from benchmarks.live.over_graph import STILL_S, arrivals

# s: a wrench every 5 ms, and when the mouse jumped.
TIMES = np.arange(0.0, 1.2, 0.005)
SENT = np.array([0.1, 0.1 + 1.1 * STILL_S])


def rows_of(first, second):
    """Return wrenches that change along x, then along y, by functions of the time since then."""
    since = TIMES[:, None] - SENT
    x = np.where(since[:, 0] > 0.0, first(since[:, 0]), 0.0)
    y = np.where(since[:, 1] > 0.0, second(since[:, 1]), 0.0)
    return np.column_stack((TIMES, x, y))


def test_it_has_come_with_the_first_wrench_that_has_half_of_it():
    step = rows_of(lambda t: 0.3 * (t > 0.032), lambda t: -0.2 * (t > 0.051))
    assert arrivals(step, SENT) - SENT == pytest.approx([0.035, 0.055])
    slope = rows_of(lambda t: np.clip(t, 0.0, 0.1), lambda t: np.clip(2.0 * t, 0.0, 0.1))
    assert arrivals(slope, SENT) - SENT == pytest.approx([0.055, 0.03], abs=0.0051)


def test_a_jump_without_a_force_is_no_time():
    with pytest.raises(BenchError, match="jump 1 of the mouse had no force"):
        arrivals(rows_of(lambda t: 0.3 * (t > 0.03), lambda t: 0.001 * t), SENT)
