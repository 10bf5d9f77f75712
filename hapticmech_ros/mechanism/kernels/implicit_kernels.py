# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stages of the linearly implicit rule, see :mod:`~hapticmech_ros.mechanism.tableaus`."""

from __future__ import annotations

from typing import NamedTuple

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, shaped
from hapticmech_ros.mechanism.kernels.data import Data
from hapticmech_ros.mechanism.kernels.element_kernels import element_slopes
from hapticmech_ros.mechanism.kernels.model import Model
from hapticmech_ros.mechanism.kernels.small_matrices import (
    cholesky,
    dot_with_row,
    remove,
    solve_lower,
    solve_lower_transposed,
)
from hapticmech_ros.mechanism.kernels.step_kernels import Work, reach
from hapticmech_ros.mechanism.kernels.step_layout import RANK, STEP
from hapticmech_ros.mechanism.tableaus import COUPLED, DIAGONAL, REACHED

IMPLICIT_STAGES: int = len(REACHED)


class Springs(NamedTuple):
    """Springs and dampers linearised at a step's start, and the stages so far.

    Attributes:
        stiffness, damping: (nv, nv) K and C.
        slope: (nv, nv) S = γh C + (γh)² K.
        factor: (nv, nv) lower Cholesky factor of 1 + P L⁻¹ S L⁻ᵀ P.
        turns, gains: (4, nv) k of θ and of v.
        met, moved, force: (nv,) to work on.
        largest: (1,) largest entry of S; 0 where there is no spring and no damper.
    """

    stiffness: Array
    damping: Array
    slope: Array
    factor: Array
    turns: Array
    gains: Array
    met: Array
    moved: Array
    force: Array
    largest: Array


def springs_size(nv: int) -> int:
    """Return the length of an array of springs."""
    return 4 * nv * nv + (2 * IMPLICIT_STAGES + 3) * nv + 1


@inner
def springs_of(work: Array, nv: int) -> Springs:
    """Return the parts of an array of springs, as views."""
    at = 4 * nv * nv
    squares = shaped(work[:at], (4, nv, nv))
    rows = shaped(work[at : at + 2 * IMPLICIT_STAGES * nv], (2, IMPLICIT_STAGES, nv))
    at += 2 * IMPLICIT_STAGES * nv
    return Springs(
        squares[0],
        squares[1],
        squares[2],
        squares[3],
        rows[0],
        rows[1],
        work[at : at + nv],
        work[at + nv : at + 2 * nv],
        work[at + 2 * nv : at + 3 * nv],
        work[at + 3 * nv :],
    )


@inner
def _linearise(model: Model, data: Data, springs: Springs, reach: float) -> int:
    """Fill S and its factor from K and C, seen over γh; return the first bad row, or -1.

    The factor is computed in place: its lower triangle is read before it is written.
    """
    nv, seen, largest = springs.force.size, springs.factor, 0.0
    for i in range(nv):
        for j in range(nv):
            found = reach * springs.damping[i, j] + reach * reach * springs.stiffness[i, j]
            springs.slope[i, j], seen[i, j] = found, found
            largest = max(largest, abs(found))
    springs.largest[0] = largest
    if largest == 0.0:
        return -1
    rank = int(data.tail[RANK])
    for _ in range(2):
        for i in range(nv):
            solve_lower(data.factor, seen[i])
            remove(data.basis, rank, seen[i], model.along)
        for i in range(nv):
            for j in range(i):
                seen[i, j], seen[j, i] = seen[j, i], seen[i, j]
    for i in range(nv):
        seen[i, i] += 1.0
    return cholesky(seen, seen)


@inner
def _answer(model: Model, data: Data, springs: Springs) -> None:
    """Replace ``springs.force`` by x with (D + S) x + Wᵀμ = force and W x = 0."""
    solve_lower(data.factor, springs.force)
    remove(data.basis, int(data.tail[RANK]), springs.force, model.along)
    solve_lower(springs.factor, springs.force)
    solve_lower_transposed(springs.factor, springs.force)
    solve_lower_transposed(data.factor, springs.force)


@inner
def _respond(
    model: Model, data: Data, parts: Work, springs: Springs, stage: int, rates: Array
) -> None:
    """Fill k of θ and v at a stage, from θ̇ and v̇."""
    period, nv = parts.settings[STEP], rates.size
    turn, gain = springs.turns[stage], springs.gains[stage]
    met, moved, force = springs.met, springs.moved, springs.force
    for c in range(nv):
        met[c], moved[c] = 0.0, 0.0
        for j in range(stage):
            met[c] += COUPLED[stage, j] * springs.turns[j, c]
            moved[c] += COUPLED[stage, j] * springs.gains[j, c]
        turn[c], gain[c] = parts.turn[c] + period * moved[c], rates[c]
        met[c] += DIAGONAL * turn[c]
    if springs.largest[0] > 0.0:
        for c in range(nv):
            force[c] = dot_with_row(springs.stiffness, c, met)
            force[c] += dot_with_row(springs.damping, c, moved)
            force[c] = dot_with_row(springs.slope, c, gain) + period * force[c]
        _answer(model, data, springs)
        for c in range(nv):
            gain[c] -= force[c]
    for c in range(nv):
        turn[c] += period * DIAGONAL * gain[c]


@inner
def linearise(model: Model, data: Data, parts: Work, spring_work: Array) -> int:
    """Fill what implicit stages need of the step's start; return the first bad row, or -1."""
    springs = springs_of(spring_work, model.nv)
    step = parts.settings[STEP]
    element_slopes(model, data, parts.q, parts.v, step, springs.stiffness, springs.damping)
    return _linearise(model, data, springs, DIAGONAL * step)


@inner
def aim_implicitly(
    model: Model, start: Data, parts: Work, spring_work: Array, stage: int, rates: Array
) -> None:
    """Add an implicit stage, and set q, v and θ̇ of the next one, or of the end.

    Args:
        model: the mechanism's.
        start: terms at the step's start.
        parts: see :class:`Work`.
        spring_work: see :class:`Springs`.
        stage: its number.
        rates: (nv,) v̇.
    """
    springs = springs_of(spring_work, model.nv)
    _respond(model, start, parts, springs, stage, rates)
    reach(model, parts, springs.turns, springs.gains, REACHED, stage)
