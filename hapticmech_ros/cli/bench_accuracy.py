"""``hapticmech bench accuracy``: known motions, and what it costs to match them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hapticmech_ros.cli.console import OutOption, console, errors, words

if TYPE_CHECKING:
    from hapticmech_ros.bench.accuracy.benchmark import Results, Show


def accuracy(
    cases: Annotated[str, typer.Option(help="by name; all if not given")] = "",
    integrators: Annotated[str, typer.Option(help="by name; all if not given")] = "",
    steps: Annotated[
        str, typer.Option(help="in steps of each scene's own; 4,2,1,0.5,0.25 if not given")
    ] = "",
    quick: Annotated[
        bool, typer.Option("--quick", help="two steps a case, none of the large ones")
    ] = False,
    long: Annotated[
        bool,
        typer.Option("--long", help="an hour of Bricard's mechanism and a minute of A02 instead"),
    ] = False,
    out: OutOption = Path("bench"),
    figure: Annotated[
        Path | None, typer.Option(help="where the plot goes", show_default="in the folder")
    ] = None,
    json_only: Annotated[
        bool, typer.Option("--json", help="print the results as JSON, and nothing else")
    ] = False,
) -> None:
    """Compare integrators with mechanisms whose motion is known: error, energy, CPU time."""
    from hapticmech_ros.bench.accuracy.benchmark import run_accuracy
    from hapticmech_ros.bench.accuracy.plan import settings

    told = errors if json_only else console

    def show(line: str) -> None:
        told.print(line, highlight=False, markup=False)

    if long:
        _long(out, json_only, show)
        return
    multiples = _numbers("--steps", steps)
    plan = settings(words(cases), words(integrators), multiples, quick)
    results = run_accuracy(plan, out, show, figure)
    if json_only:
        _print_json(results.document())
    else:
        _print(results, out)
    if not results.sound:
        errors.print("a case misses its tolerance with its own step and integrator", style="red")
        raise typer.Exit(1)


def _print(results: Results, out: Path) -> None:
    from hapticmech_ros.bench.accuracy.cases import cases as all_cases
    from hapticmech_ros.bench.accuracy.report import LEGEND, tables

    for table in tables(results.runs, all_cases()):
        console.print(table)
    about = ", ".join(f"{name} {value}" for name, value in results.machine.items())
    console.print(about, highlight=False, markup=False)
    console.print(LEGEND, highlight=False, markup=False)
    console.print(f"results: {out.resolve()}", highlight=False, soft_wrap=True)


def _long(out: Path, json_only: bool, show: Show) -> None:
    import json
    from dataclasses import asdict

    from hapticmech_ros.bench.accuracy.cases import cases as all_cases
    from hapticmech_ros.bench.accuracy.endurance import hour_of, lines, minute_of_windows

    bricard = next(case for case in all_cases() if case.name == "bricard")
    runs = (minute_of_windows(show=show), hour_of(bricard, show=show))
    document: dict[str, object] = {"runs": [asdict(run) for run in runs]}
    out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(document, indent=1, ensure_ascii=False)
    (out / "bench_accuracy_long.json").write_text(text + "\n", encoding="utf-8")
    if json_only:
        _print_json(document)
    else:
        for run in runs:
            for line in lines(run):
                show(line)
    if any(run.failure for run in runs):
        raise typer.Exit(1)


def _print_json(document: dict[str, object]) -> None:
    import json

    print(json.dumps(document, ensure_ascii=False))


def _numbers(option: str, text: str) -> tuple[float, ...]:
    from hapticmech_ros.errors import InvalidInputError

    try:
        return tuple(float(word) for word in words(text))
    except ValueError:
        raise InvalidInputError(option, text, "must be numbers with commas between") from None
