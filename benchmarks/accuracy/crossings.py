"""Crossings of branches, passed many times: ``python -m benchmarks.accuracy.crossings``.

A sample lands at a random distance from a position where branches of a mechanism's motion cross,
1e-12 to 1e-3 rad, or on it. Measured are the change of the energy over the energy, and how far the
configuration is from the motion, beyond what the same rule and step have where no sample is near.
"""

from __future__ import annotations

import json
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer

from benchmarks.accuracy.n_four_bar import n_four_bar
from benchmarks.oracle import oracle
from hapticmech_ros.cli import run_app
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.simulation import Simulator

PERIODS = (1e-4, 2.5e-4, 5e-4, 1e-3, 2e-3, 4e-3)
INTEGRATORS = ("rk4", "rk2", "semi_implicit_euler", "linearly_implicit")
# rad: the least and the largest distance; one sample in so many is on the crossing.
NEAREST, FURTHEST, ON_IT = 1e-12, 1e-3, 20
# What a step next to a crossing may lose beyond the rule's own error.
ALLOWED = 1e-8
WINDOWS, STEPS, UNTIL = (1, 2, 3, 5, 10, 20, 40, 80), (2e-3, 1e-3, 5e-4, 2.5e-4), 10.0

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


class Case(NamedTuple):
    """What passes, how, and with which step (s)."""

    mechanism: str
    integrator: str
    period: float


@cache
def own_error(case: Case) -> tuple[float, float]:
    """Return both errors of a rule where no sample is near the crossing."""
    found = oracle("crossings")
    beside = found.SPEED * case.period / 3.0
    lost, apart = found.passed(
        found.MECHANISMS[case.mechanism], beside, case.period, case.integrator
    )
    return float(lost), float(apart)


def beyond(case: Case, distance: float) -> tuple[float, float]:
    """Return by how much both errors are larger than the rule's own, at a distance in rad."""
    found = oracle("crossings")
    lost, apart = found.passed(
        found.MECHANISMS[case.mechanism], distance, case.period, case.integrator
    )
    own, off = own_error(case)
    return float(lost) - 1.5 * own, float(apart) - 1.5 * off


def error_after(windows: int, period: float) -> float:
    """Return how far the first tip of A02 is from its motion after ten seconds, m."""
    scene = n_four_bar(windows)
    step = scene.simulation.model_copy(update={"period": period})
    simulator = Simulator(scene.model_copy(update={"simulation": step}))
    end = simulator.run(simulator.initial_state(), round(UNTIL / period)).end
    tip = simulator.mechanism.frame_pose(end.q, "b0").translation[:2]
    return float(np.abs(tip - oracle("pendulum").windows(windows, [UNTIL])[0]).max())


@app.command()
def crossings(
    samples: Annotated[int, typer.Option(min=1, help="How many crossings.")] = 10_000,
    seed: Annotated[int, typer.Option(help="Of the random numbers.")] = 0,
    windows: Annotated[bool, typer.Option(help="A02 at 10 s instead.")] = False,
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("bench"),
) -> None:
    """Pass crossings with samples next to them, and say what that costs in energy.

    Ends with 1 if a crossing costs more than 1e-8 of the energy, or leads to another branch.
    """
    out.mkdir(parents=True, exist_ok=True)
    if windows:
        _write_windows(out)
        return
    rng, names = np.random.default_rng(seed), tuple(oracle("crossings").MECHANISMS)
    worst: dict[str, list[float]] = {name: [-np.inf, -np.inf] for name in names}
    count, bad, raised = Counter[str](), Counter[str](), Counter[str]()
    for _ in range(samples):
        case = Case(
            str(rng.choice(names)), str(rng.choice(INTEGRATORS)), float(rng.choice(PERIODS))
        )
        size = 10.0 ** rng.uniform(np.log10(NEAREST), np.log10(FURTHEST))
        distance = 0.0 if rng.integers(ON_IT) == 0 else float(rng.choice((-1.0, 1.0)) * size)
        count[case.mechanism] += 1
        try:
            errors = beyond(case, distance)
        except HapticMechError as error:
            raised[case.mechanism] += 1
            print(f"{case}, {distance:.3e} rad: {error}")
            continue
        worst[case.mechanism] = [max(p) for p in zip(worst[case.mechanism], errors, strict=True)]
        if not max(errors) <= ALLOWED:
            bad[case.mechanism] += 1
            print(f"{case}, {distance:.3e} rad: {errors[0]:.1e} of the energy, {errors[1]:.1e} off")
    print("| mechanism | crossings | energy, worst | configuration, worst | above 1e-8 | raised |")
    print("|---|--:|--:|--:|--:|--:|")
    for name in names:
        lost, apart = worst[name]
        print(
            f"| {name} | {count[name]} | {lost:.1e} | {apart:.1e} | {bad[name]} | {raised[name]} |"
        )
    results = {"worst": worst, "count": count, "bad": bad, "raised": raised, "seed": seed}
    (out / "bench_crossings.json").write_text(json.dumps(results, indent=1), encoding="utf-8")
    if bad or raised:
        raise typer.Exit(1)


def _write_windows(out: Path) -> None:
    """Print and write the table of A02."""
    print("| N |" + "".join(f" {1e3 * step:g} ms |" for step in STEPS))
    print("|--:|" + "--:|" * len(STEPS))
    table = {}
    for count in WINDOWS:
        table[count] = [error_after(count, step) for step in STEPS]
        print(f"| {count} |" + "".join(f" {error:.1e} |" for error in table[count]), flush=True)
    (out / "bench_windows.json").write_text(json.dumps(table, indent=1), encoding="utf-8")


if __name__ == "__main__":
    run_app(app)
