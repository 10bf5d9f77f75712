"""Rates that many closures share, at a sparse factorisation's border: a platform's on its legs.

Where every closure reaches places of its own and a few that it shares with others, A = L⁻¹Wᵀ is
[B; P], with B in the band and P at the border (a bordered block-diagonal matrix, dual
block-angular: Golub, Plemmons and Sameh, Parallel block schemes for large-scale least-squares
computations, 1988). With B = Q R and S = P R⁻¹ the motions that the closures leave free are those
of the band's places without pivots, and in the others the columns of [-S, 1]ᵀ, of which Householder
reflections make an orthonormal basis. Reflections of A itself would fill all rows of the band.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, leaf
from hapticmech_ros.mechanism.kernels.data import Data
from hapticmech_ros.mechanism.kernels.model import Model


@inner
def factor_border(data: Data) -> bool:
    """Replace -S in ``data.shares`` (p, 1 + m) by reflections; return whether all are finite.

    Row k is -S's column k behind a 1, that of the unit matrix. The reflection of column k leaves
    the ones of later columns alone.
    """
    shares = data.shares
    for k in range(shares.shape[0]):
        own, square = shares[k], 0.0
        for j in range(1, own.size):
            square += own[j] * own[j]
        if not np.isfinite(square):
            return False
        length = np.sqrt(1.0 + square)
        share = 1.0 / np.sqrt(2.0 * length * (length + 1.0))
        own[0] = (1.0 + length) * share
        for j in range(1, own.size):
            own[j] *= share
        for other in range(k + 1, shares.shape[0]):
            after, along = shares[other], 0.0
            for j in range(1, own.size):
                along += own[j] * after[j]
            along *= 2.0
            for j in range(1, own.size):
                after[j] -= along * own[j]
    return True


@inner
def keep_free(model: Model, data: Data, pivots: Array, turned: Array) -> None:
    """Keep what the closures leave free of a vector, turned by the band's reflections.

    Args:
        model: the mechanism's.
        data: factored.
        pivots: (m,) at the rows' pivots, by ``sequence``; replaced.
        turned: (nv,) by places; those of the border are replaced.
    """
    shares, first = data.shares, model.nv - model.border
    for k in range(shares.shape[0]):
        _reflect(shares, k, first, pivots, turned)
    for j in range(pivots.size):
        pivots[j] = 0.0
    for k in range(shares.shape[0] - 1, -1, -1):
        _reflect(shares, k, first, pivots, turned)


@leaf
def _reflect(shares: Array, k: int, first: int, pivots: Array, turned: Array) -> None:
    along = shares[k, 0] * turned[first + k]
    for j in range(pivots.size):
        along += shares[k, 1 + j] * pivots[j]
    along *= 2.0
    turned[first + k] -= along * shares[k, 0]
    for j in range(pivots.size):
        pivots[j] -= along * shares[k, 1 + j]
