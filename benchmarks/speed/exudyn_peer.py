# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Exudyn as a peer: generalized-α for what is closed, an explicit rule as well for what is open."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np

from benchmarks.accuracy.cases import Output
from benchmarks.speed.contender import (
    EXTRA,
    Contender,
    Method,
    Reading,
    Setting,
    State,
    UnsuitableError,
)
from benchmarks.speed.exudyn_model import NAME, ExudynScene
from benchmarks.speed.exudyn_planar import ExudynPlane
from hapticmech_ros.scene import Scene

# Generalized-α over a kinematic tree with closures, and over bodies in the plane; RK44.
ALPHA_TREE, ALPHA_BODIES, RK = "alpha_tree", "alpha_bodies", "rk4"
# Spectral radius at infinity: less damps more. And whether closures are held in speed (index 2).
RADIUS, INDEX_2 = "spectral radius", "index 2"
SETTINGS: tuple[Setting, ...] = (
    {RADIUS: 0.9, INDEX_2: 0.0},
    {RADIUS: 1.0, INDEX_2: 1.0},
    {RADIUS: 0.6, INDEX_2: 0.0},
)
# Of Newton's method.
RELATIVE, ABSOLUTE = 1e-8, 1e-10
# Unknowns from which on a sparse solver is faster.
LARGE = 60


class ExudynPeer:
    """Exudyn by ``SolveDynamic``, many steps in a call."""

    name = NAME
    methods = (
        Method(ALPHA_TREE, 2, SETTINGS),
        Method(ALPHA_BODIES, 2, SETTINGS),
        Method(RK, 4),
    )

    def missing(self) -> str:
        """Return why it cannot run here, empty if it can."""
        return "" if find_spec("exudyn") else f"Exudyn is not installed: {EXTRA}"

    def contender(
        self, scene: Scene, start: State, method: Method, step: float, setting: Setting
    ) -> Contender:
        """Return the scene ready to run."""
        return _Exudyn(scene, start, method, step, setting)


class _Exudyn:
    def __init__(
        self, scene: Scene, start: State, method: Method, step: float, setting: Setting
    ) -> None:
        import exudyn

        self._exudyn: Any = exudyn
        bodies = method.name == ALPHA_BODIES
        self._converted: ExudynPlane | ExudynScene
        self._converted = (ExudynPlane if bodies else ExudynScene)(scene, start)
        if method.name == RK and self._converted.closed:
            raise UnsuitableError(NAME, scene.name, "explicit rules take no closures")
        self._step = step
        system = self._converted.system
        kinds = exudyn.DynamicSolverType
        self._solver = kinds.RK44 if method.name == RK else kinds.GeneralizedAlpha
        self._settings = self._quiet(setting)
        initial, now = exudyn.ConfigurationType.Initial, system.systemData
        self._first = (
            np.array(now.GetODE2Coordinates(initial)),
            np.array(now.GetODE2Coordinates_t(initial)),
            np.zeros(len(now.GetAECoordinates(initial))),
        )
        self.restart()

    def restart(self) -> None:
        """Go back to the initial state."""
        data, initial = self._converted.system.systemData, self._exudyn.ConfigurationType.Initial
        data.SetODE2Coordinates(self._first[0], initial)
        data.SetODE2Coordinates_t(self._first[1], initial)
        data.SetAECoordinates(self._first[2], initial)
        self._time = 0.0

    def advance(self, steps: int) -> None:
        """Take so many steps."""
        span = self._settings.timeIntegration
        span.startTime, span.endTime = self._time, self._time + steps * self._step
        span.numberOfSteps = steps
        done = self._converted.system.SolveDynamic(
            self._settings,
            solverType=self._solver,
            updateInitialValues=True,
            showCausingItems=False,
            autoAssemble=False,
        )
        self._time = span.endTime
        if not done:
            raise FloatingPointError("Exudyn's solver gave up")

    def read(self, outputs: Sequence[Output]) -> Reading:
        """Return what outputs are now, m or rad."""
        return [self._converted.read(output) for output in outputs]

    def _quiet(self, setting: Setting) -> Any:
        exudyn = self._exudyn
        exudyn.config.printToConsole = False
        settings = exudyn.SimulationSettings()
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = 1e30
        settings.show.computationTime = False
        settings.show.statistics = False
        settings.timeIntegration.verboseMode = 0
        settings.timeIntegration.automaticStepSize = False
        settings.timeIntegration.adaptiveStep = False
        newton = settings.timeIntegration.newton
        newton.relativeTolerance, newton.absoluteTolerance = RELATIVE, ABSOLUTE
        newton.useModifiedNewton = True
        alpha = settings.timeIntegration.generalizedAlpha
        if setting:
            alpha.spectralRadius = setting[RADIUS]
            alpha.useIndex2Constraints = bool(setting[INDEX_2])
            alpha.useNewmark = bool(setting[INDEX_2])
        else:
            alpha.spectralRadius = 1.0
        solvers, data = exudyn.LinearSolverType, self._converted.system.systemData
        size = len(data.GetODE2Coordinates()) + len(data.GetAECoordinates())
        # Only the dense one takes closures that are redundant.
        settings.linearSolver.solverType = (
            solvers.EigenDense if size < LARGE else solvers.EigenSparse
        )
        settings.linearSolver.ignoreSingularJacobian = size < LARGE
        return settings
