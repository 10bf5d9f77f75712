# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""This package as a contender: ``Simulator.run``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.accuracy.cases import Output
from benchmarks.accuracy.run import read_output
from benchmarks.speed.contender import Method, Peer, Reading, Setting, State
from benchmarks.words import refuse_unknown
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Accuracy
from hapticmech_ros.simulation import Simulator

NAME = "hapticmech"
# Order of each integrator, which says what steps are worth a run.
ORDERS: Mapping[str, int] = {
    "rk4": 4,
    "tsit5": 5,
    "rk2": 2,
    "semi_implicit_euler": 1,
    "linearly_implicit": 3,
}
DEFAULT: Mapping[str, tuple[float, ...]] = {"rk4": (), "tsit5": ()}
# Behind an integrator's name: without the check of each step's energy, which no other simulator
# has, and which repeats coarse steps in smaller ones whatever error is wanted.
UNCHECKED = " unchecked"


class _Own:
    """``Simulator.run``, many steps in a call."""

    def __init__(
        self, scene: Scene, start: State, method: Method, step: float, setting: Setting
    ) -> None:
        unchecked = method.name.endswith(UNCHECKED)
        accuracy = Accuracy(tolerance=0.0) if unchecked else scene.simulation.accuracy
        integrator = method.name.removesuffix(UNCHECKED)
        self._simulator = Simulator(
            scene.stepped(integrator=integrator, period=step, substeps=1, accuracy=accuracy)
        )
        first = self._simulator.initial_state()
        self._first = replace(first, q=start.q.copy(), v=start.v.copy())
        self._state = self._first
        self._nothing = np.zeros((len(self._simulator.mechanism.point_names), 6))

    def restart(self) -> None:
        """Go back to the initial state."""
        self._state = self._first

    def advance(self, steps: int) -> None:
        """Take so many steps."""
        with np.errstate(over="ignore", invalid="ignore"):
            self._state = self._simulator.run(self._state, steps, self._nothing, steps).end

    def read(self, outputs: Sequence[Output]) -> Reading:
        """Return what outputs are now, m or rad."""
        mechanism = self._simulator.mechanism
        return [read_output(mechanism, output, self._state) for output in outputs]


def own_peer(multiples: Mapping[str, tuple[float, ...]] = DEFAULT) -> Peer:
    """Return our simulator.

    Args:
        multiples: integrators that take part, and their steps in units of a problem; by order if
            empty.

    Raises:
        InvalidInputError: an integrator that is not there.
    """
    refuse_unknown("integrator", multiples, ORDERS)
    methods = (
        Method(name + way, ORDERS[name], multiples=steps)
        for name, steps in multiples.items()
        for way in ("", UNCHECKED)
    )
    return Peer(NAME, tuple(methods), _Own)
