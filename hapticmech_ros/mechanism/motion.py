"""The equations of motion during a step: where it starts, and what is held while it lasts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.evaluation import Active, Closing, Evaluation
from hapticmech_ros.mechanism.implicit import Springs
from hapticmech_ros.mechanism.integrator import Rates
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.model import Array

NOTHING: Mapping[str, Array] = MappingProxyType({})


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


class HeldMotion:
    """The equations of motion with pushes held; see ``integrator.Motion``.

    Args:
        mechanism: that moves.
        start: of the step.
        pushes: held.
        pull: Baumgarte's rate, 1/s; 0 for none.

    Attributes:
        least: smallest σ kept over the largest one, of all stages but the first; 0 if a stage kept
            fewer than the first one.
    """

    def __init__(
        self, mechanism: Mechanism, start: Start, pushes: Pushes, pull: float = 0.0
    ) -> None:
        self._mechanism = mechanism
        self._start = start
        self._pushes = pushes
        self._pull = pull
        self._first: Evaluation | None = None
        self.least = 1.0

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

    @property
    def first(self) -> Evaluation:
        """The terms at the step's start."""
        return self._evaluate(self._start.q, self._start.v)

    def _evaluate(self, q: Array, v: Array) -> Evaluation:
        start = self._start
        if q is not start.q or v is not start.v:
            terms = self._mechanism.evaluate(q, v, start.active)
            fewer = self._first is not None and terms.space.rank < self._first.space.rank
            self.least = min(self.least, 0.0 if fewer else terms.space.least_kept)
            return terms
        if self._first is None:
            known = start.terms
            self._first = known or self._mechanism.evaluate(q, v, start.active, start.closing)
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


def check_pushes(pushes: Pushes, points: int, nv: int) -> None:
    """Check pushes on a mechanism with so many operational points and degrees of freedom.

    Raises:
        InvalidInputError: a wrong shape, or joint forces that are NaN or infinite.
    """
    if pushes.wrenches.shape != (points, 6):
        raise InvalidInputError("wrenches", pushes.wrenches.shape, f"must have shape {points, 6}")
    forces = pushes.in_joints
    if forces is not None and (np.shape(forces) != (nv,) or not np.isfinite(forces).all()):
        raise InvalidInputError("joint_forces", forces, f"must be {nv} finite numbers")


def not_finite(what: str, values: Array) -> InvalidInputError:
    """Return the error of ``mechanism <what>`` that is NaN or infinite."""
    return InvalidInputError(f"mechanism {what}", values.tolist(), "must stay finite")
