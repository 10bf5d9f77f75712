"""One step of the mechanism: integration, then projection onto the closures, or their pull."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hapticmech_ros.mechanism.constraint_space import NEAR, PASSING, ConstraintSpace
from hapticmech_ros.mechanism.evaluation import Active, Closing
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.mechanism.motion import (
    HeldMotion,
    Pushes,
    Start,
    check_pushes,
    not_finite,
)
from hapticmech_ros.mechanism.projection import (
    BAUMGARTE_FAILURE,
    PROJECTION_TOLERANCE,
    Projected,
    project,
    refuse_flipped,
    refuse_open,
)
from hapticmech_ros.mechanism.schemes import INTEGRATORS
from hapticmech_ros.mechanism.singular import nearest_branch

# Leaving a singular position at speed takes so much of a step, and the rest is a step as any other:
# in that time an acceleration that points off the branch does little harm, and beyond it the
# closures are well determined.
SHORT = 0.05
_NO_SAMPLES = np.zeros((0, 0))


class Stepped(NamedTuple):
    """A step's outcome.

    Attributes:
        q, v: the state, arrays of its own.
        error: largest residual of the active closures, m or rad.
        closing: terms at q.
        work_in: work by wrenches and joint forces, J.
        energy_lost: in damping, friction and stops, J.
    """

    q: Array
    v: Array
    error: float
    closing: Closing
    work_in: float
    energy_lost: float


class Plan(NamedTuple):
    """How a period is stepped through.

    Attributes:
        integrator: name of a rule of ``INTEGRATORS``.
        period: s.
        substeps: steps of the integrator in a period.
        baumgarte_rate: a of T4 (docs/derivations.md), 1/s; 0 where states are projected instead.
    """

    integrator: str
    period: float
    substeps: int = 1
    baumgarte_rate: float = 0.0


class Stepper:
    """Steps a mechanism by one period, in plain NumPy.

    Args:
        mechanism: to step.
        plan: how.
    """

    def __init__(self, mechanism: Mechanism, plan: Plan) -> None:
        self._mechanism = mechanism
        self._plan = plan
        self._step = plan.period / plan.substeps
        self._pull = plan.baumgarte_rate

    def advance(self, start: Start, pushes: Pushes) -> Stepped:
        """Advance by one period with pushes held; see ``Simulator.step``."""
        return self.run(start, pushes, 1, _NO_SAMPLES, 0)

    def run(
        self, start: Start, pushes: Pushes, periods: int, samples: Array, every: int
    ) -> Stepped:
        """Advance by many periods with pushes held, and fill samples; see ``Simulator.run``.

        Args:
            start: where.
            pushes: from outside.
            periods: how many, at least one.
            samples: (periods // every, nq + nv) to fill.
            every: periods from one sample to the next; 0 for none.

        Returns:
            The end, with work and loss of all steps.
        """
        self.check(pushes)
        work_in, energy_lost, substeps = 0.0, 0.0, self._plan.substeps
        for step in range(1, periods * substeps + 1):
            stepped = self.careful_substep(start, pushes)
            work_in += stepped.work_in
            energy_lost += stepped.energy_lost
            start = end_of(stepped, start)
            if every and step % (every * substeps) == 0:
                samples[step // (every * substeps) - 1] = np.concatenate((stepped.q, stepped.v))
        return stepped._replace(work_in=work_in, energy_lost=energy_lost)

    def check(self, pushes: Pushes) -> None:
        """Check pushes; see :func:`check_pushes`."""
        check_pushes(pushes, len(self._mechanism.point_names), self._mechanism.nv)

    def careful_substep(self, start: Start, pushes: Pushes) -> Stepped:
        """Do a step; with care where branches of the motion cross, or nearly do.

        There closures gain rank in a step, or keep a σ that says little of the direction.
        """
        if self._pull > 0.0:
            return self._substep(start, pushes)
        known = start.closing if start.terms is None else start.terms.closing
        closing = known or self._mechanism.closing_terms(start.q, start.active)
        start = start._replace(closing=closing)
        limit = care_limit(self._step * float(np.abs(start.v).max()))
        if closing.least < limit:
            return self._leave(start, pushes, closing) or self._substep(start, pushes)
        stepped = self._watched_substep(start, pushes, limit)
        if stepped is None:
            stepped = self._step_around(start, pushes, closing)
        if stepped.closing.resolved <= closing.resolved:
            return stepped
        return self._leave(start, pushes, closing) or stepped

    def _leave(self, start: Start, pushes: Pushes, closing: Closing) -> Stepped | None:
        """Step away from a singular position along one branch; None if no branch takes it up."""
        mechanism, step = self._mechanism, self._step
        q, v, active = start.q, start.v, start.active
        motion = HeldMotion(mechanism, start, pushes)
        first = motion(q, v)
        away = 0.5 * step * first.acceleration
        space = closing.space
        at_speed = space.size(v) > 10.0 * space.size(away)
        part = SHORT * step if at_speed else step
        change = part * v + 0.5 * part**2 * first.acceleration
        branch = nearest_branch(mechanism, q, active, space, change)
        if branch is None:
            return None
        there = mechanism.integrate(q, branch.closed_rates(change))
        ended = _put(mechanism, there, v + part * first.acceleration, active, branch)
        refuse_flipped(mechanism, ended.q, ended.error, active)
        last = motion(ended.q, ended.v)
        work_in = 0.5 * part * (first.power_in + last.power_in)
        lost = 0.5 * part * (first.power_lost + last.power_lost)
        led = Stepped(*ended, work_in, lost)
        if not at_speed:
            return led
        return _sum_of(led, self._part(end_of(led, start), pushes, step - part))

    def _substep(self, start: Start, pushes: Pushes) -> Stepped:
        """Do a step of the integrator, and bring it onto the closures."""
        return self._follow(HeldMotion(self._mechanism, start, pushes, self._pull), start)

    def _watched_substep(self, start: Start, pushes: Pushes, limit: float) -> Stepped | None:
        """Do a step; None if a stage of it lies where a relative σ is below ``limit``."""
        motion = HeldMotion(self._mechanism, start, pushes, self._pull)
        stepped = self._follow(motion, start)
        return None if motion.least < limit else stepped

    def _follow(self, motion: HeldMotion, start: Start) -> Stepped:
        mechanism, step = self._mechanism, self._step
        integrate = INTEGRATORS[self._plan.integrator]
        moved = integrate(mechanism.model, motion, start.q, start.v, step)
        if not math.isfinite(moved.q @ moved.q + moved.v @ moved.v):
            raise not_finite("state", moved.q)
        if self._pull > 0.0:
            closing = mechanism.closing_terms(moved.q, start.active)
            refuse_open(mechanism, closing.error, start.active, BAUMGARTE_FAILURE)
            ended = Projected(moved.q, moved.v, closing.error, closing)
        else:
            ended = project(mechanism, moved.q, moved.v, start.active, moved.change)
        refuse_flipped(mechanism, ended.q, ended.error, start.active)
        return Stepped(*ended, moved.work_in, moved.energy_lost)

    def _step_around(self, start: Start, pushes: Pushes, closing: Closing) -> Stepped:
        """Do a step as two, of which no stage lies where this step's own would be singular."""
        after = self._substep(start, pushes).closing.least
        where = closing.least / (closing.least + after)
        first = self._part(start, pushes, self._step * split_around(where))
        second = self._part(end_of(first, start), pushes, self._step * (1.0 - split_around(where)))
        return _sum_of(first, second)

    def _part(self, start: Start, pushes: Pushes, step: float) -> Stepped:
        """Do a step of another length."""
        plan = self._plan._replace(period=step, substeps=1)
        return Stepper(self._mechanism, plan)._substep(start, pushes)


def split_around(where: float) -> float:
    """Return at which share of a step to split it if it is next to a singular one at ``where``.

    Both halves of a step by a rule of Runge and Kutta have stages at their ends and in the middle.
    That share is then between two of them, and no nearer to one than a tenth of the step.
    """
    split = (4.0 * where - 1.0) / 3.0 if where < 0.5 else 4.0 * where / 3.0
    return min(0.9, max(0.1, split))


def end_of(stepped: Stepped, start: Start) -> Start:
    """Return where a step ended as where the next one begins."""
    return Start(stepped.q, stepped.v, start.active, closing=stepped.closing)


def _sum_of(first: Stepped, second: Stepped) -> Stepped:
    """Return two steps as one."""
    return second._replace(
        work_in=first.work_in + second.work_in, energy_lost=first.energy_lost + second.energy_lost
    )


def care_limit(moved: float) -> float:
    """Return the relative σ below which a step needs care if it moves a joint by so much."""
    return max(NEAR, min(PASSING, moved))


def _put(
    mechanism: Mechanism, q: Array, v: Array, active: Active, branch: ConstraintSpace
) -> Projected:
    """Return a state that was led along a branch, on the closures.

    Next to where branches cross it is on them to rounding, and the closures' rows there say less of
    the branch's direction than what led it.
    """
    closing = mechanism.closing_terms(q, active)
    if closing.least < NEAR and closing.error <= PROJECTION_TOLERANCE * mechanism.length:
        return Projected(q, branch.closed_rates(v), closing.error, closing)
    return project(mechanism, q, v, active)
