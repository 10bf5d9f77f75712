# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot through singular poses and against a wall: our law beside two that are in use.

MuJoCo moves the robot, with friction and a payload that no law knows. Ours has the rates that
follow from the loop's delay and a payload of 1 kg; of each other law the best setting of a grid
counts for all that a robot is asked to do: what is lost, ends with its elbow on the other side, or
needs more torque than the motors have, does not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import typer
from matplotlib.figure import Figure

from benchmarks.goals import Verdict, goal_sheet, verdict
from benchmarks.machine import MachineResults, machine
from benchmarks.robot.bilateral import Felt, felt
from benchmarks.robot.environment import (
    DELAYS,
    ENVIRONMENTS,
    environment_figure,
    environment_sheet,
    loop,
)
from benchmarks.robot.felt_environment import INTERFACES as TAKEN
from benchmarks.robot.felt_environment import FeltEnvironment, felt_environment
from benchmarks.robot.laws import OBSERVED, OURS, Setting, settings
from benchmarks.robot.other_paths import Elsewhere, elsewhere, elsewhere_sheets
from benchmarks.robot.tasks import ROBOTS, TASKS
from benchmarks.robot.trial import Measured, Stage
from benchmarks.speed.contender import setting_text
from hapticmech_ros.analysis.study import Sheet, Show, judged, number, silent
from hapticmech_ros.cli.console import OutOption
from hapticmech_ros.cli.study import JsonOption, carry_out
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.robot.interfaces import Interface
from hapticmech_ros.robot.law import OperationalLaw
from hapticmech_ros.robot.mujoco_robot import MujocoRobot, Unmodelled

# Of the terms of MuJoCo and ours, relative to the largest entry: both add some hundred products of
# numbers of 2e-16 each.
EQUAL = 1e-12
POSES = 100
# kg, N m s/rad and N m.
UNKNOWN = Unmodelled(payload=0.5, damping=0.5, friction=0.5)
CONDITIONS: dict[str, Unmodelled] = {"as modelled": Unmodelled(), "disturbed": UNKNOWN}
# Of the felt wall.
INTERFACES: tuple[tuple[Interface, bool], ...] = (
    ("effort", False),
    ("velocity", False),
    ("position", False),
    ("position", True),
)
FEEDBACKS = (0.0, 0.3, 1.0)
# rad: a joint that is farther from where it began has gone to the other side of a singular pose.
FLIPPED = 0.5


@dataclass(frozen=True)
class Chosen:
    """A law with the numbers chosen for a robot.

    Attributes:
        robot: its name.
        condition: that it is to do its tasks in.
        law: its name.
        values: chosen, by name; None: no setting did all tasks.
        observer: rate of the observer of disturbances, 1/s.
        tried: number of settings.
    """

    robot: str
    condition: str
    law: str
    values: Mapping[str, float] | None
    observer: float
    tried: int


@dataclass(frozen=True)
class Row:
    """What was measured of a law.

    Attributes:
        task: what was done.
        condition: whether with what the law does not know.
        law: its name.
        measured: None: the robot was lost.
    """

    task: str
    condition: str
    law: str
    measured: Measured | None


@dataclass(frozen=True)
class RobotResults(MachineResults):
    """What was measured.

    Attributes:
        difference: largest relative difference of D, h and J between MuJoCo and us, by robot.
        chosen: settings of the laws.
        rows: what was measured of them.
        felt: of a wall by a hand, through device, mechanism and robot.
        environments: felt impedance of known environments.
        others: path errors where no setting was chosen.
    """

    NAME: ClassVar[str] = "bench_robot"
    FAULT: ClassVar[str] = "the robots are not the same in both, or our law lost one"

    difference: Mapping[str, float]
    chosen: tuple[Chosen, ...]
    rows: tuple[Row, ...]
    felt: tuple[Felt, ...]
    environments: tuple[FeltEnvironment, ...]
    others: tuple[Elsewhere, ...]

    @property
    def sound(self) -> bool:
        """Whether both have the same robots, and our law lost none."""
        kept = all(row.measured is not None for row in self.rows if row.law == OURS + OBSERVED)
        return kept and max(self.difference.values(), default=0.0) <= EQUAL

    def sheets(self) -> Iterator[Sheet]:
        """Yield settings, measurements and goals."""
        if self.chosen:
            yield self._settings()
        for task in dict.fromkeys(row.task for row in self.rows):
            for condition in CONDITIONS:
                yield self._sheet(task, condition)
        if self.rows:
            yield goal_sheet(self._goals())
        if self.others:
            yield from elsewhere_sheets(self.others)
        if self.felt:
            yield self._felt()
            yield environment_sheet(self.environments)

    def figures(self) -> Mapping[str, Figure]:
        """Return felt over desired impedance of environments."""
        found = self.environments
        return {"felt_environment.png": environment_figure(found)} if found else {}

    def _settings(self) -> Sheet:
        rows = (
            (
                one.robot,
                one.condition,
                one.law,
                "none" if one.values is None else setting_text(one.values),
                str(one.tried),
            )
            for one in self.chosen
        )
        return Sheet(
            "settings",
            ("robot", "condition", "law", "chosen", "tried"),
            tuple(rows),
            ("condition", "law", "chosen"),
            "largest relative difference of D, h and J between MuJoCo and us: "
            + ", ".join(f"{name} {value:.1e}" for name, value in self.difference.items()),
        )

    def _felt(self) -> Sheet:
        rows = [
            (
                one.interface,
                f"{one.feedback:g}",
                "yes" if one.held else "no",
                f"{one.wall_n:.3f}",
                f"{one.hand_n:.3f}",
                f"{one.swing_n:.3f}",
                f"{one.peak_n:.0f}",
                f"{one.lag_mm:.2f}",
                f"{1e3 * one.hand_j:.1f}",
                f"{1e3 * one.coupling_j:.1f}",
                str(one.changed),
                judged("yes" if one.passive else "no", one.passive),
            )
            for one in self.felt
        ]
        return Sheet(
            "a wall felt through device, mechanism and robot",
            (
                "interface",
                "feedback",
                "held",
                "on the wall, N",
                "by the hand, N",
                "swing, N",
                "peak, N",
                "lag, mm",
                "least from the hand, mJ",
                "given by the robot, mJ",
                "changed",
                "passive",
            ),
            tuple(rows),
        )

    def _sheet(self, task: str, condition: str) -> Sheet:
        found = [row for row in self.rows if (row.task, row.condition) == (task, condition)]
        return Sheet(
            f"{task}, {condition}",
            (
                "law",
                "path rms, mm",
                "max, mm",
                "force rms, N",
                "peak, N",
                "along wall rms, mm",
                "torque / limit",
                "torque rate, kN m/s",
                "drift, rad",
                "saturated, ms",
            ),
            tuple((row.law, *_cells(row.measured)) for row in found),
            kept=32,
        )

    def _goals(self) -> Iterator[Verdict]:
        """Yield in which tasks our law, with the observer, is ahead of the others, in what."""
        keys = dict.fromkeys((row.task, row.condition) for row in self.rows)
        for task, condition in keys:
            rows = [row for row in self.rows if (row.task, row.condition) == (task, condition)]
            for what, unit, of in (
                ("path", "mm", lambda one: one.path_rms_mm),
                ("force", "N", lambda one: one.force_rms_n),
            ):
                errors = {
                    row.law: np.inf if row.measured is None else of(row.measured) for row in rows
                }
                own = errors.pop(OURS + OBSERVED, np.inf)
                errors.pop(OURS, None)
                if errors:
                    other = min(errors, key=lambda name: errors[name])
                    seen = f"{own:.3g} {unit}, {other} {errors[other]:.3g} {unit}"
                    least = f"{task}, {condition}: least error of the {what}"
                    yield verdict(least, seen, own <= errors[other])


def _cells(found: Measured | None) -> tuple[str, ...]:
    if found is None:
        return ("lost",)
    return (
        f"{found.path_rms_mm:.3f}",
        f"{found.path_max_mm:.3f}",
        f"{found.force_rms_n:.3f}",
        f"{found.force_peak_n:.0f}",
        f"{found.slide_rms_mm:.3f}",
        f"{found.peak_torque:.2f}",
        f"{found.torque_rate:.2f}",
        number(found.drift, ".3f"),
        str(found.saturated),
    )


def difference(law: OperationalLaw, poses: int = POSES) -> float:
    """Return the largest relative difference of D, h and J between MuJoCo and us.

    Args:
        law: of the robot.
        poses: number of random states.
    """
    robot, chance, worst = MujocoRobot(law.mechanism.scene), np.random.default_rng(0), 0.0
    for _ in range(poses):
        q, v = chance.uniform(-3.0, 3.0, robot.nv), chance.normal(size=robot.nv)
        robot.put(q, v)
        state = law.state(q, v)
        ours = state.factor @ state.factor.T, state.bias_force, state.point.jacobian
        for one, other in zip(robot.terms(), ours, strict=True):
            worst = max(worst, float(np.abs(one - other).max() / np.abs(one).max()))
    return worst


def done(stage: Stage, setting: Setting, most: float = np.inf) -> Measured | None:
    """Return what is measured of a task; None if the robot was lost, or has an error above, mm."""
    try:
        return stage.run(setting, most)
    except HapticMechError:
        return None


def _score(found: Measured | None) -> float:
    """Return what a setting is chosen by; infinite if it does not count."""
    if found is None or found.saturated or (found.drift or 0.0) > FLIPPED:
        return float("inf")
    return found.score


def choose(
    robot: str,
    condition: str,
    law: str,
    tried: Sequence[Setting],
    stages: Sequence[Stage],
    show: Show,
) -> tuple[Chosen, Setting | None]:
    """Return the setting with the least sum of scores over a robot's tasks.

    Args:
        robot: its name.
        condition: of the tasks.
        law: its name.
        tried: settings.
        stages: the robot's tasks.
        show: called with what was found.
    """
    scores: list[float] = []
    for setting in tried:
        score, least = 0.0, min(scores, default=float("inf"))
        for stage in stages:
            # Scores only add up: what is no better now is no better in the end.
            score += _score(done(stage, setting, least - score))
            if score >= least:
                break
        scores.append(score)
        show(f"{robot}, {condition}, {law}, {setting_text(setting.values)}: {score:.4g}")
    # A law whose setting is not chosen is measured with it, whatever comes of it.
    counts = len(tried) == 1 or min(scores) < float("inf")
    best = tried[int(np.argmin(scores))] if counts else None
    values, observer = (best.values, best.observer) if best else (None, 0.0)
    return Chosen(robot, condition, law, values, observer, len(tried)), best


def run_benchmark(
    quick: bool,
    laws: bool = True,
    others: bool = True,
    touched: bool = True,
    show: Show = silent,
) -> RobotResults:
    """Choose settings, and measure them; then let a hand feel a wall.

    Args:
        quick: one setting of each law, and one task.
        laws: whether laws are compared on the tasks of both robots.
        others: whether they are on other paths, with other payloads; never if quick.
        touched: whether it is measured what is felt of what a robot touches.
        show: called with what was done.
    """
    differences: dict[str, float] = {}
    chosen: list[Chosen] = []
    rows: list[Row] = []
    robots = {"iiwa14": ("reach",)} if quick else ROBOTS
    for robot, names in robots.items() if laws else ():
        tasks = [TASKS[name]() for name in names]
        stages = {
            condition: [Stage(task, unknown) for task in tasks]
            for condition, unknown in CONDITIONS.items()
        }
        differences[robot] = difference(OperationalLaw(stages[next(iter(stages))][0].mechanism))
        show(f"{robot}: D, h and J differ from MuJoCo's by {differences[robot]:.1e}")
        for condition, of in stages.items():
            for law, tried in settings(tasks[0], quick).items():
                found, best = choose(robot, condition, law, tried, of, show)
                chosen.append(found)
                if best is not None:
                    rows += [Row(one.task.name, condition, law, done(one, best)) for one in of]
    cases = tuple(elsewhere(show)) if others and not quick else ()
    walls = tuple(
        felt(interface, share, with_rates, passive=held)
        for interface, with_rates in INTERFACES
        for share in FEEDBACKS
        for held in (False, True)
        if touched
    )
    environments = tuple(
        felt_environment(loop(), name, environment, interface, delay)
        for name, environment in ENVIRONMENTS.items()
        for interface in TAKEN
        for delay in DELAYS
        if touched and (not quick or (name, interface, delay) == ("spring", "effort", 0))
    )
    return RobotResults(
        machine(), differences, tuple(chosen), tuple(rows), walls, environments, cases
    )


def robot(
    quick: Annotated[bool, typer.Option(help="one task, one setting of each law")] = False,
    laws: Annotated[bool, typer.Option(help="compare laws on both robots' tasks")] = True,
    others: Annotated[bool, typer.Option(help="compare them on other paths")] = True,
    touched: Annotated[bool, typer.Option(help="what is felt of what a robot touches")] = True,
    out: OutOption = Path("bench"),
    json_only: JsonOption = False,
) -> None:
    """Lead robots through singular poses and press them on a wall, by three laws, in MuJoCo."""
    carry_out(lambda show: run_benchmark(quick, laws, others, touched, show), out, json_only)
