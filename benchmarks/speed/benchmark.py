# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The speed benchmark: from options to results."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, ClassVar

import typer
from matplotlib.figure import Figure

from benchmarks.goals import Verdict
from benchmarks.machine import MachineResults, machine
from benchmarks.speed.contender import EXTRA, Peer
from benchmarks.speed.equality import Check, check
from benchmarks.speed.fronts import Ratio, ratios
from benchmarks.speed.goals import verdicts
from benchmarks.speed.mujoco_peer import MUJOCO
from benchmarks.speed.own_peer import DEFAULT, own_peer
from benchmarks.speed.own_peer import NAME as OWN
from benchmarks.speed.pinocchio_peer import PINOCCHIO
from benchmarks.speed.problems import Problem, problems
from benchmarks.speed.race import Effort, race
from benchmarks.speed.report import drawn, sheets
from benchmarks.speed.result import RunResult
from benchmarks.speed.scaling import SIZES, Growth, growth
from benchmarks.speed.tick import TickTime, tick_times
from benchmarks.words import refuse_unknown
from hapticmech_ros.analysis.study import Sheet, Show, plain, silent
from hapticmech_ros.cli.console import OutOption, words
from hapticmech_ros.cli.study import FigureOption, JsonOption, carry_out
from hapticmech_ros.errors import InvalidInputError

DISTRIBUTIONS = ("mujoco", "pin", "numpy", "numba")
PEERS = {peer.name: peer for peer in (MUJOCO, PINOCCHIO)}
MOST_REPEATS = 1000


@dataclass(frozen=True, slots=True)
class Plan:
    """One run of the benchmark.

    Attributes:
        problems: scenes, in order.
        peers: ours first.
        absent: of the peers that were asked for, name and why it cannot run here.
        effort: repeats and budgets.
        smoke: check equality and time nothing.
        all_scenes: whether scenes were not chosen; scaling and ticks are measured only then.
    """

    problems: tuple[Problem, ...]
    peers: tuple[Peer, ...]
    absent: Mapping[str, str]
    effort: Effort
    smoke: bool
    all_scenes: bool


def plan(
    scenes: Sequence[str] = (),
    peers: Sequence[str] = (),
    integrators: Mapping[str, tuple[float, ...]] = DEFAULT,
    repeats: int = 5,
    quick: bool = False,
    smoke: bool = False,
) -> Plan:
    """Return a plan.

    Args:
        scenes: by name, all if empty; with ``quick`` or ``smoke`` all that are not large.
        peers: beside ours, by name; all if empty.
        integrators: of ours, and their steps in units of a scene; by order if empty.
        repeats: timed runs of each result.
        quick: few steps, short runs.
        smoke: no times.

    Raises:
        InvalidInputError: unknown scene, peer or integrator, or repeats out of range.
    """
    refuse_unknown("peer", peers, PEERS)
    if not 1 <= repeats <= MOST_REPEATS:
        raise InvalidInputError("repeats", repeats, f"must be from 1 to {MOST_REPEATS}")
    chosen = problems(scenes)
    if not scenes and (quick or smoke):
        chosen = tuple(problem for problem in chosen if not problem.large)
    wanted = peers or tuple(PEERS)
    absent = {name: f"not installed: {EXTRA}" for name in wanted if not find_spec(name)}
    ready = [PEERS[name] for name in wanted if name not in absent]
    effort = Effort(repeats, 0.05, 1.0, True) if quick else Effort(repeats)
    return Plan(chosen, (own_peer(integrators), *ready), absent, effort, smoke, not scenes)


@dataclass(frozen=True)
class SpeedResults(MachineResults):
    """All that the benchmark found.

    Attributes:
        absent: peers that are not installed, and how to install them.
        checks: of equality.
        results: runs; none if only equality was checked.
        ratios: of CPU times at equal error.
        scaling: CPU times over size.
        ticks: CPU times of a tick.
        goals: and whether they are met.
        problems: that were asked for.
    """

    NAME: ClassVar[str] = "bench_speed"
    FAULT: ClassVar[str] = "not all compute the same motion: see the table of equality"

    absent: Mapping[str, str]
    checks: tuple[Check, ...]
    results: tuple[RunResult, ...] = ()
    ratios: tuple[Ratio, ...] = ()
    scaling: tuple[Growth, ...] = ()
    ticks: tuple[TickTime, ...] = ()
    goals: tuple[Verdict, ...] = ()
    problems: tuple[Problem, ...] = ()

    @property
    def sound(self) -> bool:
        """Whether we compute every motion by every rule, and each peer those it can do by one."""
        ours = all(check.passed for check in self.checks if check.peer == OWN)
        asked = {(check.problem, check.peer) for check in self.checks if check.suitable}
        done = {(check.problem, check.peer) for check in self.checks if check.passed}
        return ours and asked <= done

    def document(self) -> dict[str, object]:
        """Return all but the problems."""
        names = ("machine", "absent", "checks", "results", "ratios", "scaling", "ticks", "goals")
        return {name: plain(getattr(self, name)) for name in (*names, "sound")}

    def sheets(self) -> Iterator[Sheet]:
        """Yield the tables of what there is."""
        return sheets(self.checks, self.results, self.scaling, self.ticks, self.goals)

    def figures(self) -> Mapping[str, Figure]:
        """Return error over CPU time, if anything was timed."""
        return {"bench_speed.png": drawn(self.results, self.problems)} if self.results else {}


def run_speed(plan: Plan, show: Show = silent) -> SpeedResults:
    """Carry out a plan."""
    for name, reason in plan.absent.items():
        show(f"without {name}: {reason}")
    checks: list[Check] = []
    results: list[RunResult] = []
    for problem in plan.problems:
        show(f"{problem.name}: equality")
        of_problem = [
            check(problem, peer, method) for peer in plan.peers for method in peer.methods
        ]
        checks += of_problem
        if not plan.smoke:
            results += race(problem, plan.peers, of_problem, plan.effort, show)
    if plan.smoke:
        return SpeedResults(_about(), plan.absent, tuple(checks), problems=plan.problems)
    effort, grown, ticks = plan.effort, tuple[Growth, ...](), tuple[TickTime, ...]()
    if plan.all_scenes:
        few = 2 if effort.quick else None
        sizes = {family: numbers[:few] for family, numbers in SIZES.items()}
        grown, more = growth(plan.peers, sizes, effort.repeats, effort.budget_s, show)
        checks += more
        show("ticks")
        ticks = tick_times()
    return SpeedResults(
        _about(),
        plan.absent,
        tuple(checks),
        tuple(results),
        ratios(results, OWN),
        grown,
        ticks,
        # What was measured over fewer sizes says little of growth.
        verdicts(results, () if plan.effort.quick else grown, ticks),
        plan.problems,
    )


def speed(
    scenes: Annotated[str, typer.Option(help="by name; all if not given")] = "",
    peers: Annotated[str, typer.Option(help="of mujoco, pinocchio; all if not given")] = "",
    integrators: Annotated[
        str,
        typer.Option(help="of ours, each with steps in units of a scene if wished: rk4:10:5:2,rk2"),
    ] = "rk4,tsit5",
    repeats: Annotated[int, typer.Option(help="timed runs, of all in turn")] = 5,
    quick: Annotated[
        bool, typer.Option("--quick", help="few steps, short runs, no large scenes")
    ] = False,
    smoke: Annotated[
        bool, typer.Option("--smoke", help="check that all compute the same, time nothing")
    ] = False,
    out: OutOption = Path("bench"),
    figure: FigureOption = None,
    json_only: JsonOption = False,
) -> None:
    """Race other simulators on the same mechanisms: equality first, then CPU time at precision."""
    chosen = plan(words(scenes), words(peers), _integrators(integrators), repeats, quick, smoke)
    carry_out(lambda show: run_speed(chosen, show), out, json_only, figure)


def _integrators(text: str) -> dict[str, tuple[float, ...]]:
    found = {}
    for word in words(text):
        name, *steps = word.split(":")
        try:
            found[name] = tuple(float(step) for step in steps)
        except ValueError:
            rule = "must be names, each with numbers behind colons if wished"
            raise InvalidInputError("--integrators", text, rule) from None
    return found


def _about() -> dict[str, object]:
    return {**machine(), **{name: _version(name) for name in DISTRIBUTIONS}}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "-"
