"""``hapticmech bench ablation``: what each feature of a scene costs in a tick."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hapticmech_ros.cli.console import OutOption, console, errors


def ablation(
    rounds: Annotated[int, typer.Option(help="turns of each scene")] = 60,
    ticks: Annotated[int, typer.Option(help="ticks timed in a turn")] = 100,
    checked: Annotated[int, typer.Option(help="ticks compared with what is readable")] = 200,
    quick: Annotated[bool, typer.Option("--quick", help="5 turns of 100 ticks")] = False,
    out: OutOption = Path("bench"),
    json_only: Annotated[
        bool, typer.Option("--json", help="print the results as JSON, and nothing else")
    ] = False,
) -> None:
    """Add features to a scene one at a time: what a tick costs more, and what is not used costs."""
    from hapticmech_ros.bench.ablation.benchmark import Settings, run_ablation
    from hapticmech_ros.bench.ablation.report import ladder_table, unused_table

    settings = Settings(5, 100, 100) if quick else Settings(rounds, ticks, checked)
    told = errors if json_only else console
    results = run_ablation(
        settings, out, lambda line: told.print(line, highlight=False, markup=False)
    )
    if json_only:
        import json

        print(json.dumps(results.document(), ensure_ascii=False))
    else:
        console.print(ladder_table(results.rungs))
        console.print(unused_table(results.unused))
        about = ", ".join(f"{name} {value}" for name, value in results.machine.items())
        console.print(about, highlight=False, markup=False)
        console.print(f"results: {out.resolve()}", highlight=False, soft_wrap=True)
    if not results.sound:
        errors.print("kernels differ from the readable implementation", style="red")
        raise typer.Exit(1)
