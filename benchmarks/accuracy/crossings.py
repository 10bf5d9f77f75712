# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Crossings of branches, passed many times: ``python -m benchmarks.accuracy.crossings``.

A sample lands at a random distance from a position where branches of a mechanism's motion cross,
1e-12 to 1e-3 rad, or on it. Measured are the change of the energy over the energy, and how far the
configuration is from the motion, beyond what the same rule and step have far from there.
Where a step was done with care these are below 1e-8. Where none was, the rule's own error may be
larger next to a crossing than elsewhere: the state's account tells of it, and the branch is kept.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer

from benchmarks.accuracy.n_four_bar import n_four_bar
from benchmarks.oracle import oracle
from hapticmech_ros.analysis.study import Sheet
from hapticmech_ros.cli import run_app
from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.simulation import Simulator
from hapticmech_ros.system.workers import answers

PERIODS = (1e-4, 2.5e-4, 5e-4, 1e-3, 2e-3, 4e-3)
INTEGRATORS = tuple(SCHEMES)
# rad: the least and the largest distance; one sample in so many is on the crossing.
NEAREST, FURTHEST, ON_IT = 1e-12, 1e-3, 20
# What a step next to a crossing may lose beyond the rule's own error, and any beyond what the
# state's account tells; and how far a motion is from its own branch at most, as a share of how far
# it goes after the crossing: on another one it is off by all of it.
ALLOWED, BRANCH = 1e-8, 0.1
# So many of a rule's own errors are its own. A step with care is of this rule.
OWN, CAREFUL = 2.0, "rk4"
RESULTS = "bench_crossings.json"
# Of crossings: how many; of these with a step done with care; above what is allowed; that ended
# with an error. Largest errors beyond the rule's own: of energy and configuration where a step was
# done with care, of both elsewhere; and difference from what the state's account tells.
COUNTED = ("count", "led", "bad", "raised")
WORST = ("energy", "apart", "beside", "off", "untold")
# Crossings that a process does at a time.
BLOCK = 500
WINDOWS, STEPS, UNTIL = (1, 2, 3, 5, 10, 20, 40, 80), (2e-3, 1e-3, 5e-4, 2.5e-4), 10.0

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


class Case(NamedTuple):
    """What passes, how, and with which step (s)."""

    mechanism: str
    integrator: str
    period: float


class Block(NamedTuple):
    """Crossings that are done together: seed, which block of it, and how many."""

    seed: int
    number: int
    size: int


@dataclass
class Tally:
    """What was seen of crossings.

    Attributes:
        figures: by mechanism, by name: :data:`COUNTED` and :data:`WORST`.
        told: a line for each that is bad or raised.
        seeds: of the random numbers.
    """

    figures: dict[str, dict[str, float]] = field(default_factory=dict)
    told: list[str] = field(default_factory=list)
    seeds: list[int] = field(default_factory=list)

    @property
    def sound(self) -> bool:
        """Whether none is bad, or ended with an error."""
        return not any(of.get("bad") or of.get("raised") for of in self.figures.values())

    def see(self, case: Case, distance: float) -> None:
        """Pass a crossing, with a sample at a distance in rad."""
        found, told = {"count": 1.0}, ""
        try:
            lost, apart, untold, led = beyond(case, distance)
        except HapticMechError as error:
            found["raised"], told = 1.0, str(error)
        else:
            kept = ("energy", "apart") if led else ("beside", "off")
            found |= dict(zip((*kept, "untold", "led"), (lost, apart, untold, led), strict=True))
            # rad, of the motion in the steps after the crossing.
            way = oracle("crossings").SPEED * oracle("crossings").AFTER * case.period
            well = max(lost, apart) <= ALLOWED if led else apart <= BRANCH * way
            if not (well and untold <= ALLOWED):
                found["bad"] = 1.0
                told = f"{lost:.1e} of the energy, of it {untold:.1e} untold, {apart:.1e} off"
        lines = [f"{case}, {distance:.3e} rad: {told}"] if told else []
        self.add(Tally({case.mechanism: found}, lines))

    def add(self, other: Tally) -> None:
        """Add what was seen of others."""
        for name, figures in other.figures.items():
            ours = self.figures.setdefault(name, {})
            for key, value in figures.items():
                before = ours.get(key, 0.0 if key in COUNTED else value)
                ours[key] = before + value if key in COUNTED else max(before, value)
        self.told += other.told
        self.seeds += other.seeds

    def write(self, out: Path) -> None:
        """Write it into a folder; lines are left out."""
        results = {"figures": self.figures, "seeds": self.seeds}
        (out / RESULTS).write_text(json.dumps(results, indent=1), encoding="utf-8")


def merged(files: Sequence[Path]) -> Tally:
    """Return what runs with seeds of their own have seen together.

    Args:
        files: that they wrote.

    Raises:
        InvalidInputError: two have a seed in common, and so saw the same crossings.
    """
    whole = Tally()
    for path in files:
        found = Tally(**json.loads(path.read_text(encoding="utf-8")))
        if again := set(whole.seeds) & set(found.seeds):
            rule = f"{path} must have seeds that no other file has"
            raise InvalidInputError("seed", min(again), rule)
        whole.add(found)
    return whole


def beyond(case: Case, distance: float) -> tuple[float, float, float, bool]:
    """Return by how much both errors are larger than the rule's own, at a distance in rad.

    Where steps were done with care, the energy's is the larger one of what these alone changed,
    beyond the error of the rule of such a step, and of all steps, of which others are the scene's.
    Also what of the energy nothing tells, and whether a step was done with care.
    """
    found = oracle("crossings")
    mechanism, step = found.MECHANISMS[case.mechanism], found.Step(case.period, case.integrator)
    own, off = mechanism.own_error(distance, step)
    lost, apart, untold, led, by_care = found.passed(mechanism, distance, *step[:2])
    more = float(lost - OWN * own)
    if led:
        careful, _ = mechanism.own_error(distance, step._replace(integrator=CAREFUL))
        more = max(more, float(by_care - OWN * careful))
    return more, float(apart - OWN * off), float(untold), led > 0


def seen_in(block: Block) -> Tally:
    """Return what was seen of a block's crossings."""
    rng, names = np.random.default_rng((block.seed, block.number)), _mechanisms()
    tally = Tally()
    for _ in range(block.size):
        case = Case(
            str(rng.choice(names)), str(rng.choice(INTEGRATORS)), float(rng.choice(PERIODS))
        )
        size = 10.0 ** rng.uniform(np.log10(NEAREST), np.log10(FURTHEST))
        distance = 0.0 if rng.integers(ON_IT) == 0 else float(rng.choice((-1.0, 1.0)) * size)
        tally.see(case, distance)
    return tally


def _mechanisms() -> tuple[str, ...]:
    return tuple(oracle("crossings").MECHANISMS)


def error_after(windows: int, period: float) -> float:
    """Return how far the first tip of A02 is from its motion after ten seconds, m."""
    simulator = Simulator(n_four_bar(windows).stepped(period=period))
    end = simulator.run(simulator.initial_state(), round(UNTIL / period)).end
    tip = simulator.mechanism.frame_pose(end.q, "b0").translation[:2]
    return float(np.abs(tip - oracle("pendulum").windows(windows, [UNTIL])[0]).max())


@app.command()
def crossings(
    samples: Annotated[int, typer.Option(min=1, help="How many crossings.")] = 10_000,
    seed: Annotated[int, typer.Option(help="Of the random numbers.")] = 0,
    processes: Annotated[int, typer.Option(min=1, help="That share the work.")] = 1,
    windows: Annotated[bool, typer.Option(help="A02 at 10 s instead.")] = False,
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("bench"),
    merge: Annotated[
        list[Path] | None, typer.Option(help="Results of other seeds to add up instead; repeat it.")
    ] = None,
) -> None:
    """Pass crossings with samples next to them, and say what that costs in energy.

    Results so far are written every few hundred crossings. Runs with seeds of their own, each into
    a folder of its own, are added up by --merge. Ends with 1 if a step with care costs more than
    1e-8 of the energy, any more than the account tells, or if one leads to another branch.
    """
    out.mkdir(parents=True, exist_ok=True)
    if windows:
        _write_windows(out)
        return
    tally = merged(merge) if merge else _passed(samples, seed, processes, out)
    print(_table(tally).markdown())
    tally.write(out)
    if not tally.sound:
        raise typer.Exit(1)


def _passed(samples: int, seed: int, processes: int, out: Path) -> Tally:
    """Return what is seen of so many crossings; print what is bad, and write results so far."""
    tally, done = Tally(seeds=[seed]), 0
    blocks = [
        Block(seed, index, min(BLOCK, samples - first))
        for index, first in enumerate(range(0, samples, BLOCK))
    ]
    for found in answers(seen_in, blocks, processes):
        tally.add(found)
        tally.write(out)
        for line in found.told:
            print(line, flush=True)
        done += sum(round(of["count"]) for of in found.figures.values())
        if done % (100 * BLOCK) == 0:
            print(f"{done} crossings", flush=True)
    return tally


def _table(tally: Tally) -> Sheet:
    """Return what was seen of each mechanism."""
    rows = []
    for name in filter(tally.figures.__contains__, _mechanisms()):
        found = tally.figures[name]
        count, led, *ends = (f"{found.get(key, 0.0):.0f}" for key in COUNTED)
        worst = (f"{found.get(key, np.nan):.1e}" for key in WORST)
        rows.append((name, count, led, *worst, *ends))
    headings = (
        *("mechanism", "crossings", "with care", "energy, worst", "configuration, worst"),
        *("others: energy", "configuration", "not told", "bad", "raised"),
    )
    return Sheet("crossings", headings, tuple(rows))


def _write_windows(out: Path) -> None:
    """Print and write the table of A02."""
    table = {count: [error_after(count, step) for step in STEPS] for count in WINDOWS}
    rows = ((f"{n}", *(f"{error:.1e}" for error in errors)) for n, errors in table.items())
    headings = ("N", *(f"{1e3 * step:g} ms" for step in STEPS))
    print(Sheet("error of A02 at 10 s, m", headings, tuple(rows)).markdown())
    (out / "bench_windows.json").write_text(json.dumps(table, indent=1), encoding="utf-8")


if __name__ == "__main__":
    run_app(app)
