# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the graph's benchmark runs, and in which order."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product, starmap
from pathlib import Path
from typing import Literal

from benchmarks.words import refuse_unknown
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.loading.loader import copy_scene
from hapticmech_ros.system.discovery import Transport

Layout = Literal["separate", "composed"]
Kind = Literal["real", "bare"]
LAYOUTS: tuple[Layout, ...] = ("separate", "composed")
KINDS: tuple[Kind, ...] = ("real", "bare")
TRANSPORTS: tuple[Transport, ...] = ("auto", "middleware")
RATE_LIMITS_HZ = (10.0, 10_000.0)
# The nodes' own view_rate, and what it may be.
VIEW_HZ = 100.0
VIEW_LIMITS_HZ = (1.0, 1000.0)


@dataclass(frozen=True, slots=True)
class Configuration:
    """One way to run a graph.

    Attributes:
        rate_hz: control rate of device and mechanism.
        layout: ``separate``, a process for each node, or ``composed``, one for all.
        recorded: whether a recorder writes every topic into a bag.
        transport: of the real graph's nodes; the bare graph has the middleware alone.
        settings: further parameters of the real graph's nodes, by ``node.parameter``, or
            ``parameter`` for all of them.
        view_hz: rate of the topics for people, CRTK's among them, of both graphs.
    """

    rate_hz: float
    layout: Layout
    recorded: bool
    transport: Transport = "auto"
    settings: tuple[tuple[str, object], ...] = ()
    view_hz: float = VIEW_HZ

    def __str__(self) -> str:
        recording = "recording" if self.recorded else "no recording"
        way = "" if self.transport == "auto" else f", {self.transport}"
        views = "" if self.view_hz == VIEW_HZ else f", views at {self.view_hz:g} Hz"
        return f"{self.rate_hz:g} Hz, {self.layout}, {recording}{way}{views}"


@dataclass(frozen=True, slots=True)
class Step:
    """One run: the real graph or the bare one, in a configuration, for the nth time (from 1)."""

    configuration: Configuration
    repeat: int
    kind: Kind


@dataclass(frozen=True, slots=True)
class Plan:
    """All runs of a benchmark.

    Attributes:
        scene: shipped scene, or path of a file.
        rates_hz: control rates.
        layouts: layouts of processes.
        recorded: with a recorder, without, or both.
        seconds: length of a run's window.
        repeats: how often each graph is run in each configuration.
        transports: of the real graph.
        views_hz: rates of the topics for people.

    Raises:
        InvalidInputError: nothing to run, or a number out of its range.
    """

    scene: str
    rates_hz: tuple[float, ...]
    layouts: tuple[Layout, ...] = LAYOUTS
    recorded: tuple[bool, ...] = (False, True)
    seconds: float = 20.0
    repeats: int = 2
    transports: tuple[Transport, ...] = ("auto",)
    views_hz: tuple[float, ...] = (VIEW_HZ,)

    def __post_init__(self) -> None:
        if not all((self.rates_hz, self.layouts, self.recorded, self.transports, self.views_hz)):
            rule = "must have a rate, a layout, a transport, a view rate, and record or not"
            raise InvalidInputError("plan", self, rule)
        refuse_unknown("layout", self.layouts, LAYOUTS)
        refuse_unknown("transport", self.transports, TRANSPORTS)
        limits = (
            ("rate, Hz", self.rates_hz, RATE_LIMITS_HZ),
            ("view rate, Hz", self.views_hz, VIEW_LIMITS_HZ),
            ("seconds", (self.seconds,), (1.0, sys.float_info.max)),
            ("repeats", (self.repeats,), (1, sys.maxsize)),
        )
        for what, values, (low, high) in limits:
            for value in values:
                if not low <= value <= high:
                    raise InvalidInputError(what, value, f"must be {low:g} or more, to {high:g}")

    def configurations(self) -> tuple[Configuration, ...]:
        """Return every configuration once."""
        return tuple(
            Configuration(rate, layout, recorded, transport, view_hz=view)
            for layout in self.layouts
            for recorded in self.recorded
            for rate in self.rates_hz
            for transport in self.transports
            for view in self.views_hz
        )

    def steps(self) -> Iterator[Step]:
        """Return the runs: real and bare in turn, so that a drifting machine meets both."""
        ways = product(self.configurations(), range(1, self.repeats + 1), KINDS)
        return starmap(Step, ways)


def scene_at_rate(scene: str, rate_hz: float, folder: Path) -> Path:
    """Write a copy of a scene with another control rate into ``folder``, and return its path.

    Raises:
        SceneError: no such scene, a bad one, or one that refuses the rate.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{Path(scene).stem}_{rate_hz:g}_hz.yaml"
    path.unlink(missing_ok=True)
    copy_scene(scene, path, [f"simulation.period={1.0 / rate_hz!r}"])
    return path
