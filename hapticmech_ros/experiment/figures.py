# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the plots of Fig. 5, and those of several users."""

from __future__ import annotations

import os
from pathlib import Path

from hapticmech_ros.experiment.figure_count import count_figure
from hapticmech_ros.experiment.figure_coupling import coupling_figure
from hapticmech_ros.experiment.figure_style import save
from hapticmech_ros.experiment.figure_trajectory import trajectory_figure
from hapticmech_ros.experiment.figure_users import users_figure
from hapticmech_ros.experiment.figure_wrench import wrench_figure
from hapticmech_ros.experiment.record import ExperimentRecord
from hapticmech_ros.experiment.shared_record import SharedRecord
from hapticmech_ros.scene import Scene

FIGURES = {
    "fig5a.png": count_figure,
    "fig5b.png": trajectory_figure,
    "fig5c.png": wrench_figure,
}
USERS, COUPLING = "users.png", "coupling.png"


def write_figures(
    record: ExperimentRecord,
    scene: Scene,
    out_dir: str | os.PathLike[str],
    reference: ExperimentRecord | None = None,
) -> list[Path]:
    """Write ``fig5a.png``, ``fig5b.png`` and ``fig5c.png`` into ``out_dir``.

    Args:
        record: the run.
        scene: of the run.
        out_dir: existing folder; files of the same names are replaced.
        reference: a run to draw behind this one, in grey.

    Returns:
        Paths of the figures.
    """
    folder = Path(out_dir)
    return [save(draw(record, scene, reference), folder / name) for name, draw in FIGURES.items()]


def write_shared_figures(
    record: SharedRecord,
    scene: Scene,
    out_dir: str | os.PathLike[str],
    reference: SharedRecord | None = None,
) -> list[Path]:
    """Write ``users.png`` and ``coupling.png``, and each user's figures into a folder of its own.

    Args:
        record: the run.
        scene: of the run.
        out_dir: existing folder; files of the same names are replaced.
        reference: a run to draw behind this one, in grey.

    Returns:
        Paths of the figures.
    """
    folder = Path(out_dir)
    paths = [
        save(users_figure(record, scene, reference), folder / USERS),
        save(coupling_figure(record, scene), folder / COUPLING),
    ]
    for point, user in record.users.items():
        (folder / point).mkdir(exist_ok=True)
        behind = None if reference is None else reference.users[point]
        paths += write_figures(user, scene.held_at(point), folder / point, behind)
    return paths
