# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The real-time benchmark: the graph with what a machine grants and without, idle and busy."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Annotated, ClassVar

import typer

from benchmarks.children import busy_programs
from benchmarks.graph.checks import expected
from benchmarks.graph.plan import Configuration, Step, scene_at_rate
from benchmarks.graph.run import SETTLES_S, measure
from benchmarks.graph.statuses import MISSED, ROUND_TRIP, Figures, latency
from benchmarks.machine import MachineResults, machine
from hapticmech_ros.analysis.study import Sheet, Show, number, silent
from hapticmech_ros.cli.console import OutOption
from hapticmech_ros.cli.study import JsonOption, carry_out, numbers
from hapticmech_ros.loading import load_scene
from hapticmech_ros.wire.topics import DEVICE

SCENE, RATE_HZ = "five_bar", 1000.0
# Figures of a run that are shown, and with how many digits.
SHOWN = {
    **{latency(ROUND_TRIP, one): ".0f" for one in ("p50", "p99", "max")},
    f"{DEVICE}: {MISSED}": ".2f",
}
# How often somebody starts a program meanwhile.
COMMAND_PERIOD_S = 0.5


# What is compared: parameters of the nodes, by name; None for the bare graph.
WAYS: dict[str, dict[str, object] | None] = {
    "off": {"realtime": "off"},
    "auto": {"realtime": "auto"},
    "auto, any CPU": {"realtime": "auto", "cpu_affinity": "any"},
    "on": {"realtime": "on"},
    "on, any CPU": {"realtime": "on", "cpu_affinity": "any"},
    "bare graph": None,
}


@dataclass(frozen=True, slots=True)
class Watched:
    """What was seen of one run.

    Attributes:
        way: by name; ``busy`` programs ran beside the graph.
        failure: why there are no figures, or which check did not hold.
        figures: of the run; none where there are none.
        command_s: median and longest time that starting a program took.
    """

    way: str
    busy: int
    failure: str
    figures: Figures
    command_s: tuple[float, float]


@dataclass(frozen=True)
class RealtimeResults(MachineResults):
    """All runs.

    Attributes:
        seconds: that each run was watched.
        recorded: whether a recorder ran beside the graph.
        runs: in the order in which they were made.
    """

    NAME: ClassVar[str] = "bench_realtime"

    seconds: float
    recorded: bool
    runs: tuple[Watched, ...]

    def sheets(self) -> Iterator[Sheet]:
        """Yield medians of each way, on an idle and on a busy machine."""
        groups: dict[tuple[int, str], list[Watched]] = defaultdict(list)
        for run in self.runs:
            groups[run.busy, run.way].append(run)
        rows = []
        for (busy, way), runs in sorted(groups.items(), key=lambda item: item[0][0]):
            seen = [
                ([run.figures[name] for run in runs if name in run.figures], style)
                for name, style in SHOWN.items()
            ]
            usual = median(run.command_s[0] for run in runs)
            longest = max(run.command_s[1] for run in runs)
            rows.append(
                (
                    str(busy),
                    way,
                    f"{sum(not run.failure for run in runs)} of {len(runs)}",
                    *(number(median(of) if of else None, style) for of, style in seen),
                    *(f"{1e3 * one:.0f}" for one in (usual, longest)),
                )
            )
        headings = (
            *("busy programs", "realtime", "sound", "p50", "p99", "max", "missed, %"),
            *("command", "longest"),
        )
        caption = (
            f"medians of runs of {self.seconds:g} s; sample to answer, µs; deadlines missed by the "
            "device; ms that starting a program takes, median and longest"
        )
        beside = ", and a recorder" if self.recorded else ""
        yield Sheet(
            f"{SCENE} at {RATE_HZ:g} Hz in four processes{beside}",
            headings,
            tuple(rows),
            caption=caption,
        )


def run_benchmark(
    out: Path,
    seconds: float,
    repeats: int,
    load: Sequence[int],
    recorded: bool = False,
    show: Show = silent,
) -> RealtimeResults:
    """Run every way in turn, so that a drifting machine meets all of them.

    Args:
        out: folder for the nodes' output.
        seconds: that each run is watched.
        repeats: runs of each way.
        load: numbers of busy programs beside the graph.
        recorded: whether a recorder writes all topics into a bag meanwhile.
        show: called with what is being done.
    """
    scene = load_scene(SCENE)
    point = scene.operational_point().name
    place = scene_at_rate(SCENE, RATE_HZ, out / "scenes")
    show("simulating the same without ROS")
    session = expected(scene, seconds + SETTLES_S)
    runs = []
    for busy in load:
        for repeat in range(1, repeats + 1):
            for way, settings in WAYS.items():
                show(f"{busy} busy programs, realtime {way}: run {repeat} of {repeats}")
                configuration = Configuration(
                    RATE_HZ, "separate", recorded, settings=tuple((settings or {}).items())
                )
                with _beside(busy) as commands:
                    step = Step(configuration, repeat, "bare" if settings is None else "real")
                    run = measure(step, place, point, seconds, out, session)
                runs.append(
                    Watched(
                        way,
                        busy,
                        ", ".join(run.faults),
                        run.figures,
                        (median(commands), max(commands)),
                    )
                )
    return RealtimeResults(machine(), seconds, recorded, tuple(runs))


def realtime(
    seconds: Annotated[float, typer.Option(min=1.0, help="s that each run is watched")] = 20.0,
    repeats: Annotated[int, typer.Option(min=1, help="runs of each way")] = 3,
    load: Annotated[str, typer.Option(help="numbers of busy programs beside the graph")] = "0,2",
    record: Annotated[
        bool, typer.Option("--record/--no-record", help="with a recorder of all topics")
    ] = False,
    out: OutOption = Path("bench"),
    json_only: JsonOption = False,
) -> None:
    """Time the graph with real-time scheduling and pinned processors, and without."""
    loads = numbers("--load", load, int)
    carry_out(
        lambda show: run_benchmark(out, seconds, repeats, loads, record, show), out, json_only
    )


@contextmanager
def _beside(busy: int) -> Iterator[list[float]]:
    """Keep programs busy, start short ones, and yield how long these take, s."""
    taken: list[float] = []
    over = threading.Event()
    starting = threading.Thread(target=_start_programs, args=(taken, over))
    with busy_programs(busy):
        starting.start()
        try:
            yield taken
        finally:
            over.set()
            starting.join()


def _start_programs(taken: list[float], over: threading.Event) -> None:
    while not taken or not over.wait(COMMAND_PERIOD_S):
        begun = time.monotonic()
        subprocess.run([sys.executable, "-S", "-c", ""], env={}, check=True)
        taken.append(time.monotonic() - begun)
