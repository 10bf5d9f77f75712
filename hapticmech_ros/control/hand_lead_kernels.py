# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A hand's wrench in the period to come, and what a device adds to a command for it.

A command is held over a period T and answers the sample F at its start, while what acts on the
device is the mean F̄ of the hand's wrench over the period. By the last three samples, which are h_1
and h_2 apart, and their divided differences,

    F̄ - F = T/2 F[0,1] + (T²/3 + T h_1/2) F[0,1,2]

which for even spacing is ½ ∇F + 5/12 ∇²F, as of Adams and Bashforth. The device adds

    G W (F̄ - F),      W = (1 + (1 + G)⁶)⁻¹

with G of :mod:`~hapticmech_ros.control.force_gain`. 1 + G is m_d / m along a direction in which a
mass m is felt on a device's m_d. Half a period of delay in the force channel is an error of
ω T/2 (m / m_d - 1): the weight W is 1 where the mechanism is heavy. Where it is light, W is small,
because G amplifies there, also what the hand's own mass exerts on the device, which a whole lead
would make unstable. What other hands change a command by until the next sample, Δ
(:mod:`~hapticmech_ros.control.other_hands`), is added as W (1 - (1 + G)²) Δ: it is none where both
devices are as heavy as the mechanism, because their hands' masses act on each other there.

A memory is an array (22,): the number of samples it has, then three rows, newest first: time since
the sample before, s, and (6,) F_h.
"""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, kernel, local, put, shaped
from hapticmech_ros.mechanism.kernels.small_matrices import solve_in_place

ROW, MOST = 7, 3
MEMORY_SIZE = 1 + MOST * ROW
_NEWEST, _SECOND, _THIRD = 1, 1 + ROW, 1 + 2 * ROW


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
    """Fill (6,) how the mean over a period differs from F; see :func:`mean_change`."""
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
            change[i] += (square + first * middle) * bend


@inner
def multiply_six(a: Array, b: Array, product: Array) -> None:
    """Fill the product (6, 6) of two matrices, which is neither of them."""
    for i in range(6):
        for j in range(6):
            total = 0.0
            for k in range(6):
                total += a[i, k] * b[k, j]
            product[i, j] = total


@inner
def lead(memory: Array, period: float, gain: Array, others: Array, command: Array) -> None:
    """Add W (G (F̄ - F) + (1 - (1 + G)²) others) to a command (6,).

    ``gain`` (36,) is G row by row, SI units.
    """
    change, added, moves = local(6), local(6), False
    change_of_mean(memory, 0.0, period, change)
    for i in range(6):
        moves = moves or change[i] != 0.0 or others[i] != 0.0
    if not moves:
        return
    room = shaped(local(108), (18, 6))
    ratio, square, weight = room[:6], room[6:12], room[12:]
    for i in range(6):
        for j in range(6):
            ratio[i, j] = gain[6 * i + j]
        ratio[i, i] += 1.0
    multiply_six(ratio, ratio, square)
    for i in range(6):
        added[i] = others[i]
        for j in range(6):
            added[i] += gain[6 * i + j] * change[j] - square[i, j] * others[j]
    multiply_six(square, square, ratio)
    multiply_six(ratio, square, weight)
    for i in range(6):
        weight[i, i] += 1.0
    if solve_in_place(weight, added, 6):
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
    """Fill how the mean of a wrench over a period differs from its newest sample, F̄ - F.

    Args:
        memory: (22,) of its samples; see the module.
        start: s, from the newest sample to the period's start.
        period: T, s.
        change: (6,) to fill, N and N m, world axes; zero while only one sample is known.
    """
    change_of_mean(memory, start, period, change)
