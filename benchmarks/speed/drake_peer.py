# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drake as a peer: its discrete solver with loops as constraints, its integrators with bushings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np

from benchmarks.accuracy.cases import Output
from benchmarks.speed.contender import Contender, Method, Reading, Setting, State
from benchmarks.speed.drake_model import NAME, RATE, RATIO, DrakePlant, Loops, refuse
from hapticmech_ros.scene import Scene

EXTRA = "pip install '.[drake]'"
# The discrete solver, and rules of Drake's integrators by their names there.
SAP, RK2, RK3, RK5 = "sap", "rk2 bushings", "rk3 bushings", "rk5"
SCHEMES = {RK2: "runge_kutta2", RK3: "runge_kutta3", RK5: "runge_kutta5"}
LOOPS: Mapping[str, Loops] = {SAP: "constraints", RK2: "bushings", RK3: "bushings", RK5: "none"}
# Of the discrete solver, which stays stable, and close on the platform, at longer steps than other
# rules of order 1.
STEPS = (20.0, 10.0, 4.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02)
# From the stiffest that a rule takes on: closures may feel less inertia later than at the start.
BUSHINGS_2: tuple[Setting, ...] = (
    {RATE: 1.9, RATIO: 0.7},
    {RATE: 1.9, RATIO: 0.5},
    {RATE: 1.5, RATIO: 0.7},
    {RATE: 1.3, RATIO: 0.7},
)
BUSHINGS_3: tuple[Setting, ...] = (
    {RATE: 2.4, RATIO: 0.5},
    {RATE: 2.1, RATIO: 0.5},
    {RATE: 2.1, RATIO: 0.8},
    {RATE: 1.5, RATIO: 0.5},
)


class DrakePeer:
    """Drake by ``Simulator.AdvanceTo``, many steps in a call.

    Constraints hold closures in discrete steps alone, whose error is of order 1. Bushings hold them
    for its integrators; the stiffest that a step allows leave an error of order 2. Other rules and
    control of the error are left out: those tried were no closer in the same time, or hardly.
    """

    name = NAME
    methods = (
        Method(SAP, 1, multiples=STEPS),
        Method(RK2, 2, BUSHINGS_2),
        Method(RK3, 2, BUSHINGS_3),
        Method(RK5, 5),
    )

    def missing(self) -> str:
        """Return why it cannot run here, empty if it can."""
        return "" if find_spec("pydrake") else f"Drake is not installed: {EXTRA}"

    def contender(
        self, scene: Scene, start: State, method: Method, step: float, setting: Setting
    ) -> Contender:
        """Return the scene ready to run."""
        refuse(scene, LOOPS[method.name])
        return _Drake(scene, start, method, step, setting)


class _Drake:
    def __init__(
        self, scene: Scene, start: State, method: Method, step: float, setting: Setting
    ) -> None:
        from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator

        discrete = method.name == SAP
        self._converted = DrakePlant(scene, start, step, None if discrete else setting)
        self._plant: Any = self._converted.plant
        self._step, self._taken = step, 0
        self._simulator: Any = Simulator(self._plant)
        self._context: Any = self._simulator.get_mutable_context()
        if not discrete:
            scheme = SCHEMES[method.name]
            ResetIntegratorFromFlags(self._simulator, scheme, step).set_fixed_step_mode(True)
        efforts = self._converted.efforts()
        if efforts.any():
            port = self._plant.get_applied_generalized_force_input_port()
            port.FixValue(self._context, efforts)
        self._first = self._converted.state(start)
        self.restart()

    def restart(self) -> None:
        """Go back to the initial state."""
        self._taken = 0
        self._context.SetTime(0.0)
        self._plant.SetPositionsAndVelocities(self._context, self._first)
        self._simulator.Initialize()

    def advance(self, steps: int) -> None:
        """Take so many steps."""
        self._taken += steps
        self._simulator.AdvanceTo(self._taken * self._step)
        if not np.isfinite(self._plant.GetPositions(self._context)).all():
            raise FloatingPointError("Drake's motion is lost")

    def read(self, outputs: Sequence[Output]) -> Reading:
        """Return what outputs are now, m or rad."""
        return [self._converted.read(self._context, output) for output in outputs]
