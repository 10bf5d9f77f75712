# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech demo`` and ``hapticmech experiment``: the experiment with and without ROS."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from hapticmech_ros.cli.console import (
    ChangesOption,
    ComposedOption,
    OutOption,
    SceneArgument,
    console,
    errors,
    progress,
    say,
    vector_of,
    with_changes,
    words,
)
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.system.installation import refuse_without_ros

if TYPE_CHECKING:
    from hapticmech_ros.experiment import ExperimentRecord, SharedRecord
    from hapticmech_ros.experiment.from_session import UnfinishedRunError
    from hapticmech_ros.scene import Scene

Record = TypeVar("Record", "ExperimentRecord", "SharedRecord")
DurationOption = Annotated[
    float | None, typer.Option(help="s after the hand starts", min=0.1, show_default="the scene's")
]


# N: of the paper's experiment.
DEFAULT_PUSH = (0.5, 0.0, 0.0)


def demo(
    scene: SceneArgument = "five_bar",
    out: OutOption = Path("demo"),
    composed: ComposedOption = False,
    duration: DurationOption = None,
    storage: Annotated[str, typer.Option(help="mcap or sqlite3")] = "mcap",
    control_rate: Annotated[
        float,
        typer.Option(
            min=0.0,
            max=10000.0,
            help="Hz",
            show_default="the scene's; if the machine does not carry it 500, 250, then lockstep",
        ),
    ] = 0.0,
    changes: ChangesOption = None,
) -> None:
    """Run the paper's experiment over ROS: graph, bag, figures, summary."""
    from hapticmech_ros.experiment.from_session import UnfinishedRunError
    from hapticmech_ros.graph.demo import run_demo
    from hapticmech_ros.loading import load_scene

    refuse_without_ros(os.environ)
    (scene,) = with_changes([scene], changes, out)
    with progress() as bar:
        task = bar.add_task("starting the graph", total=None)
        shown = ""

        def show(stage: str, done: float | None) -> None:
            nonlocal shown
            bar.update(task, description=stage, total=1.0 if done is not None else None)
            if done is not None:
                bar.update(task, completed=done)
            # Where there is no bar, a line for each stage.
            if bar.disable and stage != shown:
                notify(stage)
            shown = stage

        def notify(sentence: str) -> None:
            say(sentence)

        try:
            summary = run_demo(scene, out, composed, duration, storage, show, control_rate, notify)
        except UnfinishedRunError as failure:
            _leave(failure, load_scene(scene), out)
            raise
    _print_results(summary, out)


def experiment(
    scene: SceneArgument = "five_bar",
    out: OutOption = Path("experiment"),
    duration: DurationOption = None,
    push: Annotated[
        str,
        typer.Option(
            metavar="X,Y,Z",
            help="N, constant force of the hand, world axes",
            show_default="as in the scene; 0.5,0,0 if its hand does nothing",
        ),
    ] = "",
    changes: ChangesOption = None,
) -> None:
    """Run the same experiment in one process, without ROS."""
    from hapticmech_ros.experiment.from_session import run_session, run_shared_session
    from hapticmech_ros.experiment.run import write_results, write_shared_results
    from hapticmech_ros.loading import load_scene
    from hapticmech_ros.scene.holding_rules import hand_beyond_device

    loaded = load_scene(scene, changes=changes or ())
    if len(loaded.held_points) > 1:
        if push:
            rule = "of several hands each is set in the scene:--set hands[0].hand=..."
            raise InvalidInputError("--push", push, rule)
        _simulate(run_shared_session, write_shared_results, loaded, duration, out)
        return
    hand = loaded.hand
    idle = hand.kind == "constant_wrench" and not any((*hand.force, *hand.torque))
    rule = "must be three numbers with commas between: 0.5,0,0"
    force = vector_of("--push", push, words(push), rule) if push else None
    if force is None and idle and not hand.tremor:
        force = DEFAULT_PUSH
        text = "the scene's hand does nothing: it pushes with 0.5 N along x here; --push X,Y,Z"
        say(text)
    if force is not None:
        given = {"kind": "constant_wrench", "start_delay": hand.start_delay, "force": force}
        loaded = load_scene(scene, changes=[*(changes or ()), f"hand={json.dumps(given)}"])
    if warning := hand_beyond_device(loaded):
        say(warning, where=errors)
    _simulate(run_session, write_results, loaded, duration, out)


def _simulate(
    run: Callable[..., Record],
    write: Callable[[Record, Scene, Path], dict[str, object]],
    scene: Scene,
    duration: float | None,
    out: Path,
) -> None:
    """Run the experiment of one user or several, write its results, and print them.

    Args:
        run: of a scene, a duration and a callback for progress.
        write: of the record, the scene and a folder.
        scene: of the run.
        duration: s after the hand starts; the scene's if None.
        out: folder for the results.
    """
    from hapticmech_ros.experiment.from_session import UnfinishedRunError

    with progress() as bar:
        task = bar.add_task("simulating", total=1.0)
        try:
            record = run(scene, duration, lambda share: bar.update(task, completed=share))
        except UnfinishedRunError as failure:
            _leave(failure, scene, out)
            raise
        bar.update(task, description="writing results")
        summary = write(record, scene, out)
    _print_results(summary, out)


def _leave(failure: UnfinishedRunError, scene: Scene, out: Path) -> None:
    """Write the results of a run until an error, and print where."""
    from hapticmech_ros.experiment.run import write_unfinished

    write_unfinished(failure, scene, out)
    say(f"until then: {out.resolve()}")


def _print_results(summary: dict[str, object], out: Path) -> None:
    from hapticmech_ros.experiment.report import tables

    for table in tables(summary):
        console.print(table)
    say(f"results: {out.resolve()}")
