"""``hapticmech bench feel``: what reaches the hand, beside what should."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hapticmech_ros.cli.console import OutOption, console, errors, words


def feel(
    scenes: Annotated[
        list[str] | None, typer.Argument(help="shipped scenes or paths; all shipped ones if none")
    ] = None,
    delays: Annotated[str, typer.Option(help="periods from measuring to acting")] = "1",
    over: Annotated[
        str,
        typer.Option(help="session; composed or processes: a graph of real nodes, with a recorder"),
    ] = "session",
    out: OutOption = Path("bench"),
    json_only: Annotated[
        bool, typer.Option("--json", help="print the results as JSON, and nothing else")
    ] = False,
) -> None:
    """Push small at many frequencies: is the impedance felt the one of the mechanism?"""
    from hapticmech_ros.bench.feel.benchmark import OVER, run_feel
    from hapticmech_ros.bench.feel.report import table
    from hapticmech_ros.errors import InvalidInputError
    from hapticmech_ros.scene import shipped_scenes

    try:
        periods = [int(delay) for delay in words(delays)]
    except ValueError:
        rule = "must be whole numbers with commas between"
        raise InvalidInputError("--delays", delays, rule) from None
    if over not in OVER:
        raise InvalidInputError("--over", over, f"must be one of {', '.join(OVER)}")
    told = errors if json_only else console
    rows = run_feel(
        scenes or list(shipped_scenes()),
        periods,
        out,
        lambda line: told.print(line, highlight=False, markup=False),
        over,
    )
    if json_only:
        import json

        print(json.dumps([row.document() for row in rows], ensure_ascii=False))
        return
    console.print(table(rows))
    console.print(f"results: {out.resolve()}", highlight=False, soft_wrap=True)
