# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the watch on every step costs: ``python -m benchmarks.accuracy.watch``.

Two sessions of a scene, with and without it, run in turn; their results are compared first.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.machine import machine, speed_line
from hapticmech_ros import Session
from hapticmech_ros.cli import run_app
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.loading import load_scene, shipped_scenes
from hapticmech_ros.scene import Scene

# Long enough for all scenes to come to rest; with so many pairs of sessions, as where in
# memory one lies changes its time as well.
ROUNDS, TICKS, PAIRS = 100, 500, 4

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


def unwatched(scene: Scene) -> Scene:
    """Return the scene with steps whose energy account nobody looks at."""
    accuracy = scene.simulation.accuracy.model_copy(update={"tolerance": 0.0})
    return scene.stepped(accuracy=accuracy)


def cost(name: str, rounds: int = ROUNDS, ticks: int = TICKS) -> tuple[float, float]:
    """Return the share of a tick that the watch takes: median of the rounds, and standard error.

    Raises:
        HapticMechError: it changes what a session computes where it refines nothing.
    """
    shares = [share for _ in range(PAIRS) for share in _shares(name, rounds, ticks)]
    return float(np.median(shares)), float(np.std(shares) / np.sqrt(len(shares)))


def _shares(name: str, rounds: int, ticks: int) -> list[float]:
    """Return the share in each round of two sessions."""
    scene = load_scene(name)
    both = Session(scene), Session(unwatched(scene))
    one, other = (session.run(ticks).rows for session in both)
    refined = both[0].mechanism.account.refined
    if not refined and not np.array_equal(one, other):
        raise HapticMechError(f"{name}: the watch changes results")
    shares = []
    for turn in range(rounds):
        taken = [0.0, 0.0]
        for which in (0, 1) if turn % 2 else (1, 0):
            begun = time.process_time()
            both[which].run(ticks)
            taken[which] = time.process_time() - begun
        shares.append(taken[0] / taken[1] - 1.0)
    return shares


@app.command()
def watch(
    names: Annotated[list[str] | None, typer.Argument(help="Scenes; all if left out.")] = None,
    rounds: Annotated[int, typer.Option(min=1, help="Turns of each pair of sessions.")] = ROUNDS,
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("bench"),
) -> None:
    """Measure what the watch on every step costs."""
    out.mkdir(parents=True, exist_ok=True)
    found = {}
    print("| scene | the watch takes, of a tick | standard error |\n|---|--:|--:|")
    for name in names or list(shipped_scenes()):
        found[name] = cost(name, rounds)
        share, error = found[name]
        print(f"| {name} | {100.0 * share:.1f} % | {100.0 * error:.1f} % |", flush=True)
    print(f"\n{speed_line(machine())}")
    (out / "bench_watch.json").write_text(json.dumps(found, indent=1), encoding="utf-8")


if __name__ == "__main__":
    run_app(app)
