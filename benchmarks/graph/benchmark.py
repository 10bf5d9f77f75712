# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The graph's benchmark: from options to results."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, cast

import typer
from rclpy.utilities import get_rmw_implementation_identifier

from benchmarks.goals import Verdict, goal_sheet
from benchmarks.graph.checks import Expected, expected
from benchmarks.graph.comparison import Comparison, compare, verdicts
from benchmarks.graph.plan import VIEW_HZ, Layout, Plan, scene_at_rate
from benchmarks.graph.run import SETTLES_S, Run, measure
from benchmarks.machine import MachineResults, machine
from hapticmech_ros.analysis.study import Sheet, Show, silent
from hapticmech_ros.cli.console import OutOption, SceneArgument, words
from hapticmech_ros.cli.study import JsonOption, carry_out, numbers
from hapticmech_ros.loading import load_scene
from hapticmech_ros.system.discovery import Transport


@dataclass(frozen=True)
class GraphResults(MachineResults):
    """All that the benchmark found.

    Attributes:
        plan: what was run.
        session: what the real graph was expected to do.
        runs: in the order of time.
        comparisons: real and bare graph by configuration.
        goals: verdicts.
    """

    NAME: ClassVar[str] = "bench_graph"
    FAULT: ClassVar[str] = "some runs did not pass their checks: their times mean little"

    plan: Plan
    session: Expected
    runs: tuple[Run, ...]
    comparisons: tuple[Comparison, ...]
    goals: tuple[Verdict, ...]

    @property
    def sound(self) -> bool:
        """Whether every run gave figures and passed its checks, and both graphs are alike."""
        alike = all(one.alike is None or one.alike.held for one in self.comparisons)
        return alike and all(run.sound for run in self.runs)

    def sheets(self) -> Iterator[Sheet]:
        """Yield the tables of each configuration, and the goals."""
        for comparison in self.comparisons:
            yield comparison.sheet()
        yield goal_sheet(self.goals)


def run_benchmark(plan: Plan, out: Path, show: Show = silent) -> GraphResults:
    """Run all steps of a plan.

    Writes ``nodes.log`` (what the nodes printed) and ``scenes/``, copies of the scene at the plan's
    rates, into ``out``.

    Raises:
        SceneError: no such scene, or it refuses a rate.
    """
    scene = load_scene(plan.scene)
    point = scene.operational_point().name
    scenes = {rate: scene_at_rate(plan.scene, rate, out / "scenes") for rate in plan.rates_hz}
    (out / "nodes.log").unlink(missing_ok=True)
    show("simulating the same without ROS")
    session = expected(scene, plan.seconds + SETTLES_S)
    facts = {**machine(), "rmw": get_rmw_implementation_identifier()}
    runs: list[Run] = []
    for step in plan.steps():
        show(f"{step.configuration}: {step.kind} graph, run {step.repeat} of {plan.repeats}")
        path = scenes[step.configuration.rate_hz]
        runs.append(measure(step, path, point, plan.seconds, out, session))
        if runs[-1].failure:
            show(f"  no figures: {runs[-1].failure}")
    comparisons = tuple(
        compare(configuration, runs, point) for configuration in plan.configurations()
    )
    return GraphResults(facts, plan, session, tuple(runs), comparisons, verdicts(comparisons))


def graph(
    scene: SceneArgument = "five_bar",
    rates: Annotated[str, typer.Option(help="control rates, Hz")] = "500,1000,2000,4000",
    layout: Annotated[str, typer.Option(help="separate, composed or both")] = "separate,composed",
    record: Annotated[
        bool | None,
        typer.Option("--record/--no-record", show_default="both", help="with a recorder or not"),
    ] = None,
    seconds: Annotated[float, typer.Option(help="s that each run is watched")] = 20.0,
    repeats: Annotated[int, typer.Option(help="runs of each graph in each configuration")] = 2,
    transport: Annotated[
        str, typer.Option(help="auto (the lane where it can be), middleware or both")
    ] = "auto",
    view_rates: Annotated[
        str, typer.Option(help="of the topics for people, Hz: 1000 is CRTK at the control rate")
    ] = f"{VIEW_HZ:g}",
    out: OutOption = Path("bench"),
    json_only: JsonOption = False,
) -> None:
    """Time the graph beside a bare one: same processes, topics and messages, empty callbacks."""
    plan = Plan(
        scene,
        rates_hz=tuple(numbers("--rates", rates, float)),
        # The plan refuses layouts and transports that it does not know.
        layouts=cast("tuple[Layout, ...]", words(layout)),
        recorded=(False, True) if record is None else (record,),
        seconds=seconds,
        repeats=repeats,
        transports=cast("tuple[Transport, ...]", words(transport)),
        views_hz=tuple(numbers("--view-rates", view_rates, float)),
    )
    carry_out(lambda show: run_benchmark(plan, out, show), out, json_only)
