# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Holes in a record are found wherever they are."""

import numpy as np
import pytest

from hapticmech_ros.experiment.summary import coverage
from hapticmech_ros.wire.messages import ENERGY_NAMES


def wrenches(times):
    return {"wrench_times": times, "constraint_wrench": np.zeros((times.size, 6))}


def test_whole_record(handmade):
    found = coverage(handmade())
    assert found["complete"] is True
    assert found["groups"]["device and point"] == {
        "samples": 901,
        "first_s": 0.0,
        "last_s": 9.0,
        "longest_pause_s": pytest.approx(0.01, abs=1e-12),
        "slowest_rate_hz": pytest.approx(100.0, rel=1e-12),
    }
    assert found["groups"]["energy"]["longest_pause_s"] == pytest.approx(0.1, abs=1e-12)


@pytest.mark.parametrize(
    ("times", "pause"),
    [
        (np.arange(150, 901) / 100, 1.5),
        (np.arange(-100, 601) / 100, 3.0),
        (np.concatenate((np.arange(0, 200), np.arange(450, 901))) / 100, 2.51),
        (np.array((-0.5,)), 9.0),
    ],
)
def test_holes_at_the_start_the_end_and_in_between(handmade, times, pause):
    found = coverage(handmade(**wrenches(times)))
    assert found["complete"] is False
    group = found["groups"]["constraint wrench"]
    assert group["longest_pause_s"] == pytest.approx(pause, abs=1e-12)


def test_the_slowest_stretch_is_found_though_no_pause_is_long(handmade):
    even, sparse = np.arange(0, 9001) / 1000, np.arange(251, 300, 7) / 1000
    kept = (even <= 0.25) | (even >= 0.3)
    times = np.sort(np.concatenate((even[kept], sparse)))
    group = coverage(handmade(**wrenches(times)))["groups"]["constraint wrench"]
    assert group["longest_pause_s"] == pytest.approx(0.007, abs=1e-12)
    # After 251 ms, within 30 ms: 258, 265, 272 and 279 ms.
    assert group["slowest_rate_hz"] == pytest.approx(4 / 0.03, rel=1e-12)


def test_no_energy_at_all(handmade):
    none = np.zeros(0)
    found = coverage(handmade(energy_times=none, **dict.fromkeys(ENERGY_NAMES, none)))
    assert found["complete"] is False
    assert found["groups"]["energy"]["first_s"] is None
