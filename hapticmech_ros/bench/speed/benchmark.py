"""The speed benchmark from plan to files."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from hapticmech_ros.bench.goals import Verdict
from hapticmech_ros.bench.machine import machine
from hapticmech_ros.bench.speed.equality import Check, check_all
from hapticmech_ros.bench.speed.fronts import Ratio, ratios
from hapticmech_ros.bench.speed.goals import verdicts
from hapticmech_ros.bench.speed.lane import Lane
from hapticmech_ros.bench.speed.own_peer import NAME as OWN
from hapticmech_ros.bench.speed.plan import Plan
from hapticmech_ros.bench.speed.race import race
from hapticmech_ros.bench.speed.report import Sheet, sheets
from hapticmech_ros.bench.speed.scaling import SIZES, Growth, growth
from hapticmech_ros.bench.speed.tick import TickTime, tick_times

JSON_NAME, TABLE_NAME = "bench_speed.json", "bench_speed.md"
PLOT_NAME = "bench_speed.png"
DISTRIBUTIONS = ("mujoco", "pin", "exudyn", "numpy", "numba")

# Told before each part.
Show = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Results:
    """All that the benchmark found.

    Attributes:
        machine: cores, kernel, versions.
        absent: peers that are not installed, and how to install them.
        checks: of equality.
        lanes: runs; none if only equality was checked.
        ratios: of CPU times at equal error.
        grown: CPU times over size.
        ticks: CPU times of a tick.
        goals: and whether they are met.
    """

    machine: Mapping[str, object]
    absent: Mapping[str, str]
    checks: tuple[Check, ...]
    lanes: tuple[Lane, ...] = ()
    ratios: tuple[Ratio, ...] = ()
    grown: tuple[Growth, ...] = ()
    ticks: tuple[TickTime, ...] = ()
    goals: tuple[Verdict, ...] = ()

    @property
    def sound(self) -> bool:
        """Whether we compute every motion by every rule, and each peer those it can do by one."""
        ours = all(check.passed for check in self.checks if check.peer == OWN)
        asked = {(check.problem, check.peer) for check in self.checks if check.suitable}
        done = {(check.problem, check.peer) for check in self.checks if check.passed}
        return ours and asked <= done

    def sheets(self) -> list[Sheet]:
        """Return the results as tables."""
        return list(sheets(self.checks, self.lanes, self.grown, self.ticks, self.goals))

    def document(self) -> dict[str, object]:
        """Return the results as plain dictionaries, lists and numbers."""
        lanes = [
            {**asdict(lane), "median": lane.median, "p90": lane.p90, "max": lane.slowest}
            for lane in self.lanes
        ]
        return {
            "machine": dict(self.machine),
            "absent": dict(self.absent),
            "checks": [{**asdict(check), "passed": check.passed} for check in self.checks],
            "lanes": lanes,
            "ratios": [{**asdict(ratio), "value": ratio.value} for ratio in self.ratios],
            "scaling": [{**asdict(one), "exponent": one.exponent} for one in self.grown],
            "ticks": [asdict(tick) for tick in self.ticks],
            "goals": [asdict(goal) for goal in self.goals],
            "sound": self.sound,
        }


def run_speed(
    plan: Plan, out: Path, show: Show = lambda line: None, figure: Path | None = None
) -> Results:
    """Carry out a plan and write results into ``out``.

    Writes ``bench_speed.json`` and ``bench_speed.md``, and, if anything was timed, the plot:
    ``bench_speed.png`` or ``figure``.
    """
    from hapticmech_ros.bench.speed.figure import draw

    out.mkdir(parents=True, exist_ok=True)
    for name, reason in plan.absent.items():
        show(f"without {name}: {reason}")
    results = _smoke(plan, show) if plan.smoke else _timed(plan, show)
    text = json.dumps(results.document(), indent=1, ensure_ascii=False, allow_nan=False)
    (out / JSON_NAME).write_text(text + "\n", encoding="utf-8")
    tables = "\n".join(sheet.markdown() for sheet in results.sheets())
    (out / TABLE_NAME).write_text(tables, encoding="utf-8")
    if results.lanes:
        draw(results.lanes, plan.problems, figure or out / PLOT_NAME)
    return results


def _smoke(plan: Plan, show: Show) -> Results:
    checks: list[Check] = []
    for problem in plan.problems:
        show(f"{problem.name}: equality")
        checks += check_all([problem], plan.peers)
    return Results(_about(), plan.absent, tuple(checks))


def _timed(plan: Plan, show: Show) -> Results:
    checks: list[Check] = []
    lanes: list[Lane] = []
    for problem in plan.problems:
        show(f"{problem.name}: equality")
        of_problem = check_all([problem], plan.peers)
        checks += of_problem
        lanes += race(problem, plan.peers, of_problem, plan.effort, show)
    grown: tuple[Growth, ...] = ()
    ticks: tuple[TickTime, ...] = ()
    if plan.all_scenes:
        sizes = SIZES[:2] if plan.effort.quick else SIZES
        effort = plan.effort
        grown, more = growth(plan.peers, sizes, effort.repeats, effort.budget_s, show)
        checks += more
        show("ticks")
        ticks = tick_times()
    found = ratios(lanes, OWN)
    # What was measured over fewer sizes says little of growth.
    whole = () if plan.effort.quick else grown
    goals = verdicts(lanes, whole, ticks)
    return Results(_about(), plan.absent, tuple(checks), tuple(lanes), found, grown, ticks, goals)


def _about() -> dict[str, object]:
    return {**machine(), **{name: _version(name) for name in DISTRIBUTIONS}}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "-"
