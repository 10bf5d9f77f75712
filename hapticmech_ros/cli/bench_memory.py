"""``hapticmech bench memory``: whether session and nodes grow."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from hapticmech_ros.cli.console import OutOption, SceneArgument, console, errors

if TYPE_CHECKING:
    from hapticmech_ros.bench.plan import Layout


def memory(
    scene: SceneArgument = "five_bar",
    hours: Annotated[float, typer.Option(help="simulated by the session; 0: no session")] = 1.0,
    minutes: Annotated[float, typer.Option(help="of the graph at 1 kHz; 0: no graph")] = 60.0,
    period: Annotated[float, typer.Option(help="s between looks at the graph")] = 5.0,
    layout: Annotated[str, typer.Option(help="of the graph: separate or composed")] = "separate",
    warm_up: Annotated[float, typer.Option(help="share of the time that does not count")] = 0.25,
    out: OutOption = Path("bench"),
    json_only: Annotated[
        bool, typer.Option("--json", help="print the results as JSON, and nothing else")
    ] = False,
) -> None:
    """Watch the resident size of a session and of the graph's nodes: do they stay as they are?"""
    from hapticmech_ros.bench.memory.benchmark import Settings, run_memory
    from hapticmech_ros.bench.memory.report import table

    # The settings refuse layouts that they do not know.
    settings = Settings(scene, hours, minutes, period, cast("Layout", layout), warm_up)
    told = errors if json_only else console
    results = run_memory(
        settings, out, lambda line: told.print(line, highlight=False, markup=False)
    )
    if json_only:
        import json

        print(json.dumps(results.document(), ensure_ascii=False))
    else:
        console.print(table(results.grown))
        for node, sentence in results.said.items():
            console.print(f"{node}: {sentence}", highlight=False, markup=False)
        about = ", ".join(f"{name} {value}" for name, value in results.machine.items())
        console.print(about, highlight=False, markup=False)
        console.print(f"results: {out.resolve()}", highlight=False, soft_wrap=True)
    if not results.flat:
        errors.print("something grows", style="red")
        raise typer.Exit(1)
