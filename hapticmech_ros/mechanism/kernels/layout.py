# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which path a set of closures takes: dense, or sparse in an order that keeps its band narrow.

Rates that many closures share, such as those of a platform on its legs, are left to a border.

A set of active closures: the model that kernels take, dense, and sparse where it is quicker.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hapticmech_ros.mechanism.kernels.band_kernels import BEGIN, FIRST, LAST
from hapticmech_ros.mechanism.kernels.closure_kernels import COUPLING
from hapticmech_ros.mechanism.kernels.factor_kernels import factor
from hapticmech_ros.mechanism.kernels.many_rows import FEW_ROWS
from hapticmech_ros.mechanism.kernels.model import SPARSE, Data, Model, pack
from hapticmech_ros.numerics import Array


class ActiveSet:
    """The constants of a set of active closures, for one kind of factorisation.

    Attributes:
        sizes, parts: the mechanism's constants, with these closures; see ``model.pack``.
        constants: these, packed.
        model: views of the packed ones.
        m: number of closure rows.
        size: length of a packed array.
        dense: the same closures with a dense factorisation; itself, if it is dense.
        redundant: of a sparse one, whether rows follow from others.
    """

    def __init__(
        self,
        sizes: Mapping[str, int],
        parts: Mapping[str, Array],
        dense: ActiveSet | None = None,
        redundant: bool = False,
    ) -> None:
        self.sizes, self.parts = sizes, parts
        self.constants: tuple[Array, Array] = pack(sizes, parts)
        self.model = Model(*self.constants)
        self.m, self.size = self.model.m, self.model.data_size
        self.dense: ActiveSet = self if dense is None else dense
        self.redundant = redundant

    @property
    def is_sparse(self) -> bool:
        """Whether the factorisation is sparse, and may have to be done again by the dense one."""
        return self.dense is not self

    @cached_property
    def scratch(self) -> Array:
        """A packed array (size,) for terms that are not kept."""
        return np.empty(self.size)

    def first_terms(self, known: Array | None, steps: int) -> Array:
        """Return the packed terms (size,) that a kernel begins with: known, or to be filled.

        Args:
            known: (size,) or None; it is copied for many steps, which change it.
            steps: that the kernel does.
        """
        if known is None:
            return np.empty(self.size)
        return known if steps == 1 else known.copy()


# Products that take as long as: a sweep over one rate; one inside a band; one of an SVD, which goes
# over all pairs of rows several times; one of a dense QR, also that of a border.
_SWEEP, _IN_BAND, _IN_SVD, _IN_QR = 200.0, 4.0, 20.0, 4.0
# Redundant rows are left out of a sparse factorisation, and not averaged with the others: off the
# closures, inside a step, that is another mechanism by the order of the distance. Only where a
# dense one would take its time is it worth that.
MANY_RATES = 24
# Rows that are dropped in other configurations widen the band by a few places.
_SLACK = 4


def sparse_or_dense(dense: ActiveSet, position: Array) -> ActiveSet:
    """Return closures with the factorisation that takes less time.

    Args:
        dense: the closures with a dense one.
        position: (nq,) a configuration, to find the band's width, and redundant rows.
    """
    known = dense.model
    if COUPLING in known.closures[:, 0]:
        return dense  # a coupling is no pair of wrenches on two links
    n, m = float(known.nv), float(known.m)
    rows = (_IN_SVD if m <= FEW_ROWS else _IN_QR) * m * m * n
    chain = 6.0 * float(_depths(known).sum())
    if _SWEEP * n > n**3 / 6.0 + m * n * n / 2.0 + rows + chain:
        return dense
    found = sparse(dense, position)
    if found is None or (found.redundant and n < MANY_RATES):
        return dense
    sequence, border = found.model.sequence, found.model.border
    in_band = _cost(sequence[:, 2] - sequence[:, 1] + 1.0, border)
    fewer = _SWEEP * n + in_band < n**3 / 6.0 + m * n * n / 2.0 + rows + chain
    return found if fewer else dense


def sparse(dense: ActiveSet, position: Array) -> ActiveSet | None:
    """Return closures with a sparse factorisation; None where it cannot be done at a position.

    Args:
        dense: the closures with a dense factorisation.
        position: (nq,) configuration.
    """
    model = dense.model
    reaches = _reaches(model)
    start = np.array(position, dtype=float)
    for order in _orders(model, reaches):
        trial = _in_order(dense, reaches, order, model.nv, -1)
        packed = np.empty(trial.size)
        rank = factor(trial.model, start, Data(trial.model.numbers, packed))
        if rank >= 0:
            width = _width(trial, packed) + _SLACK if model.m else 0
            return _in_order(dense, reaches, order, width, rank)
    return None


class _Order(NamedTuple):
    """An order of rates.

    Attributes:
        places: (nv,) the place of each rate.
        border: how many of the last ones are left out of the band.
    """

    places: Array
    border: int


def _depths(model: Model) -> Array:
    """Return (nv,) the number of rates that move each rate's joint, its own included."""
    depths = np.zeros(model.nv)
    before = np.zeros(len(model.joints))
    for joint, (parent, first, count, *_) in enumerate(model.joints.tolist()):
        if joint:
            before[joint] = before[parent] + count
            depths[first : first + count] = before[joint]
    return depths


def _cost(extents: Array, border: int) -> float:
    """Return how many products rows take that reach over (m,) so many places of the band."""
    return float(_IN_BAND * np.square(extents).sum() + _IN_QR * len(extents) * border**2)


def _reaches(model: Model) -> Array:
    """Return (m, nv) whether a closure row reaches a rate: of its joints, or before them."""
    reaches = np.zeros((model.m, model.nv), dtype=bool)
    for row in range(model.m):
        for joint in _joints_of(model, row):
            above = joint
            while above > 0:
                parent, first, count = model.joints[above, :3]
                reaches[row, first : first + count] = True
                above = int(parent)
    return reaches


def _joints_of(model: Model, row: int) -> tuple[int, int]:
    closure = int(np.searchsorted(model.closures[:, 3], row, side="right")) - 1
    a, b = model.carriers[model.closures[closure, 1:3]]
    return int(a), int(b)


def _orders(model: Model, reaches: Array) -> list[_Order]:
    """Return orders that keep the band narrow, that of the least cost first."""
    natural = np.arange(model.nv)
    if not model.m:
        return [_Order(natural, 0)]
    loops = np.searchsorted(model.closures[:, 3], np.arange(model.m), side="right") - 1
    users = np.array([reaches[loops == loop].any(axis=0) for loop in range(len(model.closures))])
    shared = users.sum(axis=0)
    found = {0: _Order(natural, 0)}
    for least in (len(users) + 1, *sorted(set(shared[shared > 1].tolist()))):
        inner = shared < least
        border = int(model.nv - inner.sum())
        # A row at the border alone would have no pivot in the band.
        if not border or reaches[:, inner].any(axis=1).all():
            found[-border - 1] = _narrow(reaches, inner)
    return sorted(found.values(), key=lambda order: _cost(_extents(reaches, order), order.border))


def _narrow(reaches: Array, inner: Array) -> _Order:
    """Return an order by Cuthill and McKee of (nv,) rates in the band; the others follow them."""
    # Imported here: a mechanism of few rates needs no SciPy.
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    band, border = np.flatnonzero(inner), np.flatnonzero(~inner)
    pattern = reaches[:, band].astype(np.int64)
    sequence = reverse_cuthill_mckee(csr_matrix(pattern.T @ pattern), symmetric_mode=True)
    places = np.empty(len(inner), dtype=np.int64)
    places[np.concatenate((band[sequence], border))] = np.arange(len(inner))
    return _Order(places, len(border))


def _spans(reaches: Array, order: _Order) -> list[tuple[int, int]]:
    """Return the first and last place in the band that each row reaches."""
    edge = len(order.places) - order.border
    spans = []
    for row in reaches:
        places = order.places[row]
        places = places[places < edge]
        spans.append((int(places.min()), int(places.max())) if places.size else (0, 0))
    return spans


def _extents(reaches: Array, order: _Order) -> Array:
    """Return (m,) how many places of the band each row reaches over."""
    return np.array([last - first + 1.0 for first, last in _spans(reaches, order)])


def _in_order(
    dense: ActiveSet, reaches: Array, order: _Order, width: int, independent: int
) -> ActiveSet:
    """Return closures with a sparse factorisation; ``independent`` is its rank, -1 for any."""
    model = dense.model
    spans = _spans(reaches, order)
    rows = sorted(range(model.m), key=lambda row: (*spans[row], row))
    sequence = [(row, *spans[row], *_joints_of(model, row)) for row in rows]
    sizes = {"path": SPARSE, "width": width, "border": order.border, "independent": independent}
    ordered = {"order": order.places, "sequence": np.array(sequence).reshape(-1, 5)}
    redundant = 0 <= independent < model.m
    return ActiveSet({**dense.sizes, **sizes}, {**dense.parts, **ordered}, dense, redundant)


def _width(active_set: ActiveSet, packed: Array) -> int:
    """Return how many places the widest row of a factorisation needs."""
    places, widest = Data(active_set.model.numbers, packed).row_places, 0
    for j in range(active_set.m):
        before = places[int(places[j, FIRST]) : j, LAST]
        last = max(int(before.max(initial=-1)), int(active_set.model.sequence[j, 2]))
        widest = max(widest, last - int(places[j, BEGIN]) + 1)
    return widest
