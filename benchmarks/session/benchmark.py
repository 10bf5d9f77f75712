# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The session benchmark: what a tick costs, call by call and in a run, beside MuJoCo's step."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import typer

from benchmarks.ablation.loop import PARTS, Loop
from benchmarks.goals import Verdict, at_most, goal_sheet
from benchmarks.machine import MachineResults, cpu_times, machine
from benchmarks.speed.mujoco_peer import MujocoScene, at_start, stepping
from hapticmech_ros.analysis.study import Sheet, Show, number, silent
from hapticmech_ros.cli.console import OutOption
from hapticmech_ros.cli.study import JsonOption, carry_out
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.loading import load_scene, shipped_scenes
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Session

# Ticks of a session whose results are compared, before any is timed; and in a round.
COMPARED, TICKS = 400, 200
# Goals, µs, of the scene that the paper is about and of all others; and of the ratio of a tick to
# what its kernel takes.
SCENE, TICK_US, RUN_US, ANY_US, RATIO = "five_bar", 30.0, 25.0, 80.0, 1.3


@dataclass(frozen=True, slots=True)
class TickCost:
    """CPU times of a scene's tick, medians of rounds, µs.

    Attributes:
        scene: its name.
        tick: by ``Session.tick``.
        tick_p90: the round that nine of ten are faster than.
        run: by ``Session.run``, a tick.
        parts: of the kernel, by part, called one by one.
        mj_step: of MuJoCo's step of the mechanism alone; None where it has no such mechanism.
    """

    scene: str
    tick: float
    tick_p90: float
    run: float
    parts: dict[str, float]
    mj_step: float | None

    @property
    def ratio(self) -> float:
        """A tick to what its kernel takes."""
        return self.tick / self.run

    @property
    def to_mujoco(self) -> float | None:
        """A tick to MuJoCo's step."""
        return None if self.mj_step is None else self.tick / self.mj_step


@dataclass(frozen=True)
class SessionResults(MachineResults):
    """What ticks cost.

    Attributes:
        ticks: in a round.
        rounds: of which medians are.
        costs: of each scene.
    """

    NAME: ClassVar[str] = "bench_session"

    ticks: int
    rounds: int
    costs: tuple[TickCost, ...]

    @property
    def goals(self) -> tuple[Verdict, ...]:
        """Goals, and whether they are met."""
        own = next((cost for cost in self.costs if cost.scene == SCENE), None)
        slowest = max(self.costs, key=lambda cost: cost.tick)
        tick, run, ratio = (own.tick, own.run, own.ratio) if own else (None, None, None)
        every = f"{slowest.scene}: {{:.1f}} µs"
        return (
            at_most(f"{SCENE}: a tick at most {TICK_US:g} µs", tick, TICK_US, "{:.1f} µs"),
            at_most(f"{SCENE}: in a run at most {RUN_US:g} µs", run, RUN_US, "{:.1f} µs"),
            at_most(f"{SCENE}: a tick at most {RATIO:g} of its kernel", ratio, RATIO, "{:.2f}"),
            at_most(f"every scene: a tick at most {ANY_US:g} µs", slowest.tick, ANY_US, every),
        )

    def sheets(self) -> Iterator[Sheet]:
        """Yield times of each scene, and the goals."""
        numbers = ("tick", "p90", "run", "tick / run", *PARTS, "mj_step", "tick / mj_step")
        rows = tuple(
            (
                cost.scene,
                *(f"{value:.1f}" for value in (cost.tick, cost.tick_p90, cost.run)),
                f"{cost.ratio:.2f}",
                *(f"{cost.parts[part]:.1f}" for part in PARTS),
                number(cost.mj_step, ".1f"),
                number(cost.to_mujoco, ".1f"),
            )
            for cost in self.costs
        )
        yield Sheet(
            "a tick of the session, µs",
            ("scene", *numbers),
            rows,
            caption="mj_step moves the mechanism alone, by MuJoCo's implicitfast rule",
        )
        yield goal_sheet(self.goals)


def tick_cost(scene: Scene, rounds: int) -> TickCost:
    """Return what a scene's tick costs.

    Raises:
        HapticMechError: ticks and a run of them differ.
    """
    check_agreement(scene)
    ticked, running = Session(scene), Session(scene)
    into = np.zeros((TICKS, running.layout.size))
    callers: dict[str, Callable[[], object]] = {
        "tick": lambda: _ticks(ticked),
        "run": lambda: running.run(TICKS, into=into),
    }
    # Without MuJoCo, or such a mechanism in it, there is no step of it.
    with suppress(ImportError, HapticMechError):
        callers["mj_step"] = stepping(*at_start(MujocoScene(scene), scene), TICKS)
    times = {name: 1e6 * taken / TICKS for name, taken in cpu_times(callers, rounds).items()}
    parts = Loop(scene).timed(rounds * TICKS)
    medians = {name: float(np.median(taken)) for name, taken in times.items()}
    return TickCost(
        scene.name,
        medians["tick"],
        float(np.quantile(times["tick"], 0.9)),
        medians["run"],
        dict(zip(PARTS, (1e-3 * np.median(parts, axis=0)).tolist(), strict=True)),
        medians.get("mj_step"),
    )


def check_agreement(scene: Scene) -> None:
    """Compare ticks one by one with a run of them.

    Raises:
        HapticMechError: they differ in a bit.
    """
    one, run = Session(scene), Session(scene).run(COMPARED)
    for row in range(COMPARED):
        sample = one.tick()
        same = np.array_equal(sample.acting[0], run["on_hand"][row])
        if not (same and np.array_equal(sample.mechanism.q, run["q"][row])):
            raise HapticMechError(f"{scene.name}: tick {row} differs in a run")


def _ticks(session: Session) -> None:
    for _ in range(TICKS):
        session.tick()


def run_session(names: list[str], rounds: int, show: Show = silent) -> SessionResults:
    """Return what ticks of scenes cost."""
    costs = []
    for index, name in enumerate(names, 1):
        show(f"{index} of {len(names)}: {name}")
        costs.append(tick_cost(load_scene(name), rounds))
    return SessionResults(machine=machine(), ticks=TICKS, rounds=rounds, costs=tuple(costs))


def session(
    scenes: Annotated[
        list[str] | None, typer.Argument(help="shipped scenes or files; all shipped ones if none")
    ] = None,
    rounds: Annotated[int, typer.Option(help="of which medians are", min=1)] = 15,
    out: OutOption = Path("bench"),
    json_only: JsonOption = False,
) -> None:
    """What a tick of a session costs: alone, in a run, part by part, and beside MuJoCo's step."""
    names = scenes or sorted(shipped_scenes())
    carry_out(lambda show: run_session(names, rounds, show), out, json_only)
