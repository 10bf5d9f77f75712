# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs made up of round numbers: figures that a reader can work out by himself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from benchmarks.accuracy import Case, Output
from benchmarks.graph.plan import Configuration, Kind, Step
from benchmarks.graph.recorded import ASKED, LOST, RECORDED_TRIP, UNSEEN
from benchmarks.graph.run import STOLEN, Run, processor_share
from benchmarks.graph.statuses import MISSED, PERCENTILES, RATE, ROUND_TRIP, latency
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.wire.topics import DEVICE

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
        cpu: float = 50.0,
        **changes: object,
    ) -> Run:
        rate = configuration.rate_hz if rate_hz is None else rate_hz
        if latency_us is None:
            latency_us = 40.0 if kind == "real" else 100.0
        process = "composed" if configuration.layout == "composed" else DEVICE
        periods, answered = 20 * configuration.rate_hz, "device/state → servo_cf"
        hops = [ROUND_TRIP, *([RECORDED_TRIP] if configuration.recorded else [])]
        figures = {
            f"{DEVICE}: {RATE}": rate,
            f"{DEVICE}: {MISSED}": 100.0 * missed / periods,
            **{
                latency(hop, one): factor * latency_us
                for hop in hops
                for factor, one in enumerate(PERCENTILES, start=1)
            },
            processor_share(process): cpu,
            STOLEN: 0.0,
        }
        if configuration.recorded:
            counts = {ASKED: 20000.0, LOST: float(lost), UNSEEN: 0.0}
            figures |= {f"{answered}: {what}": count for what, count in counts.items()}
        sizes = {"/device/state": 308} if configuration.recorded else {}
        run = Run(Step(configuration, repeat, kind), figures=figures, sizes=sizes)
        return replace(run, **changes)  # type: ignore[arg-type]

    return make
