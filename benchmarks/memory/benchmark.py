# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The memory benchmark: the resident size of a session and of the graph's nodes, over time."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, cast

import typer

from benchmarks.children import BenchError, ReportingProcess, ids, output_to
from benchmarks.graph.plan import LAYOUTS, Configuration, Layout, Step, scene_at_rate
from benchmarks.graph.run import graph_environment, probe_command, start_graph, wait_until_engaged
from benchmarks.graph.statuses import status_of
from benchmarks.machine import MachineResults, machine
from benchmarks.memory.growth import HOUR, WARM_UP_SHARE, Grown, Watch, grown
from hapticmech_ros.analysis.study import Sheet, Show, judged, silent
from hapticmech_ros.cli.console import OutOption, SceneArgument
from hapticmech_ros.cli.study import JsonOption, carry_out
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Session

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RATE_HZ = 1000.0
MINUTE = 60.0
MEBI = float(1 << 20)
SAMPLES = 400
# Lines that tell how far a session is.
TOLD = 20


@dataclass(frozen=True, slots=True)
class Settings:
    """What to watch, and for how long.

    Attributes:
        scene: shipped scene, or path of a file.
        hours: simulated by the session; 0 leaves it out.
        minutes: of the graph; 0 leaves it out.
        period: s between samples of the graph.
        layout: of the graph's processes.
        warm_up: share of the time that is not looked at.

    Raises:
        InvalidInputError: a number out of its range, nothing to do, or an unknown layout.
    """

    scene: str = "five_bar"
    hours: float = 1.0
    minutes: float = 60.0
    period: float = 5.0
    layout: Layout = "separate"
    warm_up: float = WARM_UP_SHARE

    def __post_init__(self) -> None:
        for name, value in (("hours", self.hours), ("minutes", self.minutes)):
            if not (math.isfinite(value) and value >= 0.0):
                raise InvalidInputError(name, value, "must be 0 or more")
        if self.hours == 0.0 and self.minutes == 0.0:
            raise InvalidInputError("hours and minutes", (0.0, 0.0), "must not both be 0")
        if not 0.0 < self.period <= 600.0:
            raise InvalidInputError("period", self.period, "must be above 0, at most 600 s")
        if self.layout not in LAYOUTS:
            raise InvalidInputError("layout", self.layout, f"must be one of {', '.join(LAYOUTS)}")
        if not 0.0 <= self.warm_up < 1.0:
            raise InvalidInputError("warm-up", self.warm_up, "must be 0 to below 1")


@dataclass(frozen=True)
class MemoryResults(MachineResults):
    """All that was found.

    Attributes:
        settings: what was watched.
        processes: how each has grown.
        watches: samples of the ``session`` and of the ``graph``.
        said: by node, what it said of itself last.
    """

    NAME: ClassVar[str] = "bench_memory"
    FAULT: ClassVar[str] = "something grows"

    settings: Settings
    processes: tuple[Grown, ...]
    watches: Mapping[str, Watch]
    said: Mapping[str, str]

    @property
    def flat(self) -> bool:
        """Whether nothing grows."""
        return all(one.trend.flat for one in self.processes)

    @property
    def sound(self) -> bool:
        """Whether nothing grows."""
        return self.flat

    def sheets(self) -> Iterator[Sheet]:
        """Yield how large each process is, and whether it grows."""
        numbers = ("ticks", "first", "last", "largest", "private, first", "last", "slope, B/s", "±")
        rows = []
        for one in self.processes:
            trend, private = one.trend, (one.private_first, one.private_last)
            rows.append(
                (
                    one.name if one.where == one.name else f"{one.where}: {one.name}",
                    f"{one.ticks}",
                    *(f"{size / MEBI:.2f}" for size in (trend.first, trend.last, trend.largest)),
                    *("?" if size is None else f"{size / MEBI:.2f}" for size in private),
                    f"{trend.slope:+.1f}",
                    f"{trend.slope_error:.1f}",
                    judged(trend.verdict, trend.flat),
                )
            )
        title = "resident size after the warm-up, MiB"
        yield Sheet(title, ("process", *numbers, "verdict"), tuple(rows), ("verdict",))

    def notes(self) -> list[str]:
        """Return what nodes said of themselves, and what the machine is."""
        said = (f"{node}: {sentence}" for node, sentence in self.said.items())
        return [*said, *super().notes()]

    def figures(self) -> Mapping[str, Figure]:
        """Return the growth of each process over time, a panel for each watch."""
        # Not before: matplotlib would count in the session's memory.
        from benchmarks.memory.figure import drawn

        return {"bench_memory.png": drawn(self.watches, self.settings.warm_up)}


def run_memory(settings: Settings, out: Path, show: Show = silent) -> MemoryResults:
    """Watch session and graph, one after the other; ``memory_nodes.log`` goes into ``out``.

    Raises:
        InvalidInputError: too short to say anything.
        BenchError: the graph did not work.
    """
    out.mkdir(parents=True, exist_ok=True)
    watches: dict[str, Watch] = {}
    found: list[Grown] = []
    said: dict[str, str] = {}
    if settings.hours:
        scene = load_scene(settings.scene)
        ticks = round(settings.hours * HOUR / scene.simulation.period)
        watches["session"] = watch_session(scene, ticks, show)
        found += grown("session", watches["session"], ticks, settings.warm_up)
    if settings.minutes:
        watches["graph"], said = watch_graph(
            settings.scene, settings.minutes, settings.period, out, settings.layout, show
        )
        periods = round(settings.minutes * MINUTE * RATE_HZ)
        found += grown("graph", watches["graph"], periods, settings.warm_up)
    return MemoryResults(machine(), settings, tuple(found), watches, said)


def watch_session(scene: Scene, ticks: int, show: Show = silent, samples: int = SAMPLES) -> Watch:
    """Run a session for many ticks, and return how large the process was meanwhile.

    Args:
        scene: to run.
        ticks: how many.
        show: told of the progress.
        samples: how many; times are those of the simulation's clock, s.
    """
    session, processes, watch = Session(scene), {"session": os.getpid()}, Watch()
    tick, done, begun = session.tick, 0, time.perf_counter()
    watch.look(0.0, processes)
    for number in range(1, samples + 1):
        until = ticks * number // samples
        for _ in range(until - done):
            tick()
        done = until
        watch.look(session.time, processes)
        if number % max(samples // TOLD, 1) == 0:
            spent = time.perf_counter() - begun
            show(f"session: {session.time:.0f} s simulated in {spent:.0f} s")
    return watch


def watch_graph(
    scene: str,
    minutes: float,
    period: float,
    folder: Path,
    layout: Layout = "separate",
    show: Show = silent,
) -> tuple[Watch, dict[str, str]]:
    """Run a private graph at 1 kHz, and return how large its processes were meanwhile.

    Args:
        scene: shipped scene, or path of a file.
        minutes: how long, from when the graph works.
        period: s between samples.
        folder: for what the nodes print, and the scene at 1 kHz.
        layout: a process for each node, or one for all.
        show: told once a minute.

    Returns:
        The samples, and by node what it said of itself last.

    Raises:
        BenchError: the graph does not begin to work, or a node ended.
    """
    path = scene_at_rate(scene, RATE_HZ, folder)
    step = Step(Configuration(RATE_HZ, layout, False), 1, "real")
    environment, watch = graph_environment(), Watch()
    with ExitStack() as stack:
        with output_to(folder / "memory_nodes.log"):
            probe = stack.enter_context(ReportingProcess(probe_command(), environment))
            graph = stack.enter_context(start_graph(step, str(path), environment))
        processes = ids(graph.processes)
        wait_until_engaged(graph, probe)
        begun, told = time.monotonic(), 0.0
        while (passed := time.monotonic() - begun) < MINUTE * minutes:
            graph.check()
            if not watch.look(passed, processes):
                raise BenchError(f"a node ended after {passed:.0f} s")
            if passed >= told:
                show(f"graph: {passed / MINUTE:.0f} of {minutes:g} minutes")
                told += MINUTE
            time.sleep(period)
        last = {status.node: status.message for status in map(status_of, probe.of("status"))}
    return watch, {node: last.get(node, "") for node in NODES}


def memory(
    scene: SceneArgument = "five_bar",
    hours: Annotated[float, typer.Option(help="simulated by the session; 0: no session")] = 1.0,
    minutes: Annotated[float, typer.Option(help="of the graph at 1 kHz; 0: no graph")] = 60.0,
    period: Annotated[float, typer.Option(help="s between looks at the graph")] = 5.0,
    layout: Annotated[str, typer.Option(help="of the graph: separate or composed")] = "separate",
    warm_up: Annotated[float, typer.Option(help="share of the time that does not count")] = 0.25,
    out: OutOption = Path("bench"),
    json_only: JsonOption = False,
) -> None:
    """Watch the resident size of a session and of the graph's nodes: do they stay as they are?"""
    # The settings refuse layouts that they do not know.
    settings = Settings(scene, hours, minutes, period, cast("Layout", layout), warm_up)
    carry_out(lambda show: run_memory(settings, out, show), out, json_only)
