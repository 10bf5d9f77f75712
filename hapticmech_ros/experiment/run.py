# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the results of a run: summary.json, the plots of Fig. 5, and those of several users."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hapticmech_ros.experiment.agreement import compare
from hapticmech_ros.experiment.figures import (
    COUPLING,
    FIGURES,
    USERS,
    write_figures,
    write_shared_figures,
)
from hapticmech_ros.experiment.from_session import UnfinishedRunError
from hapticmech_ros.experiment.health import GraphHealth
from hapticmech_ros.experiment.record import ExperimentRecord
from hapticmech_ros.experiment.shared_record import SharedRecord
from hapticmech_ros.experiment.summary import summarise, summarise_shared
from hapticmech_ros.scene import Scene

SUMMARY, FAILURE = "summary.json", "failure.json"
# Figures need some samples.
LEAST_SAMPLES = 10


def write_unfinished(
    failure: UnfinishedRunError, scene: Scene, out_dir: str | os.PathLike[str]
) -> None:
    """Write what an error left of a run: ``failure.json``, and the results until then.

    Args:
        failure: what happened.
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
    agreement: Mapping[str, Any] | None = None,
    reference: ExperimentRecord | None = None,
) -> dict[str, Any]:
    """Write ``summary.json`` and the figures into ``out_dir``, which is created if needed.

    Args:
        record: the run.
        scene: of the run.
        out_dir: folder; files of the same names in it are replaced.
        graph: diagnostics of the nodes, for a run of the graph.
        agreement: from :func:`compare`; included in the summary.
        reference: a run to draw behind this one, such as the session's.

    Returns:
        The summary as written, with the figures' file names under ``figures``.
    """
    folder = Path(out_dir)
    folder.mkdir(parents=True, exist_ok=True)
    summary = summarise(record, scene, graph)
    if agreement is not None:
        summary["agreement"] = dict(agreement)
    return _written(summary, folder, write_figures(record, scene, folder, reference))


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
    folder = Path(out_dir)
    folder.mkdir(parents=True, exist_ok=True)
    summary = summarise_shared(record, scene, graph)
    if reference is not None:
        for point, user in record.users.items():
            summary["users"][point]["agreement"] = compare(user, reference.users[point])
    return _written(summary, folder, write_shared_figures(record, scene, folder, reference))


def _written(summary: dict[str, Any], folder: Path, figures: list[Path]) -> dict[str, Any]:
    summary["figures"] = [str(path.relative_to(folder)) for path in figures]
    text = json.dumps(summary, indent=2, allow_nan=False)
    (folder / FAILURE).unlink(missing_ok=True)  # of an earlier run
    (folder / SUMMARY).write_text(text + "\n", encoding="utf-8")
    return summary
