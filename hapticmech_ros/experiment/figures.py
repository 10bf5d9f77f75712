# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the plots of Fig. 5."""

from __future__ import annotations

import os
from pathlib import Path

from hapticmech_ros.experiment.figure_count import count_figure
from hapticmech_ros.experiment.figure_style import save
from hapticmech_ros.experiment.figure_trajectory import trajectory_figure
from hapticmech_ros.experiment.figure_wrench import wrench_figure
from hapticmech_ros.experiment.record import ExperimentRecord
from hapticmech_ros.scene import Scene

FIGURES = {
    "fig5a.png": count_figure,
    "fig5b.png": trajectory_figure,
    "fig5c.png": wrench_figure,
}


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
