"""``hapticmech bench``: how fast things are, beside something that does no work."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from hapticmech_ros.cli.bench_ablation import ablation
from hapticmech_ros.cli.bench_accuracy import accuracy
from hapticmech_ros.cli.bench_feel import feel
from hapticmech_ros.cli.bench_feel_limits import compare, limits
from hapticmech_ros.cli.bench_memory import memory
from hapticmech_ros.cli.bench_passivity import passivity
from hapticmech_ros.cli.bench_speed import speed
from hapticmech_ros.cli.console import OutOption, SceneArgument, console, errors, words

if TYPE_CHECKING:
    from hapticmech_ros.bench.plan import Layout, Plan

app = typer.Typer(help="Benchmarks.", no_args_is_help=True)
app.command()(accuracy)
app.command()(ablation)
app.command()(feel)
app.command()(passivity)
app.command("feel-limits")(limits)
app.command("feel-compare")(compare)
app.command()(memory)
app.command()(speed)


@app.callback()
def _options() -> None:
    """Benchmarks: they check that results agree first, then time."""


@app.command()
def graph(
    scene: SceneArgument = "five_bar",
    rates: Annotated[str, typer.Option(help="control rates, Hz")] = "500,1000,2000,4000",
    layout: Annotated[str, typer.Option(help="separate, composed or both")] = "separate,composed",
    record: Annotated[
        bool | None,
        typer.Option("--record/--no-record", show_default="both", help="with a recorder or not"),
    ] = None,
    seconds: Annotated[float, typer.Option(help="s that each run is watched")] = 20.0,
    repeats: Annotated[int, typer.Option(help="runs of each graph in each configuration")] = 2,
    out: OutOption = Path("bench"),
    json_only: Annotated[
        bool, typer.Option("--json", help="print the results as JSON, and nothing else")
    ] = False,
) -> None:
    """Time the graph beside a bare one: same processes, topics and messages, empty callbacks."""
    from hapticmech_ros.bench.benchmark import run_benchmark
    from hapticmech_ros.bench.report import configuration_tables, goal_table

    plan = _plan(scene, rates, layout, record, seconds, repeats)
    # Lines, not a bar: nothing of this process shall run while it is measured.
    told = errors if json_only else console
    results = run_benchmark(
        plan, out, lambda stage: told.print(stage, highlight=False, markup=False)
    )
    if json_only:
        import json

        print(json.dumps(results.document(), ensure_ascii=False))
    else:
        for comparison in results.comparisons:
            for table in configuration_tables(comparison):
                console.print(table)
        console.print(goal_table(results.goals))
        about = ", ".join(f"{name} {value}" for name, value in results.machine.items())
        console.print(about, highlight=False, markup=False)
        console.print(f"results: {out.resolve()}", highlight=False, soft_wrap=True)
    if not results.sound:
        errors.print("some runs did not pass their checks: their times mean little", style="red")
        raise typer.Exit(1)


@app.command()
def kills(
    scene: SceneArgument = "five_bar",
    number: Annotated[int, typer.Option("--kills", min=1, help="how many")] = 20,
    seed: Annotated[int, typer.Option(help="of the choice of victims")] = 0,
) -> None:
    """Kill nodes at random and start them again: how fast the device lets go and comes back."""
    from hapticmech_ros.bench.kills import run_kills, verdict
    from hapticmech_ros.scene import load_scene

    load_scene(scene)
    found = run_kills(scene, number, seed, lambda line: console.print(line, highlight=False))
    console.print(verdict(found), highlight=False)


def _plan(
    scene: str, rates: str, layout: str, record: bool | None, seconds: float, repeats: int
) -> Plan:
    from hapticmech_ros.bench.plan import Plan
    from hapticmech_ros.errors import InvalidInputError

    try:
        rates_hz = tuple(float(rate) for rate in words(rates))
    except ValueError:
        raise InvalidInputError("--rates", rates, "must be numbers with commas between") from None
    recorded = (False, True) if record is None else (record,)
    # The plan refuses layouts that it does not know.
    layouts = cast("tuple[Layout, ...]", words(layout))
    return Plan(scene, rates_hz, layouts, recorded, seconds, repeats)
