"""``hapticmech bench speed``: other simulators beside ours, at equal error."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hapticmech_ros.cli.console import OutOption, console, errors, words

if TYPE_CHECKING:
    from hapticmech_ros.bench.speed.benchmark import Results


def speed(
    scenes: Annotated[str, typer.Option(help="by name; all if not given")] = "",
    peers: Annotated[str, typer.Option(help="of mujoco, pinocchio, exudyn; all if not given")] = "",
    integrators: Annotated[
        str,
        typer.Option(help="of ours, each with steps in units of a scene if wished: rk4:10:5:2,rk2"),
    ] = "rk4",
    repeats: Annotated[int, typer.Option(help="timed runs, of all in turn")] = 5,
    quick: Annotated[
        bool, typer.Option("--quick", help="few steps, short runs, no large scenes")
    ] = False,
    smoke: Annotated[
        bool, typer.Option("--smoke", help="check that all compute the same, time nothing")
    ] = False,
    out: OutOption = Path("bench"),
    figure: Annotated[
        Path | None, typer.Option(help="where the plot goes", show_default="in the folder")
    ] = None,
    json_only: Annotated[
        bool, typer.Option("--json", help="print the results as JSON, and nothing else")
    ] = False,
) -> None:
    """Race other simulators on the same mechanisms: equality first, then CPU time at precision."""
    from hapticmech_ros.bench.speed.benchmark import run_speed
    from hapticmech_ros.bench.speed.plan import plan

    told = errors if json_only else console
    chosen = plan(words(scenes), words(peers), _integrators(integrators), repeats, quick, smoke)
    results = run_speed(
        chosen, out, lambda line: told.print(line, highlight=False, markup=False), figure
    )
    if json_only:
        import json

        print(json.dumps(results.document(), ensure_ascii=False))
    else:
        _print(results, out)
    if not results.sound:
        errors.print("not all compute the same motion: see the table of equality", style="red")
        raise typer.Exit(1)


def _print(results: Results, out: Path) -> None:
    for sheet in results.sheets():
        console.print(sheet.table())
    about = ", ".join(f"{name} {value}" for name, value in results.machine.items())
    console.print(about, highlight=False, markup=False)
    console.print(f"results: {out.resolve()}", highlight=False, soft_wrap=True)


def _integrators(text: str) -> dict[str, tuple[float, ...]]:
    from hapticmech_ros.errors import InvalidInputError

    found = {}
    for word in words(text):
        name, *steps = word.split(":")
        try:
            found[name] = tuple(float(step) for step in steps)
        except ValueError:
            rule = "must be names, each with numbers behind colons if wished"
            raise InvalidInputError("--integrators", text, rule) from None
    return found
