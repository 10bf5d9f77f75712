# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is raced: scenes, how long they run, what is compared, and the steps worth a run."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Literal

from benchmarks.accuracy.cases import Output
from benchmarks.accuracy.cases import cases as accuracy_cases
from benchmarks.accuracy.n_four_bar import n_four_bar
from benchmarks.speed.platform import stewart_platform
from benchmarks.words import refuse_unknown
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.scene import Scene

# Written by reference.py.
PATH = Path(__file__).parent / "reference.json"
FOLDER = Path(__file__).with_name("scenes")
SECONDS = (1.0, 2.0, 5.0, 10.0)


@dataclass(frozen=True)
class Problem:
    """A scene, and what is compared of it.

    Attributes:
        name: short, for options and tables.
        title: for people.
        build: makes the scene.
        times: s, of comparison; the last is the duration.
        kind, compared, components: as ``kind``, ``name`` and ``components`` of ``Output``.
        unit: s; steps are multiples of it.
        large: whether a step costs as much as many of another scene.
        windows: N of A02, whose motion is one equation; 0 elsewhere.
        values: of the reference: (outputs, times, components); empty where there is none yet.
    """

    name: str
    title: str
    build: Callable[[], Scene]
    times: tuple[float, ...]
    kind: Literal["point", "joint"]
    compared: tuple[str, ...]
    components: tuple[int, ...]
    unit: float = 1e-3
    large: bool = False
    windows: int = 0
    values: tuple[tuple[tuple[float, ...], ...], ...] = ()

    @cached_property
    def scene(self) -> Scene:
        """What moves."""
        return self.build()

    @property
    def outputs(self) -> tuple[Output, ...]:
        """What is compared, with the reference's values."""
        values = self.values or ((),) * len(self.compared)
        return tuple(
            Output(self.kind, name, self.components, self.times, own, 0.0)
            for name, own in zip(self.compared, values, strict=True)
        )

    def shortened(self) -> Problem:
        """Return the problem up to the first time of comparison."""
        return replace(self, times=self.times[:1], values=tuple(one[:1] for one in self.values))

    def error(self, readings: Sequence[Sequence[Sequence[float]]]) -> float:
        """Return the largest difference from the reference, m or rad; (times, outputs, parts)."""
        return max(
            output.error([reading[index] for reading in readings])
            for index, output in enumerate(self.outputs)
        )


# The shipped five-bar under gravity along -x, without damping: it never settles. Along -y it would,
# and so wildly that after 10 s no digit is left of any start.
SWINGING = ("gravity=[-9.81, 0, 0]", *(f"links.link{k}.joint.damping=0" for k in (1, 2, 3, 4)))


def _accuracy_scene(name: str) -> Scene:
    return next(case.scene for case in accuracy_cases() if case.name == name)


def _windows(windows: int, times: tuple[float, ...], large: bool) -> Problem:
    return Problem(
        f"n_four_bar_{windows}",
        f"A02, N = {windows}",
        partial(n_four_bar, windows),
        times,
        "point",
        ("b0",),
        (0, 1),
        large=large,
        windows=windows,
    )


ANGLES = ("beta", "theta", "gamma", "phi", "delta", "omega", "epsilon")
ASKED = (
    Problem(
        "pendulum",
        "A01 pendulum",
        partial(_accuracy_scene, "pendulum"),
        SECONDS,
        "point",
        ("p1",),
        (0, 1),
    ),
    Problem(
        "five_bar",
        "five-bar, swinging",
        partial(load_scene, "five_bar", changes=SWINGING),
        SECONDS,
        "point",
        ("handle",),
        (0, 1),
    ),
    _windows(2, SECONDS, large=False),
    Problem(
        "bricard",
        "A04 Bricard",
        partial(_accuracy_scene, "bricard"),
        SECONDS,
        "point",
        ("p3",),
        (0, 1, 2),
    ),
    Problem(
        "spatial_arm",
        "arm, falling",
        partial(load_scene, "spatial_arm", changes=["gravity=[0, 0, -9.81]"]),
        (0.5, 1.0, 2.0),
        "point",
        ("handle",),
        (0, 1, 2),
        unit=2e-4,
    ),
    Problem(
        "stewart_platform",
        "platform on six legs",
        stewart_platform,
        (0.5, 1.0, 2.0),
        "point",
        ("rim",),
        (0, 1, 2),
        unit=5e-4,
    ),
    Problem(
        "jansen_leg",
        "walking machine's leg, eight bars",
        partial(load_scene, FOLDER / "jansen_leg.yaml"),
        (0.5, 1.0, 2.0),
        "point",
        ("foot",),
        (0, 1),
        unit=5e-4,
    ),
    Problem(
        "spatial_four_bar",
        "spatial four-bar, two balls",
        partial(load_scene, FOLDER / "spatial_four_bar.yaml"),
        (0.5, 1.0, 2.0),
        "point",
        ("foot",),
        (0, 1, 2),
        unit=5e-4,
    ),
    Problem(
        "andrews",
        "A03 Andrews' squeezer",
        partial(_accuracy_scene, "andrews"),
        (0.01, 0.02, 0.03),
        "joint",
        ANGLES,
        (0,),
        unit=1e-5,
    ),
    _windows(10, SECONDS, large=False),
    _windows(40, SECONDS, large=True),
    _windows(80, (1.0, 2.0), large=True),
)


def problems(names: Sequence[str] = ()) -> tuple[Problem, ...]:
    """Return problems by name, all if no name is given.

    Raises:
        InvalidInputError: unknown name, or no stored reference of that name and those times.
    """
    refuse_unknown("scene", names, [asked.name for asked in ASKED])
    stored = {
        entry["name"]: entry for entry in json.loads(PATH.read_text(encoding="utf-8"))["cases"]
    }
    found = []
    for asked in (one for one in ASKED if not names or one.name in names):
        entry = stored.get(asked.name)
        if entry is None or tuple(entry["times"]) != asked.times:
            raise InvalidInputError("reference.json", asked.name, "must hold it: compute it anew")
        values = tuple(tuple(tuple(row) for row in output) for output in entry["values"])
        found.append(replace(asked, values=values))
    return tuple(found)
