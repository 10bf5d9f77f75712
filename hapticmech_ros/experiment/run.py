# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the results of a run: summary.json, the plots of Fig. 5, and those of several users.

Deviations of a run of the graph from the session, its reference without ROS.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.experiment.figures import (
    COUPLING,
    FIGURES,
    USERS,
    write_figures,
    write_shared_figures,
)
from hapticmech_ros.experiment.from_session import UnfinishedRunError
from hapticmech_ros.experiment.record import (
    ExperimentRecord,
    GraphHealth,
    SharedRecord,
    angle_between,
    slerp,
)
from hapticmech_ros.experiment.summary import (
    count_changes,
    root_mean_square,
    summarise,
    summarise_shared,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene


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


SUMMARY, FAILURE = "summary.json", "failure.json"
# Figures need some samples.
LEAST_SAMPLES = 10


def write_unfinished(
    failure: UnfinishedRunError, scene: Scene, out_dir: str | os.PathLike[str]
) -> None:
    """Write ``failure.json`` of a failed run, and its results until then.

    Args:
        failure: the error.
        scene: of the run.
        out_dir: folder; files of the names of a run in it are replaced or removed.
    """
    folder = Path(out_dir)
    folder.mkdir(parents=True, exist_ok=True)
    for name in (SUMMARY, USERS, COUPLING, *FIGURES):
        (folder / name).unlink(missing_ok=True)
    record = failure.record
    if isinstance(record, SharedRecord):
        if record.first.times.size >= LEAST_SAMPLES:
            write_shared_results(record, scene, folder)
    elif record is not None and record.times.size >= LEAST_SAMPLES:
        write_results(record, scene, folder)
    found = {
        "error": str(failure),
        "time_s": failure.time,
        "joint": failure.joint,
        "last_state_time_s": failure.good_time,
        "last_state": {"q": failure.positions, "v": failure.velocities},
    }
    (folder / FAILURE).write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


def write_results(
    record: ExperimentRecord,
    scene: Scene,
    out_dir: str | os.PathLike[str],
    graph: GraphHealth | None = None,
    reference: ExperimentRecord | None = None,
) -> dict[str, Any]:
    """Write ``summary.json`` and the figures into ``out_dir``, which is created if needed.

    Args:
        record: the run.
        scene: of the run.
        out_dir: folder; files of the same names in it are replaced.
        graph: diagnostics of the nodes, for a run of the graph.
        reference: a run to draw behind this one and to compare it with, such as the session's.

    Returns:
        The summary as written, with the figures' file names under ``figures``.

    Raises:
        InvalidInputError: a reference of another scene or another point.
    """
    summary = summarise(record, scene, graph)
    if reference is not None:
        summary["agreement"] = compare(record, reference)
    return _written(
        summary, Path(out_dir), lambda folder: write_figures(record, scene, folder, reference)
    )


def write_shared_results(
    record: SharedRecord,
    scene: Scene,
    out_dir: str | os.PathLike[str],
    graph: GraphHealth | None = None,
    reference: SharedRecord | None = None,
) -> dict[str, Any]:
    """Write ``summary.json`` and the figures of a run of several users into ``out_dir``.

    Args:
        record: the run.
        scene: of the run.
        out_dir: folder, made if needed; files of the same names in it are replaced.
        graph: diagnostics of the nodes, for a run of the graph.
        reference: a run to draw behind this one and to compare it with, such as the session's.

    Returns:
        The summary as written, with the figures' file names under ``figures``.

    Raises:
        InvalidInputError: a reference of another scene or other points.
    """
    summary = summarise_shared(record, scene, graph)
    if reference is not None:
        for point, user in record.users.items():
            summary["users"][point]["agreement"] = compare(user, reference.users[point])
    return _written(
        summary,
        Path(out_dir),
        lambda folder: write_shared_figures(record, scene, folder, reference),
    )


def _written(
    summary: dict[str, Any], folder: Path, draw: Callable[[Path], list[Path]]
) -> dict[str, Any]:
    folder.mkdir(parents=True, exist_ok=True)
    summary["figures"] = [str(path.relative_to(folder)) for path in draw(folder)]
    text = json.dumps(summary, indent=2, allow_nan=False)
    (folder / FAILURE).unlink(missing_ok=True)  # of an earlier run
    (folder / SUMMARY).write_text(text + "\n", encoding="utf-8")
    return summary
