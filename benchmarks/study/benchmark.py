# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A study of thousands of scenes by one process, by several, and by a Dask cluster of as many."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import typer

from benchmarks.machine import MachineResults, machine
from hapticmech_ros.analysis.study import Sheet, Show, silent
from hapticmech_ros.cli.console import OutOption
from hapticmech_ros.cli.study import JsonOption, ProcessesOption, carry_out
from hapticmech_ros.numerics import Array
from hapticmech_ros.study import Design, Variation, run_study
from hapticmech_ros.system.installation import refuse_unmet
from hapticmech_ros.system.workers import DASK, Workers, cluster

SCENE, MEASURES = "five_bar", ("felt", "limits")
VARIED = ("links.link1.inertial.mass=0.05:0.5:log", "device.mass=0.1:0.4")
# Least gain of two workers over one, and least share of that through a cluster.
GAIN, SHARE = 1.9, 0.9


@dataclass(frozen=True)
class StudyResults(MachineResults):
    """Times of the same study, in the order of the rounds.

    Attributes:
        scenes: of the study.
        processes: that share it.
        alone: s, by this process.
        shared: s, by several, their start included.
        cluster: s, by a Dask cluster of as many, its start not included.
        same: whether all rows were the same to the bit.
    """

    NAME: ClassVar[str] = "bench_study"
    FAULT: ClassVar[str] = "rows differ"

    scenes: int
    processes: int
    alone: Sequence[float]
    shared: Sequence[float]
    cluster: Sequence[float]
    same: bool

    @property
    def sound(self) -> bool:
        """Whether all rows were the same."""
        return self.same

    @property
    def gain(self) -> float:
        """Median time alone over that of several processes."""
        return float(np.median(self.alone) / np.median(self.shared))

    @property
    def through_cluster(self) -> float:
        """Gain of the cluster over that of the processes."""
        return float(np.median(self.shared) / np.median(self.cluster))

    def sheets(self) -> Iterator[Sheet]:
        """Yield times and ratios."""
        ways = (
            ("this process", self.alone, ""),
            (f"{self.processes} processes", self.shared, f"{self.gain:.2f} x"),
            (
                f"Dask cluster of {self.processes}",
                self.cluster,
                f"{self.gain * self.through_cluster:.2f} x",
            ),
        )
        rows = tuple(
            (name, f"{np.median(taken):.1f}", f"{self.scenes / np.median(taken):.0f}", gain)
            for name, taken, gain in ways
        )
        yield Sheet(
            f"{self.scenes} scenes of {SCENE}, {' and '.join(MEASURES)}",
            ("shared by", "median, s", "scenes/s", "gain"),
            rows,
            caption=f"goals for two: {GAIN} x, through a cluster {SHARE} of what processes gain",
        )


def run_benchmark(scenes: int, rounds: int, processes: int, show: Show = silent) -> StudyResults:
    """Carry out a study in each way, in turn.

    Args:
        scenes: of the study.
        rounds: how often.
        processes: that share it.
        show: called with what was done.

    Raises:
        InstallationError: Dask is not installed.
    """
    refuse_unmet([DASK])
    # What is shared is not what NumPy does with several threads.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    design = Design(tuple(map(Variation.read, VARIED)), scenes, seed=1)
    taken: dict[str, list[float]] = {"alone": [], "shared": [], "cluster": []}
    rows: list[Array] = []

    ways: dict[str, Callable[[], AbstractContextManager[Workers]]] = {
        "alone": lambda: nullcontext(1),
        "shared": lambda: nullcontext(processes),
        "cluster": lambda: _own_cluster(processes),
    }
    for _ in range(rounds):
        for way, given in ways.items():
            with given() as workers, tempfile.TemporaryDirectory() as folder:
                begun = time.perf_counter()
                found = run_study(SCENE, design, MEASURES, folder=Path(folder), workers=workers)
                taken[way].append(time.perf_counter() - begun)
            rows.append(found.numbers)
            show(f"{way}: {taken[way][-1]:.1f} s")
    return StudyResults(
        machine(),
        scenes,
        processes,
        **taken,
        same=all(one.tobytes() == rows[0].tobytes() for one in rows),
    )


@contextmanager
def _own_cluster(processes: int) -> Iterator[Workers]:
    """Yield the executor of a cluster on this machine, all of whose processes have begun.

    Its workers do not profile themselves, as docs/study.md says.
    """
    import dask
    from distributed import LocalCluster

    with (
        dask.config.set({"distributed.worker.profile.enabled": False}),
        LocalCluster(
            n_workers=processes, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
        ) as own,
        cluster(own.scheduler_address) as executor,
    ):
        yield executor


def study(
    scenes: Annotated[int, typer.Option(min=1, help="of the study")] = 10_000,
    rounds: Annotated[int, typer.Option(min=1, help="of all ways in turn")] = 3,
    processes: ProcessesOption = 2,
    quick: Annotated[bool, typer.Option(help="200 scenes, once")] = False,
    out: OutOption = Path("bench"),
    json_only: JsonOption = False,
) -> None:
    """Time a parameter study by one process, by several, and by a Dask cluster of as many."""
    if quick:
        scenes, rounds = 200, 1
    carry_out(lambda show: run_benchmark(scenes, rounds, processes, show), out, json_only)
