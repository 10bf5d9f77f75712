"""One step of the mechanism: integration, then projection onto the closures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.integrator import INTEGRATORS, Rates
from hapticmech_ros.mechanism.mechanism import Active, Closing, Evaluation, Mechanism
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.mechanism.projection import project


class Start(NamedTuple):
    """Where a step begins: a state on the closures, and what is known there already."""

    q: Array
    v: Array
    active: Active
    terms: Evaluation | None = None
    closing: Closing | None = None


class Stepped(NamedTuple):
    """A step's outcome.

    Attributes:
        q, v: the state, arrays of its own.
        error: largest residual of the active closures, m or rad.
        closing: terms at q.
        work_in: work by the wrenches, J.
        energy_lost: in damping, J.
    """

    q: Array
    v: Array
    error: float
    closing: Closing
    work_in: float
    energy_lost: float


class Stepper:
    """Steps a mechanism by one period, in plain NumPy.

    Args:
        mechanism: to step.
        integrator: name of a rule of ``INTEGRATORS``.
        period: s.
    """

    def __init__(self, mechanism: Mechanism, integrator: str, period: float) -> None:
        self._mechanism = mechanism
        self._integrate = INTEGRATORS[integrator]
        self._period = period

    def advance(self, start: Start, wrenches: Array, on_links: Mapping[str, Array]) -> Stepped:
        """Advance by one period with wrenches held; see ``Simulator.step``."""
        mechanism, active = self._mechanism, start.active

        def motion(q: Array, v: Array) -> Rates:
            if not math.isfinite(v @ v):
                raise not_finite("rates", v)
            terms = start.terms if q is start.q and v is start.v else None
            if terms is None:
                closing = start.closing if q is start.q else None
                terms = mechanism.evaluate(q, v, active, closing)
            force = np.zeros(v.size)
            for point, wrench in zip(terms.points, wrenches, strict=True):
                force += wrench @ point.jacobian
            for link, wrench in on_links.items():
                force += wrench @ mechanism.link_jacobian(q, link)
            acceleration, _ = terms.acceleration(force)
            return Rates(acceleration, float(force @ v), -float(terms.passive_force @ v))

        moved = self._integrate(mechanism.model, motion, start.q, start.v, self._period)
        if not math.isfinite(moved.q @ moved.q + moved.v @ moved.v):
            raise not_finite("state", moved.q)
        projected = project(mechanism, moved.q, moved.v, active)
        return Stepped(*projected, moved.work_in, moved.energy_lost)


def not_finite(what: str, values: Array) -> InvalidInputError:
    """Return the error of ``mechanism <what>`` that is NaN or infinite."""
    return InvalidInputError(f"mechanism {what}", values.tolist(), "must stay finite")
