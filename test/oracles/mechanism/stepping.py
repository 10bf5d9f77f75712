# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps of the readable mechanism in NumPy: integration, then projection, or Baumgarte's pull."""

from __future__ import annotations

import math
from typing import NoReturn

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import Evaluation
from hapticmech_ros.mechanism.motion import (
    ExternalWrenches,
    HeldMotion,
    Plan,
    Start,
    Stepped,
    check_external,
    end_of,
    not_finite,
    plan_of,
)
from hapticmech_ros.mechanism.projection import (
    Projected,
    came_apart,
    project,
    refuse_flipped,
    refuse_jump,
)
from hapticmech_ros.mechanism.refinement import Balance
from hapticmech_ros.mechanism.stepping import Stepper
from hapticmech_ros.mechanism.tolerances import (
    BAUMGARTE_FAILURE,
    ENERGY_ROUNDING,
    NEAR,
    PASSING,
    PROJECTION_FAILURE,
    PROJECTION_TOLERANCE,
    SHRINKS,
    SIMPLIFIED,
    SINGULAR,
    UNFELT,
)
from hapticmech_ros.scene import Scene
from hapticmech_ros.simulation import Simulator
from hapticmech_ros.simulation.simulator import Latches
from oracles.mechanism.integrators import INTEGRATORS, Advance, Springs
from oracles.mechanism.mechanism import ReadableMechanism, ReadableSpace


class ReadableMotion(HeldMotion):
    """The equations of motion with pushes held; see ``integrators.Motion``.

    Attributes:
        least: smallest σ kept over the largest one, of all stages but the first; 0 if a stage kept
            fewer than the first one.
        last: factors of the last stage.
    """

    least = 1.0
    last: ReadableSpace | None = None

    def resistance(self, q: Array, v: Array, period: float, reach: float) -> Springs | None:
        """Return springs and dampers at the step's start, or None where there is none."""
        stiffness, damping = self._mechanism.slopes(q, v, period)
        if not (stiffness.any() or damping.any()):
            return None
        return Springs(self._evaluate(q, v).space, stiffness, damping, reach)

    def _evaluate(self, q: Array, v: Array) -> Evaluation:
        terms = super()._evaluate(q, v)
        self.last = terms.space
        if q is not self._start.q or v is not self._start.v:
            fewer = self._first is not None and terms.space.rank < self._first.space.rank
            self.least = min(self.least, 0.0 if fewer else terms.space.least_kept)
        return terms


class ReadableStepper(Stepper):
    """Steps as :class:`Stepper` does, whose care next to singular positions it shares."""

    def __init__(self, mechanism: ReadableMechanism, plan: Plan) -> None:
        self._mechanism = mechanism
        self._plan = plan
        self.step, self._tolerance = plan.period / plan.substeps, 0.0
        self._pulled = plan.baumgarte_rate > 0.0

    def run(
        self, start: Start, external: ExternalWrenches, periods: int, samples: Array, every: int
    ) -> Stepped:
        """Advance by many periods with pushes held, and fill samples."""
        check_external(external, len(self._mechanism.point_names), self._mechanism.nv)
        work_in, energy_lost, substeps = 0.0, 0.0, self._plan.substeps
        for step in range(1, periods * substeps + 1):
            stepped = self._careful_substep(start, external)
            work_in += stepped.work_in
            energy_lost += stepped.energy_lost
            start = end_of(stepped, start)
            if every and step % (every * substeps) == 0:
                samples[step // (every * substeps) - 1] = np.concatenate((stepped.q, stepped.v))
        return stepped._replace(work_in=work_in, energy_lost=energy_lost)

    def _careful_substep(self, start: Start, external: ExternalWrenches) -> Stepped:
        """Do a step; with care if its start, end or a stage is next to a singular position."""
        if self._pulled:
            return self._substep(start, external)
        known = start.closing if start.terms is None else start.terms.closing
        closing = known or self._mechanism.closing_terms(start.q, start.active)
        limit = max(NEAR, min(PASSING, self.step * float(np.abs(start.v).max())))
        if closing.least >= limit:
            motion = ReadableMotion(self._mechanism, start, external)
            stepped = self._follow(motion, start)
            ended = stepped.closing
            moved = ended.resolved > closing.resolved or ended.rank < closing.rank
            if not (moved or motion.least < limit or ended.least < limit):
                return stepped
        return super()._careful_substep(start, external)

    def _balance(
        self, start: Start, stepped: Stepped, external: ExternalWrenches, damps: bool
    ) -> Balance:
        """Return the energy account of a step, by Pinocchio's energies."""
        moved, stood = self._mechanism.energy(start.q, start.v)
        moves, stands = self._mechanism.energy(stepped.q, stepped.v)
        work_in, lost = stepped.work_in, stepped.energy_lost
        off = (moves - moved) + (stands - stood) - work_in + lost
        exchanged = moved + moves + abs(stands - stood) + abs(work_in) + abs(lost)
        rounding = ENERGY_ROUNDING * (abs(stood) + abs(stands)) + UNFELT
        return Balance(off, abs(off), max(off, 0.0), exchanged, rounding, moves, lost)

    def _substep(self, start: Start, external: ExternalWrenches) -> Stepped:
        """Do a step of the integrator, and bring it onto the closures."""
        return self._follow(
            ReadableMotion(self._mechanism, start, external, self._plan.baumgarte_rate), start
        )

    def _follow(self, motion: ReadableMotion, start: Start) -> Stepped:
        mechanism, step = self._mechanism, self.step
        integrate = INTEGRATORS[self._plan.integrator]
        moved = integrate(mechanism.model, motion, start.q, start.v, step)
        if not math.isfinite(moved.q @ moved.q + moved.v @ moved.v):
            raise not_finite("state", moved.q)
        if self._pulled:
            closing = mechanism.closing_terms(moved.q, start.active)
            if not closing.error <= BAUMGARTE_FAILURE * mechanism.length:
                raise came_apart(closing.error, mechanism.names_of(start.active))
            ended = Projected(moved.q, moved.v, closing.error, closing)
        else:
            ended = self.settled(moved, start.active, motion.last)
        refuse_flipped(mechanism, ended.q, ended.error, start.active)
        return Stepped(*ended, moved.work_in, moved.energy_lost)

    def settled(self, moved: Advance, active: Active, stage: ReadableSpace) -> Projected:
        """Bring a step's end onto the closures, first by factors of its last stage."""
        mechanism, q, before = self._mechanism, moved.q, np.inf
        stepped, corrected = np.inf, 0.0
        for _ in range(SIMPLIFIED if stage.rank and stage.least_kept > SINGULAR else 0):
            closing = mechanism.closing_terms(q, active)
            if not PROJECTION_TOLERANCE * mechanism.length < closing.error < SHRINKS * before:
                break
            if before == np.inf and closing.error > PROJECTION_FAILURE * mechanism.length:
                stepped = stage.size(moved.change)
            correction = stage.correction(closing.residual)
            corrected += stage.size(correction)
            q, before = mechanism.integrate(q, -correction), closing.error
        settled = project(mechanism, q, moved.v, active, moved.change if before == np.inf else None)
        refuse_jump(mechanism, stepped, corrected, active)
        return settled


class ReadableSimulator(Simulator):
    """A :class:`Simulator` of the readable mechanism."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self.mechanism = mechanism = ReadableMechanism(scene)
        plan = plan_of(mechanism.scene.simulation)
        self.stepper = ReadableStepper(mechanism, plan)
        self._latches = Latches(mechanism)
        if scene.contacts:
            self._contacts = _Unable()


class _Unable:
    """Stands for steps with contacts, which kernels do alone."""

    def energy_at(self, _: object) -> float:
        """Return nothing."""
        return 0.0

    def advance(self, *_: object) -> NoReturn:
        """Take no step.

        Raises:
            HapticMechError: always.
        """
        raise HapticMechError("steps with contacts are for kernels alone")
