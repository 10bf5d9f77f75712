# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech study``: a scene measured over ranges of its keys."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hapticmech_ros.cli.console import (
    ChangesOption,
    OutOption,
    PointOption,
    SceneArgument,
    errors,
    progress,
    words,
)
from hapticmech_ros.cli.study import ClusterOption, JsonOption, ProcessesOption, report, workers_of


def study(
    scene: SceneArgument,
    vary: Annotated[
        list[str],
        typer.Option(
            metavar="KEY=...",
            help="FROM:TO:NUMBER, FROM:TO with --samples, either with :log, or VALUE,VALUE",
        ),
    ],
    samples: Annotated[
        int, typer.Option(help="scenes of a Latin hypercube; 0: a grid of all values", min=0)
    ] = 0,
    seed: Annotated[int, typer.Option(help="of the Latin hypercube", min=0)] = 0,
    measure: Annotated[
        str, typer.Option(help="felt, limits, experiment, or module:function, with commas")
    ] = "felt",
    point: PointOption = "",
    processes: ProcessesOption = 2,
    cluster: ClusterOption = "",
    changes: ChangesOption = None,
    out: OutOption = Path("study"),
    json_only: JsonOption = False,
) -> None:
    """Measure a scene with keys varied, in a grid or a Latin hypercube; goes on where it was."""
    from hapticmech_ros.study import Design, Variation, run_study

    design = Design(tuple(map(Variation.read, vary)), samples, seed)
    with workers_of(processes, cluster) as workers, progress(errors) as bar:
        task = bar.add_task("measuring", total=len(design))
        found = run_study(
            scene,
            design,
            words(measure),
            point,
            changes or (),
            out,
            workers,
            lambda done, total: bar.update(task, completed=done, total=total),
        )
    found.write(out)
    report(found, out, json_only)
