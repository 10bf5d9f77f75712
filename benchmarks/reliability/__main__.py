# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The campaign: ``python -m benchmarks.reliability [PARTS...] [--quick] [--out FOLDER]``."""

from __future__ import annotations

import argparse
import importlib
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from benchmarks.reliability.document import publish
from benchmarks.reliability.figure import Figure, load, machine_speed, save, table, unmeasured
from hapticmech_ros.compilation.library import compile_ahead
from hapticmech_ros.errors import HapticMechError

HERE = "benchmarks.reliability"
JSON_NAME = "reliability.json"
# In the order of the table, those that need a quiet machine first.
PARTS = {
    "kills": "each node killed without warning, and started again",
    "freezes": "each node stopped for 50 periods to 2 s",
    "clocks": "steps of the machine's clock, of one host's, and of /clock",
    "doubles": "a second node of each kind, a foreign driver, foreign commanders",
    "network": "delay, jitter, loss and reordering between two hosts",
    "users": "two users on two hosts",
    "exposure": "who else on the network is heard",
    "messages": "bytes and values that no node sends",
    "files": "scenes, meshes and bags that are none",
    "disk": "a full disk",
    "soak": "a session, and an hour of rendering: memory, descriptors, threads",
}
# Those that run at another control rate too.
RATED = ("kills", "freezes")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run parts of the campaign, or all; return 0 if every figure keeps its limits."""
    parser = _parser()
    asked = parser.parse_args(arguments)
    if asked.rate and not (asked.parts and set(asked.parts) <= set(RATED)):
        parser.error(f"--rate: only with parts {' and '.join(RATED)}")
    out = asked.out.resolve()
    path = out / JSON_NAME
    if asked.table:
        publish(load(path))
        return 0
    out.mkdir(parents=True, exist_ok=True)
    # Else every node of the first graph waits for it, and the trial's patience ends before.
    compile_ahead()
    parts = list(dict.fromkeys(asked.parts)) or list(PARTS)
    before = load(path) if path.exists() else []
    found = {name: [figure for figure in before if figure.part == name] for name in PARTS}
    for name in parts:
        begun = time.monotonic()
        print(f"== {name}: {PARTS[name]}", flush=True)
        found[name] = run_part(name, asked.quick, out, asked.rate)
        if not all(math.isnan(figure.value) for figure in found[name]):
            # Of each part: they may be run on different days.
            found[name].append(replace(machine_speed(), part=name))
        # After each part: hours of measurements are not lost with the next one.
        save([figure for figures in found.values() for figure in figures], path)
        print(f"== {name}: {time.monotonic() - begun:.0f} s\n", flush=True)
    measured = [figure for name in parts for figure in found[name]]
    print(table(measured))
    print(path)
    return 0 if all(figure.kept for figure in measured) else 1


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


def _parser() -> argparse.ArgumentParser:
    lines = "\n".join(f"  {name:9} {what}" for name, what in PARTS.items())
    parser = argparse.ArgumentParser(
        prog=f"python -m {HERE}",
        description="Faults of every kind against the graph, and what it does about them.",
        epilog=f"parts:\n{lines}\n\nLimits and how it is measured: docs/reliability.md.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "parts", nargs="*", metavar="PART", choices=[[], *PARTS], help="all if none"
    )
    parser.add_argument("--quick", action="store_true", help="a few trials of each kind")
    parser.add_argument(
        "--rate", type=float, default=0.0, metavar="HZ", help=f"control rate, of {', '.join(RATED)}"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("reliability"), help="folder for figures and logs"
    )
    parser.add_argument(
        "--table", action="store_true", help="write figures of an earlier run into the document"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
