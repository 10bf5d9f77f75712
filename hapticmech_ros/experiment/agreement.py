# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Deviations of a run of the graph from the session, its reference without ROS."""

from __future__ import annotations

from typing import Any

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.experiment.record import ExperimentRecord, angle_between, slerp
from hapticmech_ros.experiment.summary import count_changes, root_mean_square


def compare(graph: ExperimentRecord, session: ExperimentRecord) -> dict[str, Any]:
    """Return deviations of ``graph`` from ``session`` after the hand's start, ready for JSON.

    Both are aligned to the hand's first push; the session is interpolated at the graph's times
    within the common span. The n-th changes of the constraint count are compared one by one, as
    graph minus session.

    Raises:
        InvalidInputError: different scenes or points, or no common span.
    """
    for name in ("scene", "point"):
        if getattr(graph, name) != getattr(session, name):
            rule = f"must be the session's, {getattr(session, name)!r}"
            raise InvalidInputError(f"{name} of the graph's record", getattr(graph, name), rule)
    start = max(0.0, float(session.times[0]))
    end = min(float(graph.times[-1]), float(session.times[-1]))
    chosen = (graph.times >= start) & (graph.times <= end)
    if not chosen.any():
        raise InvalidInputError("common span", (start, end), "must hold samples of the graph")
    times = graph.times[chosen]
    result: dict[str, Any] = {
        "span_s": float(times[-1] - times[0]),
        "samples": int(times.size),
    }
    for body in ("device", "point"):
        apart, angle = _deviations(graph, session, body, chosen)
        result[f"{body}_deviation_max_mm"] = 1e3 * float(apart.max())
        result[f"{body}_deviation_rms_mm"] = 1e3 * (root_mean_square(apart) or 0.0)
        result[f"{body}_deviation_max_deg"] = float(np.degrees(angle.max()))
        result[f"{body}_deviation_rms_deg"] = float(np.degrees(root_mean_square(angle) or 0.0))
    return {**result, **_changes(graph, session, end)}


def _deviations(
    graph: ExperimentRecord, session: ExperimentRecord, body: str, chosen: Array
) -> tuple[Array, Array]:
    """Return distances (m) and angles (rad) between both runs at the graph's chosen times."""
    times = graph.times[chosen]
    reference = getattr(session, f"{body}_position")
    position = np.column_stack(
        [np.interp(times, session.times, reference[:, axis]) for axis in range(3)]
    )
    apart = np.linalg.norm(getattr(graph, f"{body}_position")[chosen] - position, axis=1)
    orientation = slerp(times, session.times, getattr(session, f"{body}_orientation"))
    return np.asarray(apart), angle_between(
        getattr(graph, f"{body}_orientation")[chosen], orientation
    )


def _changes(graph: ExperimentRecord, session: ExperimentRecord, end: float) -> dict[str, Any]:
    ours, theirs = (
        [change for change in count_changes(record) if change["time_s"] <= end]
        for record in (graph, session)
    )
    differences = [a["time_s"] - b["time_s"] for a, b in zip(ours, theirs, strict=False)]
    return {
        "same_sequence_of_counts": [(c["from"], c["to"]) for c in ours]
        == [(c["from"], c["to"]) for c in theirs],
        "count_change_differences_s": differences,
        "count_change_difference_max_s": max(map(abs, differences)) if differences else None,
    }
