# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs made up of round numbers: figures that a reader can work out by himself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from benchmarks.accuracy import Case, Output
from benchmarks.graph.plan import Configuration, Kind, Step
from benchmarks.graph.recorded import RECORDED_TRIP, Losses, Recorded
from benchmarks.graph.run import Run
from benchmarks.graph.statuses import ROUND_TRIP, Clocked, Percentiles
from benchmarks.machine import MachineLoad
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.wire.topics import ANALYSER, CONTROLLER, DEVICE, MECHANISM

SEPARATE = Configuration(1000.0, "separate", True)
COMPOSED = Configuration(2000.0, "composed", False)
MakeRun = Callable[..., Run]
G = 9.81


def falling(duration: float = 0.04) -> Case:
    """Return a stone thrown up along z: parabolas, which rk2 and rk4 follow to rounding."""
    scene = scene_from_document(
        {
            "format": "hapticmech-scene/1",
            "name": "stone",
            "gravity": [0.0, 0.0, -G],
            "links": [
                {
                    "name": "stone",
                    "joint": {"name": "up", "type": "prismatic"},
                    "inertial": {
                        "mass": 2.0,
                        "inertia": dict.fromkeys(("ixx", "iyy", "izz"), 0.01),
                    },
                }
            ],
            "operational_points": [{"name": "stone_point", "link": "stone"}],
            "initial_state": {"v": {"up": 3.0}},
            "hand": {"kind": "constant_wrench"},
        }
    )
    times = (0.5 * duration, duration)
    heights = tuple((3.0 * t - 0.5 * G * t**2,) for t in times)
    outputs = (
        Output("point", "stone_point", (2,), times, heights, 1e-12),
        Output("joint", "up", (0,), times, heights, 1e-12),
    )
    return Case("stone", "Z01", "Stone", scene, duration, outputs, 9.0, (), frozenset({"open"}))


@pytest.fixture
def make_run() -> MakeRun:
    """Return a maker of runs that meet every goal, at 40 µs, with bare ones at 100 µs."""

    def make(
        kind: Kind = "real",
        configuration: Configuration = SEPARATE,
        repeat: int = 1,
        latency_us: float | None = None,
        rate_hz: float | None = None,
        missed: int = 0,
        lost: int = 0,
        cpu: float = 0.5,
        **changes: object,
    ) -> Run:
        rate = configuration.rate_hz if rate_hz is None else rate_hz
        if latency_us is None:
            latency_us = 40.0 if kind == "real" else 100.0
        latency = Percentiles(latency_us, 2 * latency_us, 3 * latency_us, 4 * latency_us)
        found = Recorded(
            {RECORDED_TRIP: latency},
            {"device/state → servo_cf": Losses(20000, 20000 - lost, 0)},
            {"/device/state": 20000},
            {"/device/state": 308},
        )
        process = "composed" if configuration.layout == "composed" else DEVICE
        clocked = Clocked(rate, round(20 * configuration.rate_hz), missed, 0)
        run = Run(
            Step(configuration, repeat, kind),
            window_s=20.0,
            clocked={DEVICE: clocked, MECHANISM: clocked},
            answers_hz={CONTROLLER: rate, ANALYSER: rate},
            said={ROUND_TRIP: latency},
            recorded=found if configuration.recorded else None,
            load=MachineLoad({process: cpu}, 0.5, 0.0, 1.0),
        )
        return replace(run, **changes)  # type: ignore[arg-type]

    return make
