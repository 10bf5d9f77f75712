# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What goes into a step of a mechanism and what comes out, and the equations of motion in it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import Closing, Evaluation
from hapticmech_ros.mechanism.kernels.layout import ActiveSet
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene.mechanism import Simulation

NOTHING: Mapping[str, Array] = MappingProxyType({})


class Owed(NamedTuple):
    """What the energy account has at a step's start, J, as far as its drift goes.

    Attributes:
        surplus: made from nothing so far.
        work_in: work done.
        lost: energy lost, contacts and latches included.
        moved: largest kinetic energy at the end of a step.
    """

    surplus: float = 0.0
    work_in: float = 0.0
    lost: float = 0.0
    moved: float = 0.0


class Start(NamedTuple):
    """Where a step begins: a state on the closures, and what is known there already.

    Attributes:
        q: (nq,) configuration.
        v: (nv,) rates, rad/s or m/s.
        active: per closure, whether it is closed.
        terms: of Eq. 1 there, if known.
        closing: the closures' terms there, if known.
        owed: by the account so far.
    """

    q: Array
    v: Array
    active: Active
    terms: Evaluation | None = None
    closing: Closing | None = None
    owed: Owed = Owed()

    def packed(self, active_set: ActiveSet) -> Array | None:
        """Return the packed terms (size,) if they are known, and of this kind."""
        closing = self.closing if self.terms is None else self.terms.closing
        if closing is None:
            return None
        return closing.packed if closing.active_set is active_set else None


class ExternalWrenches(NamedTuple):
    """What acts from outside, held during a step.

    Attributes:
        wrenches: (points, 6) at the operational points, world axes, N and N m.
        on_links: further wrenches (6,) by name of the link, at its frame's origin, likewise.
        in_joints: (nv,) further joint forces, N m or N; None for none.
        touching: wrenches on links as ``on_links``, those of contacts.
    """

    wrenches: Array
    on_links: Mapping[str, Array] = NOTHING
    in_joints: Array | None = None
    touching: Mapping[str, Array] = NOTHING


class Stepped(NamedTuple):
    """A step's outcome.

    Attributes:
        q, v: the state (nq,), (nv,), arrays of its own.
        error: largest residual of the active closures, m or rad.
        closing: terms at q.
        work_in: work by wrenches and joint forces, without that of contacts, J.
        energy_lost: in damping, friction and stops, J.
        surplus: energy beyond that account, J: what steps made from nothing, or lost if negative.
        refined: steps that were done again in smaller ones, with care, or in parts for an impact.
        inaccurate: of these the ones whose account is still off by more than the tolerance, or
            whose impact would need more parts.
        contact_work: work by contacts, J.
        moved: largest kinetic energy at the end of a step that was watched, J.
    """

    q: Array
    v: Array
    error: float
    closing: Closing
    work_in: float
    energy_lost: float
    surplus: float = 0.0
    refined: int = 0
    inaccurate: int = 0
    contact_work: float = 0.0
    moved: float = 0.0

    def after(self, before: Stepped) -> Stepped:
        """Return this with what the steps before it did added to the accounts."""
        return self._replace(
            work_in=before.work_in + self.work_in,
            energy_lost=before.energy_lost + self.energy_lost,
            surplus=before.surplus + self.surplus,
            refined=before.refined + self.refined,
            inaccurate=before.inaccurate + self.inaccurate,
            contact_work=before.contact_work + self.contact_work,
            moved=max(before.moved, self.moved),
        )


class Plan(NamedTuple):
    """How a period is stepped through.

    Attributes:
        integrator: name of a rule of ``SCHEMES``.
        period: s.
        substeps: steps of the integrator in a period.
        baumgarte_rate: a of T4 (docs/derivations.md), 1/s; 0 where states are projected instead.
        tolerance: by which share of what it exchanges a step's energy account may be off; 0 where
            steps are not watched.
        max_substeps: in which a step is done again at most.
    """

    integrator: str
    period: float
    substeps: int = 1
    baumgarte_rate: float = 0.0
    tolerance: float = 0.0
    max_substeps: int = 1


class Took(NamedTuple):
    """What a call of the kernel did: why it ended, how many steps, and their end if there are."""

    code: int
    steps: int
    stepped: Stepped | None


def end_of(stepped: Stepped, start: Start) -> Start:
    """Return where a step from ``start`` ended as where the next one begins."""
    before = start.owed
    owed = Owed(
        before.surplus + stepped.surplus,
        before.work_in + stepped.work_in,
        before.lost + stepped.energy_lost,
        max(before.moved, stepped.moved),
    )
    return Start(stepped.q, stepped.v, start.active, closing=stepped.closing, owed=owed)


def plan_of(simulation: Simulation) -> Plan:
    """Return how a scene's simulation steps through a period; its integrator is not ``auto``."""
    pulled = simulation.stabilisation == "baumgarte"
    rate = simulation.baumgarte_rate if pulled else 0.0
    accuracy = simulation.accuracy
    tolerance = accuracy.tolerance
    if tolerance is None:
        tolerance = SCHEMES[simulation.integrator].tolerance
    return Plan(
        simulation.integrator,
        simulation.period,
        simulation.substeps,
        rate,
        0.0 if pulled else tolerance,
        accuracy.max_substeps,
    )


class Rates(NamedTuple):
    """What the equations of motion give at a state: v̇ (nv,), rad/s² or m/s²; three powers, W."""

    acceleration: Array
    power_in: float
    power_lost: float
    contact_power: float = 0.0


class HeldMotion:
    """The equations of motion under constant external wrenches.

    Args:
        mechanism: that moves.
        start: of the step.
        external: constant during the step.
        pull: Baumgarte's rate, 1/s; 0 for none.
    """

    def __init__(
        self, mechanism: Mechanism, start: Start, external: ExternalWrenches, pull: float = 0.0
    ) -> None:
        self._mechanism = mechanism
        self._start = start
        self._external = external
        self._pull = pull
        self._first: Evaluation | None = None

    def __call__(self, q: Array, v: Array) -> Rates:
        """Return the rates at a state.

        Raises:
            InvalidInputError: v is not finite.
        """
        if not math.isfinite(v @ v):
            raise not_finite("rates", v)
        terms = self._evaluate(q, v)
        touch = self._on_links(q, self._external.touching, np.zeros(v.size))
        force = self._force(q, terms)
        power_in = float((force + terms.effort) @ v)
        power_lost = -float(terms.dissipative_force @ v)
        acceleration, _ = self._pulled(terms, v).acceleration(force + touch)
        return Rates(acceleration, power_in, power_lost, float(touch @ v))

    @property
    def first(self) -> Evaluation:
        """The terms at the step's start."""
        return self._evaluate(self._start.q, self._start.v)

    def _evaluate(self, q: Array, v: Array) -> Evaluation:
        start = self._start
        if q is not start.q or v is not start.v:
            return self._mechanism.evaluate(q, v, start.active)
        if self._first is None:
            known = start.terms
            self._first = known or self._mechanism.evaluate(q, v, start.active, start.closing)
        return self._first

    def _force(self, q: Array, terms: Evaluation) -> Array:
        wrenches, on_links, in_joints, _ = self._external
        force = np.zeros(terms.bias_force.size) if in_joints is None else in_joints.copy()
        for point, wrench in zip(terms.points, wrenches, strict=True):
            force += wrench @ point.jacobian
        return self._on_links(q, on_links, force)

    def _on_links(self, q: Array, on_links: Mapping[str, Array], force: Array) -> Array:
        """Return joint forces with those of wrenches on links added, in place."""
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


def check_external(external: ExternalWrenches, points: int, nv: int) -> None:
    """Check what acts on a mechanism with so many operational points and degrees of freedom.

    Raises:
        InvalidInputError: a wrong shape, or joint forces that are NaN or infinite.
    """
    if external.wrenches.shape != (points, 6):
        raise InvalidInputError("wrenches", external.wrenches.shape, f"must have shape {points, 6}")
    forces = external.in_joints
    if forces is not None and (np.shape(forces) != (nv,) or not np.isfinite(forces).all()):
        raise InvalidInputError("joint_forces", forces, f"must be {nv} finite numbers")


def not_finite(what: str, values: Array) -> InvalidInputError:
    """Return the error of ``mechanism <what>`` that is NaN or infinite.

    Args:
        what: its name.
        values: (n,).
    """
    return InvalidInputError(f"mechanism {what}", values.tolist(), "must stay finite")
