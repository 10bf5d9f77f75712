# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The campaign: ``python -m benchmarks.reliability [PARTS...] [--quick] [--out FOLDER]``."""

from __future__ import annotations

import importlib
import math
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from benchmarks.reliability.document import publish
from benchmarks.reliability.figure import Figure, load, machine_speed, save, table, unmeasured
from benchmarks.words import refuse_unknown
from hapticmech_ros.cli import run_app
from hapticmech_ros.compilation.library import compile_ahead
from hapticmech_ros.errors import HapticMechError

HERE = "benchmarks.reliability"
JSON_NAME = "reliability.json"
# In the order of the table, those that need a quiet machine first.
PARTS = {
    "kills": "each node killed without warning, and started again",
    "freezes": "each node stopped for 50 periods to 2 s",
    "clocks": "steps of the machine's clock, of one host's, and of /clock",
    "emergency": "an emergency stop, alone and beside busy programs",
    "doubles": "a second node of each kind, a foreign driver, foreign commanders",
    "network": "delay, jitter, loss and reordering between two hosts",
    "users": "two users on two hosts",
    "exposure": "who else on the network is heard",
    "messages": "bytes and values that no node sends",
    "files": "scenes, meshes and bags that are none",
    "disk": "a full disk",
    "soak": "a session, and an hour of rendering: memory, descriptors, threads",
}
LISTED = "; ".join(f"{name}: {what}" for name, what in PARTS.items())
# Those that run at another control rate too.
RATED = ("kills", "freezes")


app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.command(epilog="Limits and how it is measured: docs/reliability.md.")
def campaign(
    parts: Annotated[
        list[str] | None, typer.Argument(metavar="PART", help=f"all if none; {LISTED}")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="a few trials of each kind")] = False,
    rate: Annotated[float, typer.Option(help=f"control rate, Hz, of {', '.join(RATED)}")] = 0.0,
    out: Annotated[Path, typer.Option(help="folder for figures and logs")] = Path("reliability"),
    table_only: Annotated[
        bool, typer.Option("--table", help="write figures of an earlier run into the document")
    ] = False,
) -> None:
    """Faults of every kind against the graph, and what it does about them.

    Ends with 1 if a figure does not keep its limits.
    """
    refuse_unknown("part", parts or (), PARTS)
    if rate and not (parts and set(parts) <= set(RATED)):
        raise typer.BadParameter(f"--rate: only with parts {' and '.join(RATED)}")
    out = out.resolve()
    path = out / JSON_NAME
    if table_only:
        publish(load(path))
        return
    out.mkdir(parents=True, exist_ok=True)
    # Else every node of the first graph waits for it, and the trial's patience ends before.
    compile_ahead()
    chosen = list(dict.fromkeys(parts or PARTS))
    before = load(path) if path.exists() else []
    found = {name: [figure for figure in before if figure.part == name] for name in PARTS}
    for name in chosen:
        begun = time.monotonic()
        print(f"== {name}: {PARTS[name]}", flush=True)
        found[name] = run_part(name, quick, out, rate)
        if not all(math.isnan(figure.value) for figure in found[name]):
            # Of each part: they may be run on different days.
            found[name].append(replace(machine_speed(), part=name))
        # After each part: hours of measurements are not lost with the next one.
        save([figure for figures in found.values() for figure in figures], path)
        print(f"== {name}: {time.monotonic() - begun:.0f} s\n", flush=True)
    measured = [figure for name in chosen for figure in found[name]]
    print(table(measured))
    print(path)
    if not all(figure.kept for figure in measured):
        raise typer.Exit(1)


def run_part(name: str, quick: bool, out: Path, rate: float = 0.0) -> list[Figure]:
    """Run a part; what cannot be measured is a figure too, which says why.

    Args:
        name: of the part.
        quick: a few trials.
        out: folder for figures and logs.
        rate: control rate, Hz; 0: the scene's.
    """
    part = importlib.import_module(f"{HERE}.{name}")
    try:
        figures: list[Figure] = part.run(quick, out, **({"rate": rate} if rate else {}))
    except HapticMechError as error:
        figures = [unmeasured(PARTS[name], str(error))]
    return [replace(figure, part=name) for figure in figures]


if __name__ == "__main__":
    run_app(app)
