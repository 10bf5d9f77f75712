# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A study's task for a worker, and the worker's measures of a scene: numbers by name.

Workers import this and the measures, and nothing that draws or writes.

A measure is a function of a scene and the name of an operational point, empty for the first one,
that returns numbers by name, the same names for every scene of a study. One of a user's own is
named ``module:function``, of a module that the workers can import.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from math import inf, nan
from pathlib import Path

import numpy as np

from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.loop_stability import loop_margins
from hapticmech_ros.control.measurements import operational_model_of
from hapticmech_ros.errors import HapticMechError, InvalidInputError, nearest
from hapticmech_ros.loading.loader import scene_as_written
from hapticmech_ros.operational import Analyser, OperationalAnalysis
from hapticmech_ros.operational.observation import rigid_count
from hapticmech_ros.operational.results import RIGID, felt_masses
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.validation import with_changes
from hapticmech_ros.simulation import Simulator
from hapticmech_ros.study.design import Design

#: From a scene and an operational point, the scene's first one if empty, to numbers by name. It
#: raises a :class:`~hapticmech_ros.errors.HapticMechError` if the scene cannot be measured; the
#: study continues.
Measure = Callable[[Scene, str], Mapping[str, float]]


def _at_the_start(scene: Scene, point: str) -> tuple[OperationalAnalysis, float]:
    """Return the analysis of a point at the scene's start, and the mechanism's length, m."""
    simulator = Simulator(scene)
    terms = simulator.evaluate(simulator.initial_state())
    return Analyser(simulator.mechanism, point).analyse(terms), simulator.mechanism.length


def felt(scene: Scene, point: str) -> dict[str, float]:
    """Return the felt dynamics at the start, at rest.

    ``count`` of joint constraints; least and largest mass (kg) felt in any direction; ``mass_x``
    and so on, 1 / X_ii (kg), and ``inertia_z`` and so on (kg m²); all of these infinite where it is
    rigid. The spectrum s = √μ, ``s1`` the largest.

    Raises:
        HapticMechError: loops that do not close, or a joint that moves no mass.
    """
    analysis, length = _at_the_start(scene, point)
    masses = felt_masses(analysis)[0].tolist()
    found = {
        "count": float(rigid_count(analysis.spectrum.s, scene.perception)),
        "mass_least": masses[0],
        "mass_largest": masses[-1],
    }
    names = [*(f"mass_{axis}" for axis in "xyz"), *(f"inertia_{axis}" for axis in "xyz")]
    response = analysis.inverse_inertia.diagonal()
    # 1/kg: of a turn, at the mechanism's length from its axis.
    comparable = response * np.repeat((1.0, length**2), 3)
    felt_there = comparable > RIGID * comparable[analysis.rows].max()
    for row in analysis.rows.tolist():
        found[names[row]] = float(1.0 / response[row]) if felt_there[row] else inf
    spectrum = analysis.spectrum.s.tolist()
    return found | {f"s{number}": s for number, s in enumerate(spectrum, 1)}


def limits(scene: Scene, point: str) -> dict[str, float]:
    """Return the margins of the rendering at the start, by the loop's eigenvalues.

    ``delay_margin``: periods of delay up to which it is stable, -1 if it is unstable without;
    ``gain_margin``: factor on stiffness and damping at which it becomes unstable.

    Raises:
        HapticMechError: as :func:`felt`.
    """
    analysis, _ = _at_the_start(scene, point)
    model = operational_model_of(analysis)
    control = ControlArchitecture(scene.held_at(scene.operational_point(point).name))
    margins = loop_margins(control, model, analysis.rows, scene.simulation.period)
    return {"delay_margin": float(margins.periods), "gain_margin": margins.gain}


def experiment(scene: Scene, point: str) -> dict[str, float]:
    """Return the figures of the scene's own experiment: of ``analysis.experience``.

    Drift and penetration (m), least energies (J), contact error (1; NaN without contact), and
    ``kept``, 1 if device and point stayed together.

    Raises:
        HapticMechError: a scene that cannot run.
    """
    # Sessions, which the other measures need not load.
    from hapticmech_ros.analysis.experience import experience
    from hapticmech_ros.analysis.touch import Setup

    own = scene.held_at(scene.operational_point(point).name)
    found = asdict(experience(Setup(own, point)))
    return {name: nan if value is None else float(value) for name, value in found.items()}


# Of measured numbers, by the beginning of their names; of others users know.
UNITS = {
    "mass_": "kg",
    "inertia_": "kg m²",
    "delay_margin": "periods",
    "drift_": "m",
    "penetration_": "m",
    "hand_energy": "J",
    "left_energy": "J",
}
MEASURES: dict[str, Measure] = {"felt": felt, "limits": limits, "experiment": experiment}


def with_unit(name: str) -> str:
    """Return a number's name with its unit, if it has one."""
    unit = next((unit for begin, unit in UNITS.items() if name.startswith(begin)), "")
    return f"{name} ({unit})" if unit else name


def measure_named(name: str) -> Measure:
    """Return a measure: of :data:`MEASURES`, or ``module:function``.

    Raises:
        InvalidInputError: there is none.
    """
    if name in MEASURES:
        return MEASURES[name]
    module, sign, function = name.partition(":")
    if not sign:
        known = ", ".join(MEASURES)
        rule = f"must be one of {known}, or module:function{nearest(name, MEASURES)}"
        raise InvalidInputError("measure", name, rule)
    try:
        found: Measure = getattr(import_module(module), function)
    except (ImportError, AttributeError, ValueError) as error:
        raise InvalidInputError("measure", name, f"cannot be imported: {error}") from None
    if not callable(found):
        raise InvalidInputError("measure", name, "must be a function")
    return found


# Numbers of each scene by its index, or why it has none.
Numbers = list[tuple[int, dict[str, float] | str]]


@dataclass(frozen=True, slots=True)
class Task:
    """Scenes to measure, and all that another process needs to know for that.

    Attributes:
        document: as written, to change.
        path: of its file.
        measures: their names.
        point: operational point; the scene's first one if empty.
        changes: index of each scene, and its changes, ``key=value`` each.
    """

    document: object
    path: Path
    measures: tuple[str, ...]
    point: str
    changes: tuple[tuple[int, tuple[str, ...]], ...] = ()

    def __str__(self) -> str:
        return f"scenes {', '.join(str(index) for index, _ in self.changes)}"

    def of(self, indices: Sequence[int], design: Design) -> Task:
        """Return the task of measuring other scenes of a design."""
        changes = tuple((index, design.changes(index)) for index in indices)
        return replace(self, changes=changes)

    def scene(self, changes: Sequence[str]) -> Scene:
        """Return the scene with some keys set, ``key=value`` each.

        Raises:
            SceneError: keys that are none, or rules that are broken.
        """
        document = with_changes(self.document, changes, str(self.path))
        return scene_as_written(document, self.path)

    def measured(self, scene: Scene) -> dict[str, float]:
        """Return a scene's numbers.

        Raises:
            InvalidInputError: an unknown measure or point, two with a number of one name, or none.
            HapticMechError: it cannot be measured.
        """
        found: dict[str, float] = {}
        for name in self.measures:
            numbers = measure_named(name)(scene, self.point)
            twice = sorted(found.keys() & numbers.keys())
            if twice:
                raise InvalidInputError("measures", self.measures, f"two of them have {twice}")
            found |= {str(key): float(value) for key, value in numbers.items()}
        if not found:
            raise InvalidInputError("measures", self.measures, "have no numbers")
        return found


def carry_out(task: Task) -> Numbers:
    """Return the numbers of each scene of a task, or why it has none."""
    found = Numbers()
    for index, changes in task.changes:
        try:
            found.append((index, task.measured(task.scene(changes))))
        except HapticMechError as error:
            found.append((index, str(error)))
    return found
