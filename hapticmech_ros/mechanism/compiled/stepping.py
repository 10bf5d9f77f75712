"""One step of a compiled mechanism: few kernels, with Pinocchio's calls in between."""

from __future__ import annotations

from typing import cast

import numpy as np
import pinocchio as pin

from hapticmech_ros.mechanism.compiled.implicit_kernels import advance_implicit_stage, springs_size
from hapticmech_ros.mechanism.compiled.kernels import NOT_FINITE
from hapticmech_ros.mechanism.compiled.mechanism import CompiledMechanism, failure
from hapticmech_ros.mechanism.compiled.packed import ERROR
from hapticmech_ros.mechanism.compiled.settle_kernels import OFF, SETTLED, settle
from hapticmech_ros.mechanism.compiled.space import CompiledClosing, CompiledSpace
from hapticmech_ros.mechanism.compiled.step_kernels import advance_stage, parts_of, work_size
from hapticmech_ros.mechanism.evaluation import Active
from hapticmech_ros.mechanism.integrator import local_rate
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.mechanism.projection import (
    BAUMGARTE_FAILURE,
    PROJECTION_FAILURE,
    PROJECTION_ITERATIONS,
    PROJECTION_TOLERANCE,
    ROUNDING_TOLERANCE,
    refuse_flipped,
    refuse_jump,
    refuse_open,
)
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.mechanism.stepping import Plan, Pushes, Start, Stepped, Stepper, not_finite


class CompiledStepper(Stepper):
    """Steps as :class:`Stepper` does, to rounding, at a fraction of the time."""

    def __init__(self, mechanism: CompiledMechanism, plan: Plan) -> None:
        super().__init__(mechanism, plan)
        self._compiled = mechanism
        nq, nv, points = mechanism.nq, mechanism.nv, len(mechanism.point_names)
        scheme = SCHEMES[plan.integrator]
        self._stages = range(len(scheme.weights))
        self._pushed = False
        self._flat = nq == nv
        self._curved = scheme.corrected and not self._flat
        self._implicit = scheme.implicit
        self._springs = np.zeros(springs_size(nv))
        self._work = np.zeros(work_size(nq, nv, points))
        self._parts = parts = parts_of(self._work, nq, nv)
        fractions = np.array((PROJECTION_TOLERANCE, ROUNDING_TOLERANCE, PROJECTION_FAILURE))
        parts.settings[:2] = plan.period / plan.substeps, scheme.late
        parts.settings[2:5] = fractions * mechanism.length
        parts.settings[5] = plan.baumgarte_rate
        parts.scheme[: len(scheme.weights), 0] = scheme.weights
        parts.scheme[: len(scheme.fractions), 1] = scheme.fractions

    def _substep(self, start: Start, pushes: Pushes) -> Stepped:
        parts = self._parts
        parts.q0[:] = start.q
        parts.v0[:] = start.v
        parts.wrenches[:] = pushes.wrenches
        self._integrate_all(start, pushes)
        packed = self._project_all(start.active)
        state, nq = parts.state.copy(), self._compiled.nq
        closing = CompiledClosing(packed, self._compiled.nv, self._compiled.chosen(start.active).m)
        work_in, lost, *_ = parts.account.tolist()
        return Stepped(state[:nq], state[nq:], closing.error, closing, work_in, lost)

    def _integrate_all(self, start: Start, pushes: Pushes) -> None:
        mechanism, parts, chosen = self._compiled, self._parts, self._compiled.chosen(start.active)
        model, data = mechanism.model, mechanism.data
        pushed = bool(pushes.on_links) or pushes.in_joints is not None
        q, v = start.q, start.v
        packed, bias_force = _known(start)
        first = packed
        for stage in self._stages:
            if pushed or self._pushed:
                self._push(q, pushes)
            known = packed is not None
            if packed is None:
                mechanism.place(q)
                # Implicit rules need the terms of the start until the end.
                packed = np.empty(chosen.size) if self._keeps(stage) else chosen.scratch
            if first is None:
                first = packed
            if bias_force is None:
                pin.nonLinearEffects(model, data, q, v)
                bias_force = mechanism.bias_force
            placed = (*chosen.constants, *mechanism.placed, bias_force, packed)
            if self._implicit:
                code = advance_implicit_stage(
                    *placed, first, self._work, self._springs, stage, known
                )
            else:
                code = advance_stage(*placed, self._work, stage, known)
            if code < 0:
                raise (
                    not_finite("rates", parts.v)
                    if code == NOT_FINITE
                    else failure(code, mechanism.tree)
                )
            q, v, packed, bias_force = parts.q, parts.v, None, None
            if not self._flat:
                q[:] = pin.integrate(model, parts.q0, parts.theta)
                if self._curved:
                    parts.turn[:] = local_rate(model, parts.q0, parts.theta, v)

    def _keeps(self, stage: int) -> bool:
        return self._implicit and stage == 0

    def _project_all(self, active: Active) -> Array:
        """Move the state onto the closures, and return the terms found there."""
        mechanism, parts, chosen = self._compiled, self._parts, self._compiled.chosen(active)
        packed = np.empty(chosen.size)
        code = OFF
        for _ in range(PROJECTION_ITERATIONS):
            mechanism.place(parts.q)
            code = settle(*chosen.constants, *mechanism.placed, packed, self._work)
            if code != OFF:
                break
            if not self._flat:
                parts.q[:] = pin.integrate(mechanism.model, parts.q, parts.theta)
        if code < 0:
            raise (
                not_finite("state", parts.q)
                if code == NOT_FINITE
                else failure(code, mechanism.tree)
            )
        if code != SETTLED:
            self._refuse(code, packed, active)
        elif self._plan.baumgarte_rate > 0.0:
            refuse_open(mechanism, packed.item(ERROR), active, BAUMGARTE_FAILURE)
        return packed

    def _refuse(self, code: int, packed: Array, active: Active) -> None:
        """Raise what is wrong with the state that the projection found, if anything is."""
        mechanism, parts, chosen = self._compiled, self._parts, self._compiled.chosen(active)
        closing = CompiledClosing(packed, mechanism.nv, chosen.m)
        if self._plan.baumgarte_rate > 0.0:
            refuse_open(mechanism, closing.error, active, BAUMGARTE_FAILURE)
        else:
            refuse_open(mechanism, closing.error, active)
            refuse_jump(mechanism, float(parts.account[3]), float(parts.account[4]), active)
        pin.updateFramePlacements(mechanism.model, mechanism.data)
        refuse_flipped(mechanism, closing.error, active)
        parts.v[:] = closing.space.closed_rates(parts.v)

    def _push(self, q: Array, pushes: Pushes) -> None:
        force, on_links, in_joints = self._parts.on_links, pushes.on_links, pushes.in_joints
        force[:] = 0.0
        # First, so that what is left by an unknown link is cleared by the next step.
        self._pushed = bool(on_links) or in_joints is not None
        if in_joints is not None:
            force += in_joints
        for link, wrench in on_links.items():
            force += wrench @ self._compiled.link_jacobian(q, link)


def _known(start: Start) -> tuple[Array | None, Array | None]:
    """Return what is known at a step's start: the configuration's terms, and h."""
    if start.terms is not None:
        return cast(CompiledSpace, start.terms.space).packed, start.terms.bias_force
    if start.closing is not None:
        return cast(CompiledClosing, start.closing).packed, None
    return None, None
