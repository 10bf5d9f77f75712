# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Options that studies share, and the command line's output of their results.

``hapticmech study``: a scene measured over ranges of its keys.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from hapticmech_ros.cli.console import console, errors, words
from hapticmech_ros.errors import InvalidInputError

if TYPE_CHECKING:
    from hapticmech_ros.analysis.study import Results, Show
    from hapticmech_ros.system.workers import Workers
from hapticmech_ros.cli.console import (
    ChangesOption,
    OutOption,
    PointOption,
    SceneArgument,
    progress_of,
    say,
)


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
    """Measure a scene with keys varied, in a grid or a Latin hypercube; resumes if interrupted."""
    from hapticmech_ros.study import Design, Variation, run_study

    design = Design(tuple(map(Variation.read, vary)), samples, seed)
    with workers_of(processes, cluster) as workers, progress_of("measuring") as show:
        found = run_study(scene, design, words(measure), point, changes or (), out, workers, show)
    found.write(out)
    report(found, out, json_only)


Number = TypeVar("Number", int, float)

JsonOption = Annotated[
    bool, typer.Option("--json", help="print the results as JSON, and nothing else")
]
FigureOption = Annotated[
    Path | None, typer.Option(help="where the plot goes", show_default="in the folder")
]
ProcessesOption = Annotated[int, typer.Option(help="number of processes", min=1)]
ClusterOption = Annotated[
    str, typer.Option(help="tcp://HOST:PORT of a Dask scheduler, in place of processes here")
]


def workers_of(processes: int, address: str) -> AbstractContextManager[Workers]:
    """Return who shares the work: processes of this machine, or of a cluster if it has an address.

    Raises:
        HapticMechError: as :func:`hapticmech_ros.system.workers.cluster`, which is entered here.
    """
    from hapticmech_ros.system.workers import cluster

    return cluster(address) if address else nullcontext(processes)


def carry_out(
    run: Callable[[Show], Results], out: Path, json_only: bool, figure: Path | None = None
) -> None:
    """Run a study, write its results, and print them.

    Args:
        run: called with a callback for progress.
        out: folder for the results.
        json_only: print JSON and nothing else; progress goes to standard error.
        figure: path of the first figure; in the folder if None.

    Raises:
        typer.Exit: with 1, where the results are not sound.
    """
    # Lines, not a bar: nothing of this process shall run while something is measured.
    results = run(partial(say, where=errors if json_only else console))
    results.write(out, figure)
    report(results, out, json_only)


def report(results: Results, out: Path, json_only: bool) -> None:
    """Print results.

    Args:
        results: that were written.
        out: folder in which they are.
        json_only: print JSON and nothing else.

    Raises:
        typer.Exit: with 1, where the results are not sound.
    """
    if json_only:
        import json

        print(json.dumps(results.document(), ensure_ascii=False))
    else:
        for sheet in results.sheets():
            console.print(sheet)
        for line in (*results.notes(), f"results: {out.resolve()}"):
            say(line)
    if not results.sound:
        say(results.FAULT, "red", errors)
        raise typer.Exit(1)


def numbers(option: str, text: str, kind: Callable[[str], Number]) -> list[Number]:
    """Return the numbers between the commas of an option.

    Raises:
        InvalidInputError: one is none.
    """
    try:
        return [kind(word) for word in words(text)]
    except ValueError:
        rule = "must be whole numbers" if kind is int else "must be numbers"
        raise InvalidInputError(option, text, f"{rule} with commas between") from None
