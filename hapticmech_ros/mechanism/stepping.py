"""One step of the mechanism: integration, then projection onto the closures, or their pull."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.constraint_space import NEAR, PASSING, ConstraintSpace
from hapticmech_ros.mechanism.evaluation import Active, Closing, Evaluation
from hapticmech_ros.mechanism.implicit import Springs
from hapticmech_ros.mechanism.integrator import Rates
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.model import Array
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
NOTHING: Mapping[str, Array] = MappingProxyType({})
_NO_SAMPLES = np.zeros((0, 0))


class Start(NamedTuple):
    """Where a step begins: a state on the closures, and what is known there already."""

    q: Array
    v: Array
    active: Active
    terms: Evaluation | None = None
    closing: Closing | None = None


class Pushes(NamedTuple):
    """What acts from outside, held during a step.

    Attributes:
        wrenches: (points, 6) at the operational points, world axes, N and N m.
        on_links: further wrenches (6,) by name of the link, at the origin of its frame.
        in_joints: (nv,) further joint forces, N m or N; None for none.
    """

    wrenches: Array
    on_links: Mapping[str, Array] = NOTHING
    in_joints: Array | None = None


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
        self._shape = (len(mechanism.point_names), 6)
        self._step = plan.period / plan.substeps

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
        self._check(pushes)
        work_in, energy_lost, substeps = 0.0, 0.0, self._plan.substeps
        for step in range(1, periods * substeps + 1):
            stepped = self._careful_substep(start, pushes)
            work_in += stepped.work_in
            energy_lost += stepped.energy_lost
            start = Start(stepped.q, stepped.v, start.active, closing=stepped.closing)
            if every and step % (every * substeps) == 0:
                samples[step // (every * substeps) - 1] = np.concatenate((stepped.q, stepped.v))
        return stepped._replace(work_in=work_in, energy_lost=energy_lost)

    def _check(self, pushes: Pushes) -> None:
        if pushes.wrenches.shape != self._shape:
            rule = f"must have shape {self._shape}"
            raise InvalidInputError("wrenches", pushes.wrenches.shape, rule)
        if pushes.in_joints is not None:
            _check_joint_forces(pushes.in_joints, self._mechanism.nv)

    def _careful_substep(self, start: Start, pushes: Pushes) -> Stepped:
        """Do a step; with care where branches of the motion cross, or nearly do.

        There closures gain rank in a step, or keep a σ that says little of the direction.
        """
        if self._plan.baumgarte_rate > 0.0:
            return self._substep(start, pushes)
        known = start.closing if start.terms is None else start.terms.closing
        closing = known or self._mechanism.closing_terms(start.q, start.active)
        if closing.least < care_limit(self._step * float(np.abs(start.v).max())):
            return self._leave(start, pushes, closing) or self._substep(start, pushes)
        stepped = self._substep(start, pushes)
        if stepped.closing.resolved <= closing.resolved:
            return stepped
        return self._leave(start, pushes, closing) or stepped

    def _leave(self, start: Start, pushes: Pushes, closing: Closing) -> Stepped | None:
        """Step away from a singular position along one branch; None if no branch takes it up."""
        mechanism, step = self._mechanism, self._plan.period / self._plan.substeps
        q, v, active = start.q, start.v, start.active
        motion = _Motion(mechanism, start, pushes, 0.0)
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
        if not at_speed:
            return Stepped(*ended, work_in, lost)
        rest = Stepper(mechanism, self._plan._replace(period=step - part, substeps=1))
        stepped = rest._substep(Start(ended.q, ended.v, active, closing=ended.closing), pushes)
        return stepped._replace(
            work_in=work_in + stepped.work_in, energy_lost=lost + stepped.energy_lost
        )

    def _substep(self, start: Start, pushes: Pushes) -> Stepped:
        """Do a step of the integrator, and bring it onto the closures."""
        mechanism, plan = self._mechanism, self._plan
        motion = _Motion(mechanism, start, pushes, plan.baumgarte_rate)
        integrate, step = INTEGRATORS[plan.integrator], plan.period / plan.substeps
        moved = integrate(mechanism.model, motion, start.q, start.v, step)
        if not math.isfinite(moved.q @ moved.q + moved.v @ moved.v):
            raise not_finite("state", moved.q)
        if plan.baumgarte_rate > 0.0:
            closing = mechanism.closing_terms(moved.q, start.active)
            refuse_open(mechanism, closing.error, start.active, BAUMGARTE_FAILURE)
            ended = Projected(moved.q, moved.v, closing.error, closing)
        else:
            ended = project(mechanism, moved.q, moved.v, start.active, moved.change)
        refuse_flipped(mechanism, ended.q, ended.error, start.active)
        return Stepped(*ended, moved.work_in, moved.energy_lost)


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


class _Motion:
    """The equations of motion with pushes held; see ``integrator.Motion``."""

    def __init__(self, mechanism: Mechanism, start: Start, pushes: Pushes, pull: float) -> None:
        self._mechanism = mechanism
        self._start = start
        self._pushes = pushes
        self._pull = pull
        self._first: Evaluation | None = None

    def __call__(self, q: Array, v: Array) -> Rates:
        """Return the rates at a stage."""
        if not math.isfinite(v @ v):
            raise not_finite("rates", v)
        terms = self._evaluate(q, v)
        force = self._force(q, terms)
        power_in = float((force + terms.effort) @ v)
        power_lost = -float(terms.dissipative_force @ v)
        acceleration, _ = self._pulled(terms, v).acceleration(force)
        return Rates(acceleration, power_in, power_lost)

    def resistance(self, q: Array, v: Array, period: float, reach: float) -> Springs | None:
        """Return springs and dampers at the step's start, or None where there is none."""
        stiffness, damping = self._mechanism.slopes(q, v, period)
        if not (stiffness.any() or damping.any()):
            return None
        return Springs(self._evaluate(q, v).space, stiffness, damping, reach)

    def _evaluate(self, q: Array, v: Array) -> Evaluation:
        start = self._start
        if q is not start.q or v is not start.v:
            return self._mechanism.evaluate(q, v, start.active)
        if start.terms is not None:
            return start.terms
        if self._first is None:
            self._first = self._mechanism.evaluate(q, v, start.active, start.closing)
        return self._first

    def _force(self, q: Array, terms: Evaluation) -> Array:
        wrenches, on_links, in_joints = self._pushes
        force = np.zeros(terms.bias_force.size) if in_joints is None else in_joints.copy()
        for point, wrench in zip(terms.points, wrenches, strict=True):
            force += wrench @ point.jacobian
        for link, wrench in on_links.items():
            force += wrench @ self._mechanism.link_jacobian(q, link)
        return force

    def _pulled(self, terms: Evaluation, v: Array) -> Evaluation:
        """Return the terms with W v̇ = -Ẇv - 2a W v - a² φ for W v̇ = -Ẇv."""
        if self._pull == 0.0:
            return terms
        gap, speed = terms.closure_residual, terms.closure_jacobian @ v
        pull = 2.0 * self._pull * speed + self._pull**2 * gap
        return terms._replace(closure_bias=terms.closure_bias + pull)


def _check_joint_forces(forces: Array, nv: int) -> None:
    """Check joint forces from outside.

    Raises:
        InvalidInputError: not (nv,), NaN or infinite.
    """
    if np.shape(forces) != (nv,) or not np.isfinite(forces).all():
        raise InvalidInputError("joint_forces", forces, f"must be {nv} finite numbers")


def not_finite(what: str, values: Array) -> InvalidInputError:
    """Return the error of ``mechanism <what>`` that is NaN or infinite."""
    return InvalidInputError(f"mechanism {what}", values.tolist(), "must stay finite")
