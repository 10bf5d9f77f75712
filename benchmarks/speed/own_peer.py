# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""This package as a contender: ``Simulator.run``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.accuracy.cases import Output
from benchmarks.speed.contender import (
    Contender,
    Method,
    Reading,
    Setting,
    State,
    joint_place,
)
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Accuracy
from hapticmech_ros.simulation import MechanismState, Simulator

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


class OwnPeer:
    """Our simulator.

    Args:
        multiples: integrators that take part, and their steps in units of a problem; by order if
            empty.

    Raises:
        InvalidInputError: an integrator that is not there.
    """

    name = NAME

    def __init__(self, multiples: Mapping[str, tuple[float, ...]] = DEFAULT) -> None:
        for name in multiples:
            if name not in ORDERS:
                raise InvalidInputError("integrator", name, f"must be one of {list(ORDERS)}")
        self.methods = tuple(
            Method(name + way, ORDERS[name], multiples=steps)
            for name, steps in multiples.items()
            for way in ("", UNCHECKED)
        )

    def missing(self) -> str:
        """Return why it cannot run here: always can."""
        return ""

    def contender(
        self, scene: Scene, start: State, method: Method, step: float, setting: Setting
    ) -> Contender:
        """Return the scene ready to run."""
        checked = not method.name.endswith(UNCHECKED)
        integrator = method.name.removesuffix(UNCHECKED)
        return _Own(stepped_by(scene, integrator, step, checked), start)


def stepped_by(scene: Scene, integrator: str, step: float, checked: bool = True) -> Scene:
    """Return a scene with another integrator and step (s); nothing else is changed.

    Args:
        scene: to step.
        integrator: by name.
        step: s.
        checked: whether each step's energy is held to its tolerance.
    """
    accuracy = scene.simulation.accuracy if checked else Accuracy(tolerance=0.0)
    return scene.stepped(integrator=integrator, period=step, substeps=1, accuracy=accuracy)


class _Own:
    def __init__(self, scene: Scene, start: State) -> None:
        self._simulator = Simulator(scene)
        first = self._simulator.initial_state()
        self._first = MechanismState(
            0.0, start.q.copy(), start.v.copy(), first.active, first.closure_error
        )
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
        return [self._output(output) for output in outputs]

    def _output(self, output: Output) -> tuple[float, ...]:
        mechanism, q = self._simulator.mechanism, self._state.q
        if output.kind == "joint":
            at = joint_place(mechanism.tree, output.name)
            return tuple(float(q[at + k]) for k in output.components)
        pose = mechanism.frame_pose(q, output.name)
        return tuple(float(pose.translation[k]) for k in output.components)
