# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a record accepts."""

import numpy as np
import pytest

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.wire.messages import ENERGY_NAMES


def test_arrays_are_copies_and_read_only(handmade):
    times = np.arange(-100, 901) / 100.0
    record = handmade(times=times)
    times[0] = -99.0
    assert record.times[0] == -1.0
    for name in ("times", "device_position", "count", "joint_positions"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(record, name)[0] = 1
    with pytest.raises(AttributeError):
        record.times = times


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"times": np.zeros(1001)}, r"times\[1\]: must increase"),
        ({"device_position": np.zeros((1000, 3))}, "rows of device_position: .* 1001 times"),
        ({"device_position": np.zeros((1001, 2))}, "columns of device_position: must be 3"),
        ({"count": np.zeros((1001, 1))}, "dimensions of count: must be 1"),
        ({"hand_wrench": np.full((1001, 6), np.nan)}, r"hand_wrench\[0, 0\]: must be finite"),
        ({"point_orientation": np.ones((1001, 4))}, r"length of point_orientation\[0\]"),
        (
            {"wrench_times": np.zeros(0), "constraint_wrench": np.zeros((0, 6))},
            "wrench_times: must hold at least one time",
        ),
    ],
)
def test_refuses(handmade, changes, message):
    with pytest.raises(InvalidInputError, match=message):
        handmade(**changes)


def test_may_lack_energies_and_joints(handmade):
    none = np.zeros(0)
    record = handmade(
        energy_times=none,
        **dict.fromkeys(ENERGY_NAMES, none),
        joint_times=none,
        joint_positions=np.zeros((0, 4)),
    )
    assert record.energy_balance.size == 0


def test_energy_balance_is_held_less_taken_plus_lost(handmade):
    ones = np.ones(101)
    record = handmade(
        kinetic=3 * ones,
        potential=5 * ones,
        work_in=7 * ones,
        damping_loss=11 * ones,
        latch_loss=13 * ones,
    )
    assert (record.energy_balance == 3 + 5 - 7 + 11 + 13).all()
