# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Summary of the experiment for JSON. Keys contain their units; unknown values are None.

The summary covers the time after the hand starts to push (t >= 0); changes of the count are listed
from the record's start.

A record's coverage is its start, end and pauses of each group of samples. If a recorder discovers a
publisher late or a node stops early, averages over the record are misleading, which only its
coverage shows.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from hapticmech_ros.experiment.record import (
    ExperimentRecord,
    GraphHealth,
    Grips,
    SharedRecord,
    angle_between,
    grips_of,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene

# Pauses longer than this (s) make a record incomplete: ten samples of the topics at view rate.
LONGEST_PAUSE_S = 0.1
# A control loop whose rate is too low for its gains oscillates within about this time.
WINDOW_S = 0.03

GROUPS = {
    "device and point": "times",
    "constraint wrench": "wrench_times",
    "analysis": "analysis_times",
    "energy": "energy_times",
}


def coverage(record: ExperimentRecord) -> dict[str, Any]:
    """Return the coverage of the run by samples, from the hand's push to the record's end.

    ``complete`` is true if no group pauses for longer than :data:`LONGEST_PAUSE_S`; ``groups``
    gives first and last time, longest pause (including both ends), number of samples, and their
    least rate over :data:`WINDOW_S`.
    """
    times = {what: getattr(record, name) for what, name in GROUPS.items()}
    end = max(float(one[-1]) for one in times.values() if one.size)
    groups = {what: _group(one, end) for what, one in times.items()}
    # Tolerance of 1 ns for the rounding of times that are sums of periods.
    limit = LONGEST_PAUSE_S + 1e-9
    complete = all(group["longest_pause_s"] <= limit for group in groups.values())
    return {"complete": complete, "groups": groups}


def _group(times: Array, end: float) -> dict[str, Any]:
    started = times[times >= 0.0]
    edges = np.concatenate(([0.0], started, [end]))
    return {
        "samples": int(started.size),
        "first_s": float(started[0]) if started.size else None,
        "last_s": float(started[-1]) if started.size else None,
        "longest_pause_s": float(np.diff(edges).max()),
        "slowest_rate_hz": _slowest_rate(edges),
    }


def _slowest_rate(times: Array) -> float | None:
    """Return the least rate of samples, 1/s, over windows that begin at a sample."""
    starts = times[times + WINDOW_S <= times[-1]]
    if not starts.size:
        return None
    # Tolerance of 0.5 ns for the rounding of times that are sums of periods.
    ends = np.searchsorted(times, starts + WINDOW_S + 5e-10, side="right")
    counts = ends - np.searchsorted(times, starts, side="right")
    return float(counts.min() / WINDOW_S)


Json = dict[str, Any]

# Intervals between device samples longer than this many periods are counted as gaps.
GAP_PERIODS = 1.5


def summarise(record: ExperimentRecord, scene: Scene, graph: GraphHealth | None = None) -> Json:
    """Return the summary of a run.

    Args:
        record: the run.
        scene: of the run.
        graph: diagnostics of the nodes, for a run of the graph.
    """
    summary: Json = {
        "scene": record.scene,
        "operational_point": record.point,
        "source": record.source,
        "duration_s": float(record.times[-1]),
        "device_samples": int(record.times.size),
        "coverage": coverage(record),
        "constraints": _constraints(record),
        "tracking": _tracking(record),
        "closure_error_max_m_or_rad": (
            _largest(record.closure_error[record.energy_times >= 0.0]) if scene.closures else None
        ),
        "energy": _energy(record),
        "gains": {
            "constraint_stiffness_n_per_m": scene.controller.joint_constraint.stiffness,
            "constraint_feedforward": scene.controller.joint_constraint.feedforward,
        },
    }
    if record.source == "graph":
        summary["graph"] = _graph(record, graph or GraphHealth({}))
    return summary


def count_changes(record: ExperimentRecord) -> list[Json]:
    """Return the changes of the constraint count: ``time_s``, ``from``, ``to``."""
    where = np.flatnonzero(np.diff(record.count)) + 1
    return [
        {
            "time_s": float(record.analysis_times[i]),
            "from": int(record.count[i - 1]),
            "to": int(record.count[i]),
        }
        for i in where
    ]


def pose_errors(record: ExperimentRecord) -> tuple[Array, Array]:
    """Return (n,) distance (m) and (n,) angle (rad) from operational point to device."""
    apart = np.linalg.norm(record.device_position - record.point_position, axis=1)
    return np.asarray(apart), angle_between(record.device_orientation, record.point_orientation)


def root_mean_square(values: Array) -> float | None:
    """Return the rms of the norms of rows, or of numbers; None if there are none.

    Args:
        values: (n, k) rows or (n,) numbers.
    """
    if values.shape[0] == 0:
        return None
    squares = values**2 if values.ndim == 1 else np.sum(values**2, axis=1)
    return float(np.sqrt(np.mean(squares)))


def _constraints(record: ExperimentRecord) -> Json:
    started = record.analysis_times >= 0.0
    seen = sorted({int(count) for count in record.count[started]})
    return {
        "counts_seen": seen,
        "changes": count_changes(record),
        "while_held": [_while_held(record, count) for count in seen],
    }


def _while_held(record: ExperimentRecord, count: int) -> Json:
    """Return the wrench on the user during a constraint count, and its expected value."""
    times = record.wrench_times
    index = np.searchsorted(record.analysis_times, times, side="right") - 1
    chosen = (index >= 0) & (times >= 0.0)
    chosen &= record.count[np.maximum(index, 0)] == count
    felt = record.constraint_wrench[chosen]
    expected = np.column_stack(
        [
            np.interp(times[chosen], record.analysis_times, record.expected_wrench[:, axis])
            for axis in range(6)
        ]
    )
    force, torque = root_mean_square(felt[:, :3]), root_mean_square(felt[:, 3:])
    expected_force = root_mean_square(expected[:, :3])
    expected_torque = root_mean_square(expected[:, 3:])
    return {
        "count": count,
        "samples": int(np.count_nonzero(chosen)),
        "held_s": _held_time(record, count),
        "force_rms_n": force,
        "force_max_n": _largest(np.linalg.norm(felt[:, :3], axis=1)),
        "torque_rms_nm": torque,
        "expected_force_rms_n": expected_force,
        "expected_torque_rms_nm": expected_torque,
        "force_to_expected_ratio": _ratio(force, expected_force),
        "torque_to_expected_ratio": _ratio(torque, expected_torque),
        "force_gain_median": _typical_gain(felt[:, :3], expected[:, :3]),
        "force_difference_rms_n": root_mean_square(felt[:, :3] - expected[:, :3]),
        "torque_difference_rms_nm": root_mean_square(felt[:, 3:] - expected[:, 3:]),
    }


def _typical_gain(felt: Array, expected: Array) -> float | None:
    """Return the median of felt·expected / |expected|² over samples (n, 3); None if there are none.

    The median is insensitive to oscillations and to samples next to a change of count, which enter
    a ratio of rms values with their squares. Samples below half the expected rms are not used.
    """
    sizes = np.sum(expected**2, axis=1)
    strong = (sizes > 0.0) & (sizes >= 0.25 * np.mean(sizes)) if sizes.size else sizes > 0.0
    if not strong.any():
        return None
    return float(np.median(np.sum(felt * expected, axis=1)[strong] / sizes[strong]))


def _held_time(record: ExperimentRecord, count: int) -> float:
    """Return the duration of a constraint count after the hand's start, s."""
    started = record.analysis_times >= 0.0
    times, counts = record.analysis_times[started], record.count[started]
    return float(np.sum(np.diff(times)[counts[:-1] == count]))


def _tracking(record: ExperimentRecord) -> Json:
    started = record.times >= 0.0
    distance, angle = (error[started] for error in pose_errors(record))
    return {
        "position_error_rms_m": root_mean_square(distance),
        "position_error_max_m": _largest(distance),
        "position_error_end_m": float(distance[-1]) if distance.size else None,
        "rotation_error_rms_rad": root_mean_square(angle),
        "rotation_error_max_rad": _largest(angle),
        "rotation_error_end_rad": float(angle[-1]) if angle.size else None,
    }


def _energy(record: ExperimentRecord) -> Json:
    if record.energy_times.size == 0:
        keys = ("balance_error_max_j", "balance_error_relative", "exchanged_j")
        return dict.fromkeys(keys)
    balance = record.energy_balance
    worst = float(np.abs(balance - balance[0]).max())
    exchanged = float(np.abs(np.diff(record.work_in)).sum())
    return {
        "balance_error_max_j": worst,
        "balance_error_relative": _ratio(worst, exchanged),
        "exchanged_j": exchanged,
        "work_in_j": float(record.work_in[-1] - record.work_in[0]),
        "damping_loss_j": float(record.damping_loss[-1] - record.damping_loss[0]),
        "latch_loss_j": float(record.latch_loss[-1] - record.latch_loss[0]),
        "surplus_j": float(record.surplus[-1] - record.surplus[0]),
        "steps_refined": int(record.refined[-1]),
        "steps_inaccurate": int(record.inaccurate[-1]),
    }


def _graph(record: ExperimentRecord, health: GraphHealth) -> Json:
    intervals = np.diff(record.times)
    span = float(record.times[-1] - record.times[0])
    lost = health.lost
    latency = {name: health.one(f"loop_latency_{name}_us") for name in ("p50", "p90", "p99", "max")}
    return {
        "nominal_rate_hz": 1.0 / record.period,
        "lockstep": health.lockstep,
        "measured_rate_hz": intervals.size / span if span > 0.0 else None,
        "measured_interval_max_ms": _largest(1e3 * intervals),
        "measured_gaps": int(np.count_nonzero(intervals > GAP_PERIODS * record.period)),
        "missed_deadlines": health.total("missed_deadlines"),
        "losses": health.total("losses"),
        "losses_by_pauses": _sum(
            health.total("lost_without_processor"), health.total("lost_while_sender_paused")
        ),
        "interruptions": health.interruptions,
        "reduced_gains": health.reduced_gains,
        "recorder_lost": None if lost is None else sum(count or 0 for count in lost.values()),
        "recorder_lost_by_topic": dict(lost or {}),
        **{f"loop_latency_{name}_us": value for name, value in latency.items()},
        "nodes": {
            name: {"level": node.level, "message": node.message, **node.figures}
            for name, node in health.nodes.items()
        },
    }


def _sum(*values: float | None) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) if known else None


def _largest(values: Array) -> float | None:
    return float(np.max(values)) if values.size else None


def _ratio(value: float | None, reference: float | None) -> float | None:
    return None if value is None or not reference else value / reference


def summarise_shared(record: SharedRecord, scene: Scene, graph: GraphHealth | None = None) -> Json:
    """Return the summary of a run of several users.

    Args:
        record: the run.
        scene: of the run.
        graph: diagnostics of the nodes, for a run of the graph.
    """
    health = graph or GraphHealth({})
    return {
        "scene": record.scene,
        "source": record.source,
        "duration_s": float(record.first.times[-1]),
        "users": {
            point: summarise(user, scene.held_at(point), _of_user(health, point))
            for point, user in record.users.items()
        },
        "spans": [_span(record, span) for span in grips_of(scene, float(record.first.times[-1]))],
    }


def _of_user(health: GraphHealth, point: str) -> GraphHealth:
    """Return the health of the nodes that one user has, the mechanism's included."""
    nodes = {
        name: node
        for name, node in health.nodes.items()
        if "/" not in name or name.rpartition("/")[0].rpartition("/")[2] == point
    }
    return replace(health, nodes=nodes)


def _span(record: SharedRecord, span: Grips) -> Json:
    """Return each user's motion and felt wrenches while the same hands hold."""
    return {
        "begin_s": span.begin,
        "end_s": span.end,
        "holding": list(span.holding),
        "users": {point: _user(record, point, span) for point in record.points},
    }


def _user(record: SharedRecord, point: str, span: Grips) -> Json:
    user, index = record.users[point], record.points.index(point)
    coupled, own = _during(record.times, span), record.coupling[:, index, index]
    counts = user.count[_during(user.analysis_times, span)]
    moved = user.device_position - user.device_position[0]
    found: Json = {
        "displacement_max_m": _largest(np.linalg.norm(moved[_during(user.times, span)], axis=1)),
        "hand_force_rms_n": root_mean_square(user.hand_wrench[_during(user.times, span), :3]),
        "by_others_force_rms_n": root_mean_square(record.felt[coupled, index, :3]),
        "counts_seen": sorted({int(count) for count in counts}),
        "count_at_end": int(counts[-1]) if counts.size else None,
        "mass_least_kg": _ratio(
            1.0, _largest(np.linalg.norm(own[coupled][:, :3, :3], 2, axis=(1, 2)))
        ),
    }
    accelerations = record.accelerations(point)[coupled, :, :3]
    found["acceleration_rms_m_per_s2"] = {
        other: root_mean_square(accelerations[:, place])
        for place, other in enumerate(record.points)
    }
    return found


def _during(times: Array, span: Grips) -> Array:
    return np.asarray((times >= span.begin) & (times < span.end))
