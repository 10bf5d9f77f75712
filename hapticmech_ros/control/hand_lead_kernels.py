# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A hand's wrench in the period to come, and what a device adds to a command for it.

A command is held over a period T and answers the sample F at its start, while what acts on the
device is the mean F̄ of the hand's wrench over the period. By the last three samples, which are h_1
and h_2 apart, and their divided differences,

    F̄ - F = F' + F'',      F' = T/2 F[0,1],      F'' = (T²/3 + T h_1/2) F[0,1,2]

which for even spacing is ½ ∇F + 5/12 ∇²F, as of Adams and Bashforth. The device adds

    W (G F' + (1 + 2 R²)⁻¹ G F''),      R = 1 + G,      W = (1 + (R / 1.35)⁸)⁻¹

with G of :mod:`~hapticmech_ros.control.force_gain`. R is m_d / m along a direction in which a mass
m is felt on a device's m_d. Half a period of delay in the force channel is an error of
ω T/2 (m / m_d - 1). The weight W is that of a Butterworth filter over R: 1 where the mechanism is
heavy, 0 where it is light, because G amplifies there, also what the hand's own mass exerts on the
device, which a whole lead would make unstable. F'' is of use where the mechanism is much heavier.

What K other hands change a command by until the next sample, Δ
(:mod:`~hapticmech_ros.control.other_hands`), is added as

    W (1 - Q)(1 + Q)⁻¹ Δ,      Q = (√K R / 0.98)⁸

whose sign changes where the hands' masses would otherwise drive each other by the devices. With
masses that are fixed to K + 1 equal devices on one body, no loop that is stable without a lead is
unstable with it (``test/control/test_hand_lead.py``).

A memory is an array (22,): the number of samples it has, then three rows, newest first: time since
the sample before, s, and (6,) F_h.
"""

from __future__ import annotations

import math

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, kernel, local, put, shaped
from hapticmech_ros.mechanism.kernels.small_matrices import solve_in_place

ROW, MOST = 7, 3
MEMORY_SIZE = 1 + MOST * ROW
_NEWEST, _SECOND, _THIRD = 1, 1 + ROW, 1 + 2 * ROW
# R at which W is ½, at which F'' has half its weight, and √K R at which other hands have none.
HEAVY, BENT, TOGETHER = 1.35, 0.5**0.5, 0.98
# Beyond what a weight below 1 can do to numbers of several units: no gain of a mechanism.
MOST_GROWTH = 1e6
# 2 cos((2 k + 1) π / 2 n) of 1 + x^2n = Π (x² - 2 cos((2 k + 1) π / 2 n) x + 1).
SECOND, EIGHTH = (
    tuple(2.0 * math.cos((2 * k + 1) * math.pi / (2 * n)) for k in range(n)) for n in (1, 4)
)


@inner
def remember(memory: Array, spacing: float, wrench: Array) -> None:
    """Remember a wrench (6,), ``spacing`` (s) after the last one; see :func:`remember_wrench`."""
    for i in range(MEMORY_SIZE - 1, ROW, -1):
        memory[i] = memory[i - ROW]
    memory[_NEWEST] = spacing
    put(memory[_NEWEST + 1 : _SECOND], wrench)
    memory[0] = min(memory[0] + 1.0, MOST)


@inner
def change_of_mean(memory: Array, start: float, period: float, change: Array) -> None:
    """Fill (12,) how the mean over a period differs from F; see :func:`mean_change`."""
    change[:] = 0.0
    if memory[0] < 2.0:
        return
    # Samples that are closer than a period would amplify their noise.
    first, second = max(memory[_NEWEST], period), max(memory[_SECOND], period)
    end = start + period
    middle = 0.5 * (start + end)
    square = (start * start + start * end + end * end) / 3.0
    for i in range(6):
        newest, before = memory[_NEWEST + 1 + i], memory[_SECOND + 1 + i]
        slope = (newest - before) / first
        change[i] = middle * slope
        if memory[0] > 2.0:
            bend = (slope - (before - memory[_THIRD + 1 + i]) / second) / (first + second)
            change[6 + i] = (square + first * middle) * bend


@inner
def largest(vector: Array) -> float:
    """Return the largest size of six numbers."""
    most = 0.0
    for i in range(6):
        most = max(most, abs(vector[i]))
    return most


@inner
def divide_by_flat(
    ratio: Array, square: Array, scale: float, middles: tuple[float, ...], vector: Array
) -> bool:
    """Replace ``vector`` (6,) by (1 + (R / scale)^2n)⁻¹ vector; return whether that is regular.

    By its n real factors (R / scale)² - 2 cos((2 k + 1) π / 2 n) R / scale + 1, whose condition is
    that of R² only. ``middles`` are twice the n cosines; ``square`` (6, 6) is R².
    """
    factor, most = shaped(local(36), (6, 6)), MOST_GROWTH * largest(vector)
    for k in range(len(middles)):
        for i in range(6):
            for j in range(6):
                factor[i, j] = (square[i, j] / scale - middles[k] * ratio[i, j]) / scale
            factor[i, i] += 1.0
        if not solve_in_place(factor, vector, 6):
            return False
    return largest(vector) <= most


@inner
def multiply(matrix: Array, vector: Array, product: Array) -> None:
    """Fill the product (6,) of a matrix (6, 6) and a vector, which it is not."""
    for i in range(6):
        total = 0.0
        for j in range(6):
            total += matrix[i, j] * vector[j]
        product[i] = total


@inner
def for_others(ratio: Array, square: Array, count: float, carried: Array, added: Array) -> bool:
    """Fill (1 - Q)(1 + Q)⁻¹ Δ (6,) = 2 (1 + Q)⁻¹ Δ - Δ; return whether it is regular."""
    put(added, carried)
    if not divide_by_flat(ratio, square, TOGETHER / math.sqrt(count), EIGHTH, added):
        return False
    for i in range(6):
        added[i] = 2.0 * added[i] - carried[i]
    return True


@inner
def lead(memory: Array, period: float, gain: Array, others: Array, command: Array) -> None:
    """Add what the module says to a command (6,), or nothing where it is not regular.

    ``gain`` (36,) is G row by row, SI units; ``others`` (7,) are Δ and K.
    """
    change, moves = local(12), False
    change_of_mean(memory, 0.0, period, change)
    for i in range(6):
        moves = moves or change[i] != 0.0 or change[6 + i] != 0.0 or others[i] != 0.0
    if not moves:
        return
    own, ratio, square = (
        shaped(gain, (6, 6)),
        shaped(local(36), (6, 6)),
        shaped(local(36), (6, 6)),
    )
    for i in range(6):
        for j in range(6):
            ratio[i, j] = own[i, j]
        ratio[i, i] += 1.0
    for i in range(6):
        for j in range(6):
            total = 0.0
            for k in range(6):
                total += ratio[i, k] * ratio[k, j]
            square[i, j] = total
    added, part = local(6), local(6)
    added[:] = 0.0
    if others[6] > 0.0 and not for_others(ratio, square, others[6], others[:6], added):
        return
    multiply(own, change[6:], part)
    if not divide_by_flat(ratio, square, BENT, SECOND, part):
        return
    for i in range(6):
        added[i] += part[i]
    multiply(own, change[:6], part)
    for i in range(6):
        added[i] += part[i]
    if divide_by_flat(ratio, square, HEAVY, EIGHTH, added):
        for i in range(6):
            command[i] += added[i]


@kernel("void(float64[::1], float64, float64[::1])")
def remember_wrench(memory: Array, spacing: float, wrench: Array) -> None:
    """Remember a sample of a hand's wrench.

    Args:
        memory: (22,) changed; see the module. Zeros at first.
        spacing: s since the sample before; of no meaning for the first one.
        wrench: (6,) F_h, N and N m, world axes.
    """
    remember(memory, spacing, wrench)


@kernel("void(float64[::1], float64, float64, float64[::1])")
def mean_change(memory: Array, start: float, period: float, change: Array) -> None:
    """Fill how the mean of a wrench over a period differs from its newest sample, F' and F''.

    Args:
        memory: (22,) of its samples; see the module.
        start: s, from the newest sample to the period's start.
        period: T, s.
        change: (12,) to fill, F' by the line through two samples, and what the parabola through
            three adds to it, N and N m, world axes; zero where fewer are known.
    """
    change_of_mean(memory, start, period, change)
