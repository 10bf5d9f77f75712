"""One step of a compiled mechanism: few kernels, with Pinocchio's calls in between."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.compiled import CompiledMechanism, failure
from hapticmech_ros.mechanism.compiled_space import CompiledClosing, CompiledSpace
from hapticmech_ros.mechanism.integrator import SCHEMES, local_rate
from hapticmech_ros.mechanism.kernels import NOT_FINITE
from hapticmech_ros.mechanism.mechanism import Active
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.mechanism.projection import (
    PROJECTION_ITERATIONS,
    PROJECTION_TOLERANCE,
    ROUNDING_TOLERANCE,
    refuse_open,
)
from hapticmech_ros.mechanism.step_kernels import (
    SETTLED,
    advance_stage,
    parts_of,
    settle,
    work_size,
)
from hapticmech_ros.mechanism.stepping import Start, Stepped, Stepper, not_finite


class CompiledStepper(Stepper):
    """Steps as :class:`Stepper` does, to rounding, at a fraction of the time."""

    def __init__(self, mechanism: CompiledMechanism, integrator: str, period: float) -> None:
        super().__init__(mechanism, integrator, period)
        self._compiled = mechanism
        nq, nv, points = mechanism.nq, mechanism.nv, len(mechanism.point_names)
        scheme = SCHEMES[integrator]
        self._stages = range(len(scheme.weights))
        self._pushed = False
        self._flat = nq == nv
        self._curved = scheme.corrected and not self._flat
        self._work = np.zeros(work_size(nq, nv, points))
        self._parts = parts = parts_of(self._work, nq, nv)
        length = mechanism.length
        parts.settings[:2] = period, scheme.late
        parts.settings[2:] = PROJECTION_TOLERANCE * length, ROUNDING_TOLERANCE * length
        parts.scheme[: len(scheme.weights), 0] = scheme.weights
        parts.scheme[: len(scheme.fractions), 1] = scheme.fractions

    def advance(self, start: Start, wrenches: Array, on_links: Mapping[str, Array]) -> Stepped:
        """Advance by one period with wrenches held; see ``Simulator.step``."""
        parts = self._parts
        if wrenches.shape != parts.wrenches.shape:
            rule = f"must have shape {parts.wrenches.shape}"
            raise InvalidInputError("wrenches", wrenches.shape, rule)
        parts.q0[:] = start.q
        parts.v0[:] = start.v
        parts.wrenches[:] = wrenches
        self._integrate_all(start, on_links)
        packed = self._project_all(start.active)
        state, nq = parts.state.copy(), self._compiled.nq
        closing = CompiledClosing(packed, self._compiled.nv, self._compiled.chosen(start.active).m)
        work_in, lost, _ = parts.account.tolist()
        return Stepped(state[:nq], state[nq:], closing.error, closing, work_in, lost)

    def _integrate_all(self, start: Start, on_links: Mapping[str, Array]) -> None:
        mechanism, parts, chosen = self._compiled, self._parts, self._compiled.chosen(start.active)
        model, data = mechanism.model, mechanism.data
        q, v = start.q, start.v
        packed, bias_force = _known(start)
        for stage in self._stages:
            if on_links or self._pushed:
                self._push(q, on_links)
            known = packed is not None
            if packed is None:
                mechanism.place(q)
                packed = chosen.scratch
            if bias_force is None:
                pin.nonLinearEffects(model, data, q, v)
                bias_force = mechanism.bias_force
            code = advance_stage(
                *chosen.constants, *mechanism.placed, bias_force, packed, self._work, stage, known
            )
            if code < 0:
                raise not_finite("rates", parts.v) if code == NOT_FINITE else failure(code)
            q, v, packed, bias_force = parts.q, parts.v, None, None
            if not self._flat:
                q[:] = pin.integrate(model, parts.q0, parts.theta)
                if self._curved:
                    parts.turn[:] = local_rate(model, parts.q0, parts.theta, v)

    def _project_all(self, active: Active) -> Array:
        """Move the state onto the closures, and return the terms found there."""
        mechanism, parts, chosen = self._compiled, self._parts, self._compiled.chosen(active)
        packed = np.empty(chosen.size)
        for _ in range(PROJECTION_ITERATIONS):
            mechanism.place(parts.q)
            code = settle(*chosen.constants, *mechanism.placed, packed, self._work)
            if code == SETTLED:
                return packed
            if code < 0:
                raise not_finite("state", parts.q) if code == NOT_FINITE else failure(code)
            if not self._flat:
                parts.q[:] = pin.integrate(mechanism.model, parts.q, parts.theta)
        closing = CompiledClosing(packed, mechanism.nv, chosen.m)
        refuse_open(mechanism, closing.error, active)
        parts.v[:] = closing.space.closed_rates(parts.v)
        return packed

    def _push(self, q: Array, on_links: Mapping[str, Array]) -> None:
        force = self._parts.on_links
        force[:] = 0.0
        # First, so that what is left by an unknown link is cleared by the next step.
        self._pushed = bool(on_links)
        for link, wrench in on_links.items():
            force += wrench @ self._compiled.link_jacobian(q, link)


def _known(start: Start) -> tuple[Array | None, Array | None]:
    """Return what is known at a step's start: the configuration's terms, and h."""
    if start.terms is not None:
        return cast(CompiledSpace, start.terms.space).packed, start.terms.bias_force
    if start.closing is not None:
        return cast(CompiledClosing, start.closing).packed, None
    return None, None
