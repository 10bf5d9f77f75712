"""Which path a set of closures takes: dense, or sparse in an order that keeps its band narrow."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import reverse_cuthill_mckee

from hapticmech_ros.mechanism.compiled.band_kernels import BEGIN, FIRST, LAST
from hapticmech_ros.mechanism.compiled.chosen import Chosen
from hapticmech_ros.mechanism.compiled.kernels import factor_closures
from hapticmech_ros.mechanism.compiled.packed import views_of
from hapticmech_ros.mechanism.compiled.tables import SPARSE, Tables
from hapticmech_ros.mechanism.model import Array

# Below so many rates the sparse factorisation takes longer than the dense one (docs/benchmarks.md).
MANY_RATES = 24
# Products in a sweep over one rate, and how many times a product inside a band takes as long.
_SWEEP, _IN_BAND = 200.0, 4.0
# Rows that are dropped in other configurations widen the band by a few places.
_SLACK = 4


def sparse_or_dense(dense: Chosen, position: Array) -> Chosen:
    """Return closures with the factorisation that takes less time.

    Args:
        dense: the closures with a dense one.
        position: (nq,) a configuration, to see how wide the band becomes.
    """
    tables = dense.tables
    n, m = float(tables.nv), float(tables.m)
    found = sparse(dense, position) if n >= MANY_RATES else None
    if found is None:
        return dense
    in_band = _IN_BAND * float(np.square(_extents(found.tables)).sum())
    return found if _SWEEP * n + in_band < n**3 / 6.0 + m * n * n / 2.0 + m * m * n else dense


def sparse(dense: Chosen, position: Array) -> Chosen | None:
    """Return closures with a sparse factorisation; None where it cannot be done at a position.

    Arguments are those of :func:`sparse_or_dense`.
    """
    tables = dense.tables
    reaches = _reaches(tables)
    order = _order(tables, reaches)
    trial = Chosen(_in_order(tables, reaches, order, tables.nv), dense)
    packed = np.empty(trial.size)
    if factor_closures(*trial.constants, np.array(position, dtype=float), packed) < 0:
        return None
    width = _width(trial.tables, packed) + _SLACK if tables.m else 0
    return Chosen(_in_order(tables, reaches, order, width), dense)


def _extents(tables: Tables) -> Array:
    """Return (m,) how many places each row reaches over, by ``sequence``."""
    return np.asarray(tables.sequence[:, 2] - tables.sequence[:, 1] + 1, dtype=float)


def _reaches(tables: Tables) -> Array:
    """Return (m, nv) whether a closure row reaches a rate: of its joints, or before them."""
    reaches = np.zeros((tables.m, tables.nv), dtype=bool)
    for row in range(tables.m):
        for joint in _joints_of(tables, row):
            above = joint
            while above > 0:
                parent, first, count = tables.joints[above, :3]
                reaches[row, first : first + count] = True
                above = int(parent)
    return reaches


def _joints_of(tables: Tables, row: int) -> tuple[int, int]:
    closure = int(np.searchsorted(tables.closures[:, 3], row, side="right")) - 1
    a, b = tables.carriers[tables.closures[closure, 1:3]]
    return int(a), int(b)


def _order(tables: Tables, reaches: Array) -> Array:
    """Return (nv,) the place of each rate: as they are, or by Cuthill and McKee."""
    natural = np.arange(tables.nv)
    if not tables.m:
        return natural
    pattern = reaches.astype(np.int64)
    sequence = reverse_cuthill_mckee(csr_matrix(pattern.T @ pattern), symmetric_mode=True)
    places = np.empty(tables.nv, dtype=np.int64)
    places[sequence] = natural
    return min((natural, places), key=lambda order: _spread(reaches, order))


def _spread(reaches: Array, order: Array) -> int:
    """Return the sum of the squares of the rows' extents."""
    spans = [order[row].max() - order[row].min() if row.any() else 0 for row in reaches]
    return int(np.square(spans).sum())


def _in_order(tables: Tables, reaches: Array, order: Array, width: int) -> Tables:
    """Return the tables of a sparse factorisation."""
    spans = [
        (int(order[row].min()), int(order[row].max())) if row.any() else (0, 0) for row in reaches
    ]
    rows = sorted(range(tables.m), key=lambda row: (*spans[row], row))
    sequence = [(row, *spans[row], *_joints_of(tables, row)) for row in rows]
    return tables._replace(
        path=SPARSE,
        width=width,
        order=order,
        sequence=np.array(sequence, dtype=np.int64).reshape(-1, 5),
    )


def _width(tables: Tables, packed: Array) -> int:
    """Return how many places the widest row of a factorisation needs."""
    places, widest = views_of(packed, tables).row_places, 0
    for j in range(tables.m):
        before = places[int(places[j, FIRST]) : j, LAST]
        last = max(int(before.max(initial=-1)), int(tables.sequence[j, 2]))
        widest = max(widest, last - int(places[j, BEGIN]) + 1)
    return widest
