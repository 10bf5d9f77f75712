# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Factorisations and solves of matrices with few rows, as loops inside kernels.

Only the order of operations differs from LAPACK's: results agree to rounding.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, leaf, local
from hapticmech_ros.numerics import Array

EPSILON = 2.220446049250313e-16
SWEEPS = 60


@leaf
def dot(a: Array, b: Array) -> float:
    """Return the product of two vectors, summed in order."""
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@leaf
def add_scaled(vector: Array, scale: float, other: Array) -> None:
    """Add ``scale`` times another vector, of the same length or longer."""
    for i in range(vector.size):
        vector[i] += scale * other[i]


@leaf
def put3(target: Array, source: Array) -> None:
    """Copy the first three numbers of a vector."""
    for i in range(3):
        target[i] = source[i]


@leaf
def negate3(vector: Array, out: Array) -> None:
    """Put the first three numbers of a vector, with their signs changed, into ``out``."""
    for i in range(3):
        out[i] = -vector[i]


@leaf
def subtract3(a: Array, b: Array, out: Array) -> None:
    """Put a - b of the first three numbers into ``out``."""
    for i in range(3):
        out[i] = a[i] - b[i]


@leaf
def largest(vector: Array) -> float:
    """Return the largest size of a vector's numbers; 0 of none."""
    most = 0.0
    for i in range(vector.size):
        most = max(most, abs(vector[i]))
    return most


@leaf
def is_zero(vector: Array) -> bool:
    """Return whether all numbers of a vector are zero; NaN is not."""
    zero = True
    for i in range(vector.size):
        zero = zero and vector[i] == 0.0
    return bool(zero)


@leaf
def clear(matrix: Array, columns: int) -> None:
    """Put zero into the first columns."""
    for i in range(matrix.shape[0]):
        for j in range(columns):
            matrix[i, j] = 0.0


@inner
def dot_rows(matrix: Array, i: int, j: int) -> float:
    """Return the product of two rows, in four sums: one after the other takes longer."""
    size = matrix.shape[1]
    first, second, third, fourth = 0.0, 0.0, 0.0, 0.0
    whole = size - size % 4
    for k in range(0, whole, 4):
        first += matrix[i, k] * matrix[j, k]
        second += matrix[i, k + 1] * matrix[j, k + 1]
        third += matrix[i, k + 2] * matrix[j, k + 2]
        fourth += matrix[i, k + 3] * matrix[j, k + 3]
    for k in range(whole, size):
        first += matrix[i, k] * matrix[j, k]
    return (first + second) + (third + fourth)


@leaf
def dot_with_row(matrix: Array, i: int, vector: Array) -> float:
    """Return the product of a row and as many entries of a vector, summed in order."""
    total = 0.0
    for k in range(matrix.shape[1]):
        total += matrix[i, k] * vector[k]
    return total


@leaf
def dot6(a: Array, b: Array) -> float:
    """Return the product of the first six entries, in pairs: one sum after another takes longer."""
    first, second = a[0] * b[0] + a[1] * b[1], a[2] * b[2] + a[3] * b[3]
    return float((first + second) + (a[4] * b[4] + a[5] * b[5]))


@leaf
def cross(a: Array, b: Array, out: Array) -> None:
    """Put a × b into ``out``, which must be neither of them."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@inner
def cholesky(lower: Array, factor: Array) -> int:
    """Fill ``factor`` with L of L Lᵀ given the lower triangle; return the first bad row, or -1.

    A row is bad that leaves a pivot no larger than its rounding. ``factor`` may be ``lower``. Zeros
    at a row's beginning, where D couples nothing, stay zeros of L.
    """
    size = lower.shape[0]
    for i in range(size):
        start = 0
        while start < i and lower[i, start] == 0.0:
            factor[i, start] = factor[start, i] = 0.0
            start += 1
        for j in range(start, i):
            total = lower[i, j]
            for k in range(start, j):
                total -= factor[i, k] * factor[j, k]
            factor[i, j] = total / factor[j, j]
            factor[j, i] = 0.0
        own = lower[i, i]
        total = own
        for k in range(start, i):
            total -= factor[i, k] * factor[i, k]
        if not total > EPSILON * own:
            return i
        factor[i, i] = np.sqrt(total)
    return -1


@inner
def solve_lower(factor: Array, vector: Array) -> None:
    """Replace ``vector`` by L⁻¹ vector."""
    for i in range(vector.size):
        total = vector[i]
        for k in range(i):
            total -= factor[i, k] * vector[k]
        vector[i] = total / factor[i, i]


@inner
def solve_lower_transposed(factor: Array, vector: Array) -> None:
    """Replace ``vector`` by L⁻ᵀ vector."""
    for i in range(vector.size - 1, -1, -1):
        total = vector[i]
        for k in range(i + 1, vector.size):
            total -= factor[k, i] * vector[k]
        vector[i] = total / factor[i, i]


@inner
def solve_in_place(matrix: Array, vector: Array, size: int) -> bool:
    """Replace ``vector`` by matrix⁻¹ vector; return whether it is regular. It is used up.

    By elimination with pivots, of the first rows and columns.
    """
    for i in range(size):
        best = i
        for k in range(i + 1, size):
            if abs(matrix[k, i]) > abs(matrix[best, i]):
                best = k
        if not abs(matrix[best, i]) > 0.0:
            return False
        if best != i:
            for j in range(i, size):
                matrix[i, j], matrix[best, j] = matrix[best, j], matrix[i, j]
            vector[i], vector[best] = vector[best], vector[i]
        for k in range(i + 1, size):
            factor = matrix[k, i] / matrix[i, i]
            if factor != 0.0:
                for j in range(i + 1, size):
                    matrix[k, j] -= factor * matrix[i, j]
                vector[k] -= factor * vector[i]
    for i in range(size - 1, -1, -1):
        total = vector[i]
        for j in range(i + 1, size):
            total -= matrix[i, j] * vector[j]
        vector[i] = total / matrix[i, i]
    return True


@inner
def remove(basis: Array, rank: int, vector: Array, along: Array) -> None:
    """Replace ``vector`` by (1 - U Uᵀ) vector, U's columns being the first ``rank`` rows.

    ``along`` (rank or more,) is used up.
    """
    for i in range(rank):
        along[i] = dot_with_row(basis, i, vector)
    for i in range(rank):
        add_scaled(vector, -along[i], basis[i])


@inner
def orthogonalise(rows: Array, turn: Array) -> bool:
    """Turn rows of a matrix into mutually orthogonal ones, longest first: one-sided Jacobi.

    With rows Aᵀ before, they are (A V)ᵀ = (U diag(σ))ᵀ after, and ``turn`` is Vᵀ: an SVD of A whose
    small singular values are as exact as LAPACK's, and a fraction of its cost at this size.

    Returns:
        Whether it converged; it does not where an entry is not finite.
    """
    count, size = rows.shape
    largest, squares = 0.0, local(count)
    for i in range(count):
        for j in range(count):
            turn[i, j] = 1.0 if i == j else 0.0
        squares[i] = dot_rows(rows, i, i)
        if not np.isfinite(squares[i]):
            return False
        largest = max(largest, squares[i])
    # Rows this short are rounding of the longest one: there is nothing in them to make orthogonal.
    floor = EPSILON * EPSILON * largest
    tolerance = (EPSILON * max(size, 4)) ** 2
    for _ in range(SWEEPS):
        turned = False
        for i in range(count - 1):
            for j in range(i + 1, count):
                p, q = squares[i], squares[j]
                if p <= floor or q <= floor:
                    continue
                both = dot_rows(rows, i, j)
                if both * both <= tolerance * p * q:
                    continue
                turned = True
                zeta = (q - p) / (2.0 * both)
                tangent = 1.0 / (abs(zeta) + np.sqrt(1.0 + zeta * zeta))
                if zeta < 0.0:
                    tangent = -tangent
                cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
                sine = cosine * tangent
                _rotate(rows, i, j, cosine, sine)
                _rotate(turn, i, j, cosine, sine)
                squares[i], squares[j] = dot_rows(rows, i, i), dot_rows(rows, j, j)
        if not turned:
            _longest_first(rows, turn)
            return True
    return False


@inner
def _rotate(rows: Array, i: int, j: int, cosine: float, sine: float) -> None:
    for k in range(rows.shape[1]):
        first, second = rows[i, k], rows[j, k]
        rows[i, k] = cosine * first - sine * second
        rows[j, k] = sine * first + cosine * second


@inner
def _longest_first(rows: Array, turn: Array) -> None:
    count = rows.shape[0]
    for i in range(count - 1):
        best, largest = i, dot_rows(rows, i, i)
        for j in range(i + 1, count):
            square = dot_rows(rows, j, j)
            if square > largest:
                best, largest = j, square
        if best != i:
            _swap(rows, i, best)
            _swap(turn, i, best)


@inner
def _swap(rows: Array, i: int, j: int) -> None:
    for k in range(rows.shape[1]):
        rows[i, k], rows[j, k] = rows[j, k], rows[i, k]
