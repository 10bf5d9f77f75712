# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``python -m benchmarks.steps``: the cheapest integrator of each scene, at wanted errors."""

from __future__ import annotations

import time

import typer

from benchmarks.machine import machine, speed_line
from hapticmech_ros.cli import run_app
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.loading import load_scene, shipped_scenes
from hapticmech_ros.plan.step_accuracy import StepChoices, step_choices

ERRORS = (1e-4, 1e-6, 1e-9)

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


def cells(found: StepChoices) -> str:
    """Return what takes the least time, and that over the time of rk4 with one step."""
    best = found.best
    if best is None:
        return "none"
    times = "" if best.substeps == 1 else f" × {best.substeps}"
    rk4 = next(one for one in found.tried if one.integrator == "rk4")
    share = f", {best.time_s / rk4.time_s:.2f}" if rk4.error_m <= found.wanted_m else ""
    return f"{best.integrator}{times}, {1e6 * best.time_s:.1f}{share}"


@app.command()
def steps() -> None:
    """Print a table for a document."""
    print("| scene | " + " | ".join(f"{error:g} m" for error in ERRORS) + " |")
    print("|---|" + "---|" * len(ERRORS))
    for name in shipped_scenes():
        row = []
        for error in ERRORS:
            try:
                row.append(cells(step_choices(load_scene(name), error, time.process_time)))
            except HapticMechError as refusal:
                row.append(str(refusal))
        print(f"| `{name}` | " + " | ".join(row) + " |", flush=True)
    print(f"\n{speed_line(machine())}")


if __name__ == "__main__":
    run_app(app)
