# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cases: a scene, how long it runs, and what has to come out of it. Nothing is simulated here."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from benchmarks.accuracy.n_four_bar import n_four_bar
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene

_FOLDER = Path(__file__).parent
# Of a step: times are written in decimals, samples are multiples of the step.
_ON_TIME = 1e-6


@dataclass(frozen=True, slots=True)
class Output:
    """What is compared, and the values it has to have.

    Attributes:
        kind: ``point`` is the position of an operational point, world axes; ``joint`` is the
            coordinate of a revolute or prismatic joint, turns counted.
        name: of the operational point or joint.
        components: which axes of the position; (0,) of a coordinate.
        times: s, since the start.
        values: for each time one number per component, m or rad.
        tolerance: m or rad; the scene with its own step comes closer than this.
    """

    kind: Literal["point", "joint"]
    name: str
    components: tuple[int, ...]
    times: tuple[float, ...]
    values: tuple[tuple[float, ...], ...]
    tolerance: float

    def parts(self, place: Array) -> tuple[float, ...]:
        """Return its components of a position (3,) or coordinate (1,), m or rad."""
        return tuple(float(place[k]) for k in self.components)

    def numbers(self, step: float) -> list[int]:
        """Return the numbers of the steps (s) after which its times are reached.

        Raises:
            InvalidInputError: the step does not divide a time.
        """
        for time in self.times:
            if not divides(step, time):
                rule = f"must divide {time:g} s, where it is compared"
                raise InvalidInputError("step", step, rule)
        return [round(time / step) for time in self.times]

    def error(self, found: npt.ArrayLike) -> float:
        """Return the largest |found - values|, m or rad.

        Args:
            found: (times, components).

        Raises:
            InvalidInputError: another shape.
        """
        values, given = np.array(self.values), np.asarray(found, dtype=float)
        if given.shape != values.shape:
            raise InvalidInputError("found", given.shape, f"must have shape {values.shape}")
        return float(np.abs(given - values).max())


@dataclass(frozen=True, slots=True)
class Case:
    """A mechanism whose motion is known.

    Attributes:
        name: the scene's name.
        problem: number in the library of benchmarks, such as ``A02``.
        title: what it is, for people.
        scene: starts and steps as the problem says.
        duration: s.
        outputs: what is compared.
        energy: kinetic and potential, J, the same at all times; None where it is not kept.
        singular_times: s, when closures lose rank.
        tags: ``planar`` or ``spatial``; ``open`` or ``closed`` loops; ``stiff``, ``singular``,
            ``redundant``, ``fast`` and ``large`` where it is.
    """

    name: str
    problem: str
    title: str
    scene: Scene
    duration: float
    outputs: tuple[Output, ...]
    energy: float | None
    singular_times: tuple[float, ...]
    tags: frozenset[str]


def divides(step: float, time: float) -> bool:
    """Return whether a time is reached by whole steps, both in s."""
    number = round(time / step)
    return abs(number - time / step) <= _ON_TIME * max(number, 1)


def cases() -> tuple[Case, ...]:
    """Return all cases, in the order of the library.

    Raises:
        SceneError: a scene is damaged.
    """
    document = json.loads((_FOLDER / "reference.json").read_text(encoding="utf-8"))
    return tuple(_case(entry) for entry in document["cases"])


def _case(entry: Mapping[str, Any]) -> Case:
    own = "windows" not in entry
    path = _FOLDER / "scenes" / f"{entry['name']}.yaml"
    return Case(
        name=entry["name"],
        problem=entry["problem"],
        title=entry["title"],
        scene=load_scene(path) if own else n_four_bar(entry["windows"]),
        duration=entry["duration"],
        outputs=tuple(_output(output) for output in entry["outputs"]),
        energy=entry.get("energy"),
        singular_times=tuple(entry.get("singular_times", ())),
        tags=frozenset(entry["tags"]),
    )


def _output(entry: Mapping[str, Any]) -> Output:
    kind: Literal["point", "joint"] = "point" if "point" in entry else "joint"
    return Output(
        kind=kind,
        name=entry[kind],
        components=tuple(entry.get("components", (0,))),
        times=tuple(entry["times"]),
        values=tuple(tuple(row) for row in entry["values"]),
        tolerance=entry["tolerance"],
    )
