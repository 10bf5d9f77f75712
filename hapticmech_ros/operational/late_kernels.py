"""Kernels of how an operational point answers through a late loop: :mod:`.late_answer`."""

from __future__ import annotations

from hapticmech_ros.compilation import inner, kernel, local, put, shaped
from hapticmech_ros.mechanism.compiled.element_kernels import element_resistance
from hapticmech_ros.mechanism.compiled.metric_kernels import (
    accelerate,
    free_part,
    from_metric,
    to_metric,
)
from hapticmech_ros.mechanism.compiled.motion_kernels import move_point
from hapticmech_ros.mechanism.compiled.packed import Packed, unpack
from hapticmech_ros.mechanism.compiled.small_matrices import (
    cholesky,
    dot,
    dot_rows,
    solve_lower,
)
from hapticmech_ros.mechanism.compiled.tables import Tables
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.operational.foresee_kernels import foresee
from hapticmech_ros.operational.kernels import ANALYSIS_SIZE, FREE, SQUARES

# As in :mod:`~hapticmech_ros.operational.spectrum`, which kernels do not see.
LEAST_S = 1e-10


@inner
def _unit_rates(
    tables: Tables,
    space: Packed,
    jacobian: Array,
    rows: Array,
    s: Array,
    wrenches: Array,
    rates: Array,
) -> None:
    """Fill ``rates`` with ζ (t, nv); zero where X has nothing."""
    t, nv = rows.size, tables.nv
    along = shaped(local(t * nv), (t, nv))
    rates[:] = 0.0
    for i in range(t):
        put(along[i], jacobian[rows[i]])
        to_metric(tables, space, along[i])
        free_part(tables, space, along[i])
        from_metric(tables, space, along[i])
    for i in range(t):
        if s[i] > LEAST_S:
            for k in range(t):
                share = wrenches[k, i] / s[i]
                for c in range(nv):
                    rates[i, c] += share * along[k, c]


@inner
def _answer(
    tables: Tables,
    space: Packed,
    q: Array,
    v: Array,
    bias_force: Array,
    passive: Array,
    bias: Array,
    jacobian: Array,
    index: int,
    rows: Array,
    s: Array,
    details: Array,
    length: float,
    lateness: float,
    ahead: Array,
    late: Array,
) -> None:
    """Fill X_τ, and turn a_0 into a_τ; see :func:`late_point`."""
    t, nv = rows.size, tables.nv
    directions = shaped(details[t:], (2, t, t))
    rates = shaped(local(t * nv), (t, nv))
    _unit_rates(tables, space, jacobian, rows, s, directions[0], rates)
    square = lateness * lateness
    force, resisted, shown = local(nv), shaped(local(36), (t, t)), shaped(local(36), (t, t))
    for j in range(t):
        element_resistance(tables, space, q, v, rates[j], square, lateness, force)
        for i in range(t):
            resisted[i, j] = dot(rates[i], force)
            # Rows are the columns of Zᵀ, each of which is solved with L.
            shown[j, i] = directions[1, j, i] * s[i] if s[i] > LEAST_S else 0.0
        resisted[j, j] += 1.0
    own, met = local(nv + tables.m), local(6)[:t]
    own[:] = 0.0
    accelerate(tables, space, bias_force, passive, bias, own)
    # From here on the tables' room to work in is of another configuration.
    foresee(tables, space, q, v, bias, index, length, lateness, ahead, own, late[36:])
    element_resistance(tables, space, q, v, own[:nv], square, lateness, force)
    for i in range(t):
        met[i] = dot(rates[i], force)
    cholesky(resisted, resisted)
    for j in range(t):
        solve_lower(resisted, shown[j])
    solve_lower(resisted, met)
    late[:36] = 0.0
    inverse_inertia = shaped(late[:36], (6, 6))
    for i in range(t):
        for j in range(i + 1):
            product = dot_rows(shown, i, j)
            inverse_inertia[rows[i], rows[j]] = product
            inverse_inertia[rows[j], rows[i]] = product
        late[36 + rows[i]] -= dot(shown[i], met)


@kernel(
    "void(int64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1],"
    " float64[::1], float64[::1], float64[:,::1], int64, int64[::1], float64[::1], float64[::1],"
    " float64, float64, float64[::1], float64[::1])"
)
def late_point(
    numbers: Array,
    values: Array,
    packed: Array,
    q: Array,
    v: Array,
    bias_force: Array,
    passive: Array,
    bias: Array,
    jacobian: Array,
    index: int,
    rows: Array,
    s: Array,
    details: Array,
    length: float,
    lateness: float,
    ahead: Array,
    late: Array,
) -> None:
    """Fill X_τ and a_τ of an operational point that is analysed.

    Args:
        numbers: constants of the mechanism, whole ones.
        values: the others; see ``tables.fold``.
        packed: terms at the configuration.
        q: (nq,) configuration.
        v: (nv,) rates.
        bias_force: (nv,) h.
        passive: (nv,) forces of springs, dampers, friction and stops, and efforts.
        bias: (m,) Ẇv.
        jacobian: (6, nv) J_h.
        index: number of the operational point.
        rows: (t,) rows of a six-vector that the task space has.
        s: (t,) of the analysis.
        details: (t + 2 t²,) as ``analyse_point`` filled them.
        length: of the mechanism, m.
        lateness: τ, s.
        ahead: as long as ``packed``, to work in.
        late: (42,) X_τ (6, 6) to fill, and a_0 (6,), which becomes a_τ.
    """
    tables = Tables(numbers, values)
    _answer(
        tables,
        unpack(packed, tables),
        q,
        v,
        bias_force,
        passive,
        bias,
        jacobian,
        index,
        rows,
        s,
        details,
        length,
        lateness,
        ahead,
        late,
    )


@kernel(
    "void(int64[::1], float64[::1], float64[::1], float64[::1], float64[::1], int64, int64[::1],"
    " float64[::1], float64, float64, float64[::1], float64[::1])"
)
def see_late(
    numbers: Array,
    values: Array,
    packed: Array,
    q: Array,
    v: Array,
    index: int,
    rows: Array,
    details: Array,
    length: float,
    lateness: float,
    ahead: Array,
    seen: Array,
) -> None:
    """Put X_τ and a_τ where ``see_point`` put X and a_0; it was called before, with the same.

    Args:
        numbers: constants of the mechanism, whole ones.
        values: the others; see ``tables.fold``.
        packed: as ``see_point`` filled it.
        q: (nq,) configuration.
        v: (nv,) rates.
        index: number of the operational point.
        rows: (t,) rows of a six-vector that the task space has.
        details: (t + 2 t²,) as it filled them.
        length: of the mechanism, m.
        lateness: τ, s.
        ahead: as long as ``packed``, to work in.
        seen: (133,) as it filled it, to change.
    """
    tables = Tables(numbers, values)
    space = unpack(packed, tables)
    jacobian, motion, late = shaped(local(6 * tables.nv), (6, tables.nv)), local(12), local(42)
    move_point(tables, space, tables.motions, index, jacobian, motion)
    put(late[36:], seen[FREE:ANALYSIS_SIZE])
    _answer(
        tables,
        space,
        q,
        v,
        tables.forces[0],
        tables.forces[1],
        tables.bias,
        jacobian,
        index,
        rows,
        seen[: rows.size],
        details,
        length,
        lateness,
        ahead,
        late,
    )
    put(seen[SQUARES : SQUARES + 36], late[:36])
    put(seen[FREE:ANALYSIS_SIZE], late[36:])
