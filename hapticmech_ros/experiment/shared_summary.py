# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Summary of an experiment of several users, for JSON: each, and what they do to each other."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.experiment.grips import Grips, grips_of
from hapticmech_ros.experiment.health import GraphHealth
from hapticmech_ros.experiment.shared_record import SharedRecord
from hapticmech_ros.experiment.summary import root_mean_square, summarise
from hapticmech_ros.scene import Scene

Json = dict[str, Any]


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
    """Return what each user does and feels while the same hands hold."""
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
        "displacement_max_m": _largest(moved[_during(user.times, span)]),
        "hand_force_rms_n": root_mean_square(user.hand_wrench[_during(user.times, span), :3]),
        "by_others_force_rms_n": root_mean_square(record.felt[coupled, index, :3]),
        "counts_seen": sorted({int(count) for count in counts}),
        "count_at_end": int(counts[-1]) if counts.size else None,
        "mass_least_kg": _ratio(1.0, _largest_singular_value(own[coupled])),
    }
    accelerations = record.accelerations(point)[coupled, :, :3]
    found["acceleration_rms_m_per_s2"] = {
        other: root_mean_square(accelerations[:, place])
        for place, other in enumerate(record.points)
    }
    return found


def _during(times: Array, span: Grips) -> Array:
    return np.asarray((times >= span.begin) & (times < span.end))


def _largest(rows: Array) -> float | None:
    return float(np.linalg.norm(rows, axis=1).max()) if rows.size else None


def _largest_singular_value(matrices: Array) -> float | None:
    """Return that of the translation blocks of (k, 6, 6)."""
    return (
        float(np.linalg.norm(matrices[:, :3, :3], 2, axis=(1, 2)).max()) if matrices.size else None
    )


def _ratio(value: float, reference: float | None) -> float | None:
    return None if not reference else value / reference
