# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Finds redundant rows of the loop closures, and the mobility that the others leave.

Rows of A = W L⁻ᵀ, scaled to one unit and cut at the solver's rank tolerance, are taken in the
scene's order: a row is redundant if it depends on the rows before. The number of the others is the
solver's rank r; which rows they are depends on the order (T9 of docs/derivations.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.mechanism.closures import ROW_NAMES, Active, LoopClosure
from hapticmech_ros.mechanism.constraint_space import Closing, solve_lower
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.tolerances import SOLVER_RANK_TOLERANCE
from hapticmech_ros.numerics import Array


@dataclass(frozen=True, slots=True)
class ClosureRows:
    """The rows of one active closure.

    Attributes:
        name: of the closure.
        rows: names of its rows, such as ``pin2/x``.
        redundant: those that follow from rows before them.
    """

    name: str
    rows: tuple[str, ...]
    redundant: tuple[str, ...]

    @property
    def wholly_redundant(self) -> bool:
        """Whether the mechanism would be the same without this closure."""
        return len(self.redundant) == len(self.rows)


@dataclass(frozen=True, slots=True)
class Redundancy:
    """Rows, rank and mobility of the active closures at a configuration.

    Attributes:
        rows: m, number of scalar constraints.
        rank: r, number of independent ones, as the solver has it.
        mobility: nv - r, degrees of freedom left for rates; at a singular position more than for
            finite motion.
        closures: active ones, in the scene's order.
        residual_m: largest residual of rows that are lengths, m.
        residual_rad: largest residual of rows that are angles, rad.
    """

    rows: int
    rank: int
    mobility: int
    closures: tuple[ClosureRows, ...]
    residual_m: float
    residual_rad: float

    @property
    def redundant(self) -> tuple[str, ...]:
        """Names of all redundant rows, in the scene's order; m - r of them."""
        return tuple(name for closure in self.closures for name in closure.redundant)

    @property
    def wholly_redundant(self) -> tuple[str, ...]:
        """Names of the closures without which the mechanism would be the same."""
        return tuple(closure.name for closure in self.closures if closure.wholly_redundant)


def redundancy(mechanism: Mechanism, q: Array, active: Active) -> Redundancy:
    """Return which rows of the active closures are redundant at q.

    Args:
        mechanism: whose closures.
        q: (nq,) configuration, on the closures or near.
        active: which closures are closed.

    Raises:
        InvalidInputError: q has a wrong size, or is not finite.
        SingularInertiaError: D is not positive definite.
    """
    checked, _ = mechanism.check_state(q, np.zeros(mechanism.nv))
    closing = mechanism.closing_terms(checked, active)
    loops = [loop for loop, on in zip(mechanism.closures, active, strict=True) if on]
    labels = [tuple(f"{loop.name}/{row}" for row in ROW_NAMES[loop.kind]) for loop in loops]
    names = [name for rows in labels for name in rows]
    in_metres = [row < loop.point_rows for loop in loops for row in range(loop.rows)]
    new = independent(_scaled_rows(mechanism, closing, loops))
    redundant = {name for name, is_new in zip(names, new, strict=True) if not is_new}
    lengths, sizes = np.array(in_metres, dtype=bool), np.abs(closing.residual)
    return Redundancy(
        rows=len(names),
        rank=closing.space.rank,
        mobility=mechanism.nv - closing.space.rank,
        closures=tuple(
            ClosureRows(loop.name, rows, tuple(row for row in rows if row in redundant))
            for loop, rows in zip(loops, labels, strict=True)
        ),
        residual_m=float(sizes[lengths].max(initial=0.0)),
        residual_rad=float(sizes[~lengths].max(initial=0.0)),
    )


def independent(rows: Array) -> list[bool]:
    """Return for each row whether it is independent of those before it.

    Args:
        rows: (m, r) of rank r: r of them are independent. With a threshold of 1/(2√m)
            of the smallest singular value that a kept row may have, those left out are together too
            small to hide a direction.
    """
    count, rank = rows.shape
    if rank == 0:
        return [False] * count
    largest = float(np.linalg.norm(rows, 2))
    threshold = 0.5 * SOLVER_RANK_TOLERANCE * largest / np.sqrt(count)
    basis, found = np.zeros((rank, rank)), 0
    new = []
    for row in rows:
        left = row
        # Twice: the first round's rounding would pass for a separate direction.
        for _ in range(2):
            left = left - basis[:found].T @ (basis[:found] @ left)
        size = float(np.linalg.norm(left))
        new.append(found < rank and size > threshold)
        if new[-1]:
            basis[found] = left / size
            found += 1
    return new


def _scaled_rows(mechanism: Mechanism, closing: Closing, loops: list[LoopClosure]) -> Array:
    """Return (m, r) scaled rows of W L⁻ᵀ, in coordinates of the directions that the solver kept."""
    if not loops:
        return np.zeros((0, 0))
    units = mechanism.row_units([mechanism.closures.index(loop) for loop in loops])
    columns = solve_lower(closing.space.factor, (closing.jacobian / units[:, None]).T)
    return np.asarray((closing.space.basis.T @ columns).T)
