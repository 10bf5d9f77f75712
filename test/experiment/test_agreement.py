# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Deviations between records with known answers."""

import numpy as np
import pytest

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.experiment import compare


def test_a_record_agrees_with_itself(session_record):
    agreement = compare(session_record, session_record)
    apart = [value for key, value in agreement.items() if "_deviation_" in key]
    assert apart == [0.0] * 8
    assert agreement["count_change_differences_s"] == [0.0]
    assert agreement["same_sequence_of_counts"] is True
    assert agreement["span_s"] == pytest.approx(2.5, abs=1e-12)


def test_shift_and_turn(handmade):
    n = 1001
    half = np.deg2rad(0.5) / 2
    graph = handmade(
        source="graph",
        device_position=np.tile((0.0, 3e-3, 4e-3), (n, 1)),
        point_orientation=np.tile((np.sin(half), 0.0, 0.0, np.cos(half)), (n, 1)),
    )
    agreement = compare(graph, handmade())
    for key in ("max", "rms"):
        assert agreement[f"device_deviation_{key}_mm"] == pytest.approx(5.0, rel=1e-13)
        assert agreement[f"device_deviation_{key}_deg"] == 0.0
        assert agreement[f"point_deviation_{key}_mm"] == 0.0
        assert agreement[f"point_deviation_{key}_deg"] == pytest.approx(0.5, rel=1e-12)


def test_session_is_interpolated_at_the_graphs_times(handmade):
    """A steady motion sampled at other times does not deviate."""
    times = handmade().times
    later = times + 0.0037

    def moving(at, **more):
        angle = 0.3 * at
        turn = np.column_stack((np.zeros((at.size, 2)), np.sin(angle / 2), np.cos(angle / 2)))
        return handmade(
            times=at,
            device_position=np.outer(at, (0.1, 0.2, 0.3)),
            device_orientation=turn,
            **more,
        )

    agreement = compare(moving(later, source="graph"), moving(times))
    assert agreement["device_deviation_max_mm"] < 1e-12
    assert agreement["device_deviation_max_deg"] < 1e-12
    # The last of the graph's times lies beyond the session's, those before the push do not count.
    assert agreement["samples"] == 900


def test_count_changes_one_by_one(handmade):
    times = handmade().times

    def counts(*changes):
        return np.select([times < c for c in changes], range(1, len(changes) + 1), 9)

    late = compare(handmade(count=counts(2.02, 5.0)), handmade(count=counts(2.0, 5.01)))
    assert late["count_change_differences_s"] == pytest.approx([0.02, -0.01], abs=1e-12)
    assert late["count_change_difference_max_s"] == pytest.approx(0.02, abs=1e-12)
    assert late["same_sequence_of_counts"] is True
    missing = compare(handmade(), handmade(count=counts(2.0)))
    assert missing["same_sequence_of_counts"] is False
    assert missing["count_change_differences_s"] == []
    assert missing["count_change_difference_max_s"] is None


@pytest.mark.parametrize(
    ("changes", "rule"),
    [
        ({"scene": "other"}, "scene of the graph's record"),
        ({"point": "other"}, "point of the graph's record"),
        ({"times": 100.0 + np.arange(-100, 901) / 100.0}, "common span"),
    ],
)
def test_refuses_what_cannot_be_compared(handmade, changes, rule):
    with pytest.raises(InvalidInputError, match=rule):
        compare(handmade(**changes), handmade())
