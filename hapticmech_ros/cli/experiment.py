"""``hapticmech demo`` and ``hapticmech experiment``: the experiment with and without ROS."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hapticmech_ros.cli.console import (
    ChangesOption,
    ComposedOption,
    OutOption,
    SceneArgument,
    console,
    progress,
)

DurationOption = Annotated[
    float | None, typer.Option(help="s after the hand starts", min=0.1, show_default="the scene's")
]


PUSH = "say so in the scene, or --set 'hand={kind: constant_wrench, force: [0.5, 0, 0]}'"


def demo(
    scene: SceneArgument = "five_bar",
    out: OutOption = Path("demo"),
    composed: ComposedOption = False,
    duration: DurationOption = None,
    storage: Annotated[str, typer.Option(help="mcap or sqlite3")] = "mcap",
) -> None:
    """Run the paper's experiment over ROS: graph, bag, figures, summary."""
    from hapticmech_ros.experiment.demo import run_demo

    with progress() as bar:
        task = bar.add_task("starting the graph", total=None)

        def show(stage: str, done: float | None) -> None:
            bar.update(task, description=stage, total=1.0 if done is not None else None)
            if done is not None:
                bar.update(task, completed=done)

        summary = run_demo(scene, out, composed, duration, storage, show)
    _print_results(summary, out)


def experiment(
    scene: SceneArgument = "five_bar",
    out: OutOption = Path("experiment"),
    duration: DurationOption = None,
    changes: ChangesOption = None,
) -> None:
    """Run the same experiment in one process, without ROS."""
    from hapticmech_ros.experiment.from_session import run_session
    from hapticmech_ros.experiment.run import write_results
    from hapticmech_ros.scene import load_scene

    loaded = load_scene(scene, changes=changes or ())
    with progress() as bar:
        task = bar.add_task("simulating", total=1.0)
        record = run_session(loaded, duration, lambda share: bar.update(task, completed=share))
        bar.update(task, description="writing results")
        summary = write_results(record, loaded, out)
    _print_results(summary, out)
    hand = loaded.hand
    if hand.kind == "constant_wrench" and not any((*hand.force, *hand.torque)) and not hand.tremor:
        console.print(f"nobody pushed: {PUSH}", highlight=False, markup=False, soft_wrap=True)


def _print_results(summary: dict[str, object], out: Path) -> None:
    from hapticmech_ros.experiment.report import table

    console.print(table(summary))
    console.print(f"results: {out.resolve()}", highlight=False, soft_wrap=True)
