"""``hapticmech bench feel-limits`` and ``feel-compare``: how stiff, how light, and beside what."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, TypeVar

import typer

from hapticmech_ros.cli.console import OutOption, console, errors, words

Number = TypeVar("Number", int, float)

# A closed loop, a spatial one, contacts, and nothing but free directions.
SAMPLE = ("five_bar", "door", "peg_in_hole", "spatial_arm")
DELAYS, ALL_DELAYS = "0,1,2,5,10", "0,1,2,5,10,20,50"
RATES, ALL_RATES = "500,2000", "250,500,1000,2000,4000"

ScenesArgument = Annotated[
    list[str] | None, typer.Argument(help=f"shipped scenes or paths; {', '.join(SAMPLE)} if none")
]
AllOption = Annotated[bool, typer.Option("--all", help="all shipped scenes, and all of the rest")]
ProcessesOption = Annotated[int, typer.Option(help="how many share the work", min=1)]
JsonOption = Annotated[
    bool, typer.Option("--json", help="print the results as JSON, and nothing else")
]


def limits(
    scenes: ScenesArgument = None,
    delays: Annotated[str, typer.Option(help="periods from measuring to acting")] = "",
    rates: Annotated[str, typer.Option(help="further rates of the loop, Hz")] = "",
    what: Annotated[str, typer.Option(help="of z, m and loads")] = "z,m,loads",
    device: Annotated[str, typer.Option(help="preset instead of the scenes' devices")] = "",
    everything: AllOption = False,
    processes: ProcessesOption = 2,
    out: OutOption = Path("bench"),
    json_only: JsonOption = False,
) -> None:
    """How stiff, how light, how deep: what sessions bear, beside what theory says they do."""
    from hapticmech_ros.bench.feel.limits.benchmark import run_limits
    from hapticmech_ros.bench.feel.limits.plan import plan
    from hapticmech_ros.bench.feel.limits.report import tables
    from hapticmech_ros.bench.feel.stability.variations import with_device
    from hapticmech_ros.scene import load_scene

    periods = _numbers("--delays", delays or (ALL_DELAYS if everything else DELAYS), int)
    hertz = _numbers("--rates", rates or (ALL_RATES if everything else RATES), float)
    loaded = [load_scene(name) for name in _chosen(scenes, everything)]
    if device:
        loaded = [with_device(scene, device) for scene in loaded]
    cases = plan(loaded, periods, hertz, words(what))
    found = run_limits(cases, out, processes, _tell(json_only))
    if json_only:
        import json

        print(json.dumps(found.document(), ensure_ascii=False))
        return
    for table in tables(found):
        console.print(table)
    console.print(f"results: {out.resolve()}", highlight=False, soft_wrap=True)


def compare(
    scenes: ScenesArgument = None,
    delays: Annotated[str, typer.Option(help="periods from measuring to acting")] = "1",
    everything: AllOption = False,
    processes: ProcessesOption = 2,
    out: OutOption = Path("bench"),
    json_only: JsonOption = False,
) -> None:
    """Render the same motions by the architecture, without joint constraints, and by a proxy."""
    from hapticmech_ros.bench.feel.comparison.benchmark import run_comparison
    from hapticmech_ros.bench.feel.comparison.report import table

    periods = _numbers("--delays", delays, int)
    columns = run_comparison(_chosen(scenes, everything), periods, out, processes, _tell(json_only))
    if json_only:
        import json

        print(json.dumps([one.document() for one in columns], ensure_ascii=False))
        return
    console.print(table(columns))
    console.print(f"results: {out.resolve()}", highlight=False, soft_wrap=True)


def _chosen(scenes: list[str] | None, everything: bool) -> list[str]:
    from hapticmech_ros.scene import shipped_scenes

    if scenes:
        return scenes
    return list(shipped_scenes()) if everything else list(SAMPLE)


def _numbers(option: str, text: str, kind: Callable[[str], Number]) -> list[Number]:
    from hapticmech_ros.errors import InvalidInputError

    try:
        return [kind(word) for word in words(text)]
    except ValueError:
        rule = "must be whole numbers" if kind is int else "must be numbers"
        raise InvalidInputError(option, text, f"{rule} with commas between") from None


def _tell(json_only: bool) -> Callable[[str], None]:
    told = errors if json_only else console
    return lambda line: told.print(line, highlight=False, markup=False)
