# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Energies at a state, from the terms of a factorisation there, and the account of a step."""

from __future__ import annotations

import math

import numpy as np

from hapticmech_ros.compilation import inner, kernel, put
from hapticmech_ros.compilation.records import Number, Record
from hapticmech_ros.mechanism.kernels.element_kernels import (
    LOWER,
    PULL,
    REST,
    REST_LENGTH,
    STIFFNESS,
    STOP,
    UPPER,
    element_forces,
    element_resistance,
)
from hapticmech_ros.mechanism.kernels.metric_kernels import lift, to_metric
from hapticmech_ros.mechanism.kernels.model import DENSE, Data, Model, Work
from hapticmech_ros.mechanism.kernels.motion_kernels import (
    add_link_forces,
    add_point_forces,
    move_joints,
)
from hapticmech_ros.mechanism.kernels.tree_kernels import CARRIED, bias_force_of, carried_place
from hapticmech_ros.mechanism.tolerances import ENERGY_ROUNDING, UNFELT
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import dot, remove


class Balance(Record):
    """Energy account of a step, J; see :func:`put_balance`.

    Attributes:
        off: energy at the end less that at the start and the work done, plus losses: 0 is exact.
        judged: its size, which is compared with a tolerance.
        made: energy made from nothing.
        exchanged: kinetic energy at both ends, change of the potential one, work and losses;
            :func:`judge` adds ``pushed_energy``.
        rounding: of the potential energies, and an imperceptible energy.
        kinetic: at the end.
        lost: to dampers, friction and stops, and to a rule that damps motions too fast for it.
    """

    off, judged, made, exchanged = Number(), Number(), Number(), Number()
    rounding, kinetic, lost = Number(), Number(), Number()

    def is_within(self, tolerance: float) -> bool:
        """Return whether the step is off by no more than a share of the energy exchanged."""
        return self.judged <= allowed(tolerance, self.exchanged, self.rounding)


BALANCE_SIZE = Balance.layout.size


@inner
def kinetic_energy(model: Model, data: Data, v: Array) -> float:
    """Return ½ vᵀ D v, J, at rates v (nv,)."""
    lifted = model.result[: model.nv]
    put(lifted, v)
    lift(model, data, lifted)
    return 0.5 * dot(lifted, lifted)


@inner
def potential_energy(model: Model, data: Data, q: Array) -> float:
    """Return the energy, J, of weights, springs and stops at q (nq,), and remember it there."""
    if data.tail.potential_energy < math.inf:
        return float(data.tail.potential_energy)
    gravity, bodies, total, at = model.gravity, data.bodies, 0.0, model.small[0]
    for joint in range(1, bodies.shape[0]):
        for i in range(3):
            total -= gravity[i] * bodies[joint, 1 + i]
        if model.joint_values[joint, CARRIED] != 0.0:
            carried_place(model.joint_values[joint], data.places[joint], at)
            for i in range(3):
                total += gravity[i] * at[i]
    for row in range(model.elements.shape[0]):
        values, position = model.element_values[row], q[model.elements[row, 1]]
        stretch = position - values[REST]
        entered = max(values[LOWER] - position, position - values[UPPER], 0.0)
        total += 0.5 * (values[STIFFNESS] * stretch * stretch + values[STOP] * entered * entered)
    for row in range(model.springs.shape[0]):
        values = model.spring_values[row]
        a, b = data.poses[model.springs[row, 0]], data.poses[model.springs[row, 1]]
        x, y, z = a[9] - b[9], a[10] - b[10], a[11] - b[11]
        stretch = math.sqrt(x * x + y * y + z * z) - values[REST_LENGTH]
        total += 0.5 * values[PULL] * stretch * stretch
    data.tail.potential_energy = total
    return float(total)


@kernel("float64(Model, Data, float64[::1])")
def weights_and_springs(model: Model, data: Data, q: Array) -> float:
    """Return the potential energy, J, at q.

    Args:
        model: constants of the mechanism.
        data: terms at q; changed: they remember it.
        q: (nq,) configuration.
    """
    return potential_energy(model, data, q)


@inner
def put_balance(
    model: Model,
    first: Data,
    last: Data,
    parts: Work,
    damps: bool,
    work_in: float,
    lost: float,
    out: Balance,
) -> None:
    """Fill ``out`` with the account of the step from ``parts.q0`` to ``parts.q``, J.

    The energy lost is ``lost``. A rule that ``damps`` motions faster than its step does not
    integrate their losses: for it, the energy lost is the missing energy, as far as dampers and
    :func:`_damped_most` explain it.
    """
    moved, stood = kinetic_energy(model, first, parts.v0), potential_energy(model, first, parts.q0)
    moves, stands = kinetic_energy(model, last, parts.v), potential_energy(model, last, parts.q)
    gained = (moves - moved) + (stands - stood) - work_in
    if damps:
        most = lost + _damped_most(model, first, parts, parts.q0, parts.v0)
        most += _damped_most(model, last, parts, parts.q, parts.v)
        lost = min(max(-gained, 0.0), max(most, 0.0))
    off = gained + lost
    out.off, out.lost, out.kinetic = off, lost, moves
    out.made, out.judged = max(off, 0.0), abs(off) if np.isfinite(off) else np.inf
    out.exchanged = moved + moves + abs(stands - stood) + abs(work_in) + abs(lost)
    out.rounding = ENERGY_ROUNDING * (abs(stood) + abs(stands)) + UNFELT


@inner
def _damped_most(model: Model, data: Data, parts: Work, q: Array, v: Array) -> float:
    """Return the energy, J, that an implicit rule may take from motions too fast for its step.

    |L⁻¹ (h² K + h C) v|² + |L⁻¹ h f|², along directions that loops leave free, with f the forces of
    springs, stops, dampers and friction, and K and C their slopes. It exceeds the energy of a mode
    with ω above 1/h, and is the (ω h)⁴th part of a slow one's.
    """
    step, total, force = parts.settings.step, 0.0, model.forces[0]
    for part in range(2):
        if part == 0:
            element_resistance(model, data, q, v, v, step * step, step, force)
        else:
            element_forces(model, data, q, v, force, model.forces[1])
            for c in range(force.size):
                force[c] *= step
        to_metric(model, data, force)
        if model.path == DENSE:
            remove(data.basis, int(data.tail.rank), force, model.along)
        total += dot(force, force)
    return total


@inner
def allowed(tolerance: float, exchanged: float, rounding: float) -> float:
    """Return by how much an account may be off, J; infinite for an infinite tolerance.

    Args:
        tolerance: share of the energy exchanged; infinite for any.
        exchanged: J; 0 at rest without a load, of which an infinite share would be NaN.
        rounding: of the energies, J.
    """
    return math.inf if tolerance == math.inf else tolerance * exchanged + rounding


@inner
def pushed_energy(model: Model, first: Data, parts: Work, external: Array) -> float:
    """Return ½ h² (fᵀD⁻¹f + bᵀD⁻¹b), J: the energy that the step's forces give a free mechanism.

    From rest, with f from outside and b of gravity and inertia. Where forces balance, a mechanism
    at rest exchanges nothing but rounding, and this is the scale of perceptible energies.
    """
    nv, result, bias, motions = model.nv, model.result, model.forces[2], model.motions
    force = result[:nv]
    for c in range(nv):
        force[c] = parts.held[c] + model.effort[c]
    add_point_forces(model, first, parts.wrenches, result)
    if external.shape[0] > 0:
        add_link_forces(model, first, external, result)
    to_metric(model, first, force)
    total = dot(force, force)
    move_joints(model, first, parts.v0, motions)
    bias_force_of(model, first, motions, bias)
    put(force, bias[:nv])
    to_metric(model, first, force)
    step = parts.settings.step
    return float(0.5 * step * step * (total + dot(force, force)))


@kernel("void(Model, Data, Data, Work, float64[:,::1], boolean, float64, float64, Balance)")
def judge(
    model: Model,
    start: Data,
    end: Data,
    parts: Work,
    external: Array,
    damps: bool,
    work_in: float,
    lost: float,
    found: Balance,
) -> None:
    """Fill the account of a step that was done elsewhere, see ``put_balance``.

    Args:
        model: constants of the mechanism.
        start: terms at the start.
        end: terms at the end.
        parts: of the work, with q0 and v0, q and v, and the acting wrenches.
        external: (pushes, 10) wrenches on links; see ``motion_kernels.add_link_forces``.
        damps: see ``put_balance``.
        work_in: J, done in the step.
        lost: J, in damping, friction and stops.
        found: to fill; ``exchanged`` with ``pushed_energy``.
    """
    put_balance(model, start, end, parts, damps, work_in, lost, found)
    found.exchanged += pushed_energy(model, start, parts, external)
