# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the machine is, and how fast."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hapticmech_ros.analysis.study import Results
from hapticmech_ros.numerics import Array

PROC = Path("/proc")
# Fixed work by which figures of different days are compared: about 50 ms in all.
SCENE, SUMMED = "five_bar", 10_000
ANALYSES, REPEATS = 50, 51


def machine() -> dict[str, object]:
    """Return what a reader has to know of the machine: what it is, and how fast at the moment."""
    return {
        "cores": len(os.sched_getaffinity(0)),
        "processor": _processor(),
        "kernel": platform.release(),
        "python": platform.python_version(),
        **speed(),
    }


def speed() -> dict[str, float]:
    """Return how long fixed work takes, medians of CPU time, µs.

    ``analysis_us`` is a call of the kernel that analyses the shipped five-bar, ``python_loop_us``
    the sum of a range in Python.
    """
    # Not before: what these import would count in the memory of a benchmark that does not use it.
    from hapticmech_ros.loading import load_scene
    from hapticmech_ros.operational import Analyser
    from hapticmech_ros.simulation import Simulator

    simulator = Simulator(load_scene(SCENE))
    analyser, state = Analyser(simulator.mechanism), simulator.initial_state()

    def analyse() -> None:
        for _ in range(ANALYSES):
            analyser.observe(state.q, state.v, state.active)

    taken = cpu_times({"analyse": analyse, "add": lambda: sum(range(SUMMED))}, REPEATS)
    analysis_us, python_loop_us = (1e6 * float(np.median(times)) for times in taken.values())
    return {"analysis_us": analysis_us / ANALYSES, "python_loop_us": python_loop_us}


def cpu_times(callers: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, Array]:
    """Return the CPU times of calls (rounds,), s, taken in turn; a first one of each is not timed.

    Round by round, so that what else the machine does is met by all of them alike.
    """
    times: dict[str, list[float]] = {name: [] for name in callers}
    for number in range(-1, rounds):
        for name, call in callers.items():
            begun = time.process_time()
            call()
            if number >= 0:
                times[name].append(time.process_time() - begun)
    return {name: np.array(taken) for name, taken in times.items()}


def speed_line(facts: Mapping[str, object]) -> str:
    """Return what :func:`machine` tells of the speed, in a line."""
    return (
        f"speed of this machine: {facts['analysis_us']:.2f} µs for one analysis of {SCENE}, "
        f"{facts['python_loop_us']:.0f} µs for sum(range({SUMMED:_}))"
    )


def _processor() -> str:
    lines = (PROC / "cpuinfo").read_text(encoding="utf-8").splitlines()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())


@dataclass(frozen=True)
class MachineResults(Results):
    """Results that depend on the machine.

    Attributes:
        machine: cores, kernel, versions, speed.
    """

    machine: Mapping[str, object]

    def notes(self) -> list[str]:
        """Return what the machine is, in a line, and how fast, in another."""
        known = {name: value for name, value in self.machine.items() if not name.endswith("_us")}
        return [
            ", ".join(f"{name} {value}" for name, value in known.items()),
            speed_line(self.machine),
        ]

    def markdown(self) -> str:
        """Return the tables for a document, and below them how fast the machine was."""
        return f"{super().markdown()}\n{speed_line(self.machine)}\n"
