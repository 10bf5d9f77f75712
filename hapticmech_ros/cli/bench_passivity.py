"""``hapticmech bench passivity``: what the hand gets out, over connections that are late."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hapticmech_ros.cli.console import OutOption, console, errors, words


def passivity(
    scenes: Annotated[
        list[str] | None, typer.Argument(help="shipped scenes or paths; all shipped ones if none")
    ] = None,
    devices: Annotated[
        str, typer.Option(help="presets, or scene for the scene's own, with commas")
    ] = "scene",
    hands: Annotated[
        str, typer.Option(help="scene, relaxed, firm, tremor, grips, with commas")
    ] = "scene,firm",
    delays: Annotated[str, typer.Option(help="ms each way, with commas")] = "0,50",
    seconds: Annotated[float, typer.Option(help="s of each trial", min=0.1)] = 5.0,
    out: OutOption = Path("bench"),
    json_only: Annotated[
        bool, typer.Option("--json", help="print the results as JSON, and nothing else")
    ] = False,
) -> None:
    """Move over late, uneven and lossy connections: does the hand get more out than in?"""
    from hapticmech_ros.bench.feel.passive.benchmark import JSON_NAME, run_passivity, trials
    from hapticmech_ros.bench.feel.passive.report import table
    from hapticmech_ros.errors import InvalidInputError
    from hapticmech_ros.scene import shipped_scenes

    try:
        late = [1e-3 * float(delay) for delay in words(delays)]
    except ValueError:
        rule = "must be numbers of ms with commas between"
        raise InvalidInputError("--delays", delays, rule) from None
    told = errors if json_only else console
    asked = trials(scenes or list(shipped_scenes()), words(devices), words(hands), late, seconds)
    found = run_passivity(
        asked, out, lambda line: told.print(line, highlight=False, markup=False, soft_wrap=True)
    )
    if json_only:
        print((out / JSON_NAME).read_text(encoding="utf-8"))
        return
    console.print(table(found))
    console.print(f"results: {out.resolve()}", highlight=False, soft_wrap=True)
    if not all(one.passive for one in found):
        raise typer.Exit(1)
