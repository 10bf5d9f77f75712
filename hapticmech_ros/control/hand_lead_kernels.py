# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A hand's wrench in the period to come, and what a device adds to a command for it.

A command is held over a period T and answers the sample F at its start, while what acts on the
device is the mean F̄ of the hand's wrench over the period. By the last three samples, which are h_1
and h_2 apart, and their divided differences,

    F̄ - F = F' + F'',      F' = T/2 F[0,1],      F'' = (T²/3 + T h_1/2) F[0,1,2]

which for even spacing is ½ ∇F + 5/12 ∇²F, as of Adams and Bashforth. The device adds

    G F' + Σ H_j F'_j + W (G F'' + Σ H_j F''_j)
    W = (1 + 2 R²)⁻¹ (1 - 8/5 R²),      R = (K + 1) (1 + G)

with G of :mod:`~hapticmech_ros.control.force_gain`, and H_j and F_j of K other hands, if there are
any (:mod:`~hapticmech_ros.control.other_hands`). Half a period of delay in the force channel would
be an error of ω T/2 (m / m_d - 1) of a mass m that is felt on a device's m_d, which is 1 / (1 + G)
along a direction. Where m is large, W is 1, and what is left is of third order in ω T. Where it is
small, G amplifies, also what a mass of the hand's own exerts on the device, -r u of a command u,
and the whole parabola would make that loop unstable at half the sample rate. There W tends to -4/5,
which attenuates that rate, and leaves an error of second order, 5/12 (1 - W) (ω T)² (m / m_d - 1).
With masses that are rigidly fixed to K + 1 devices on one body, equal or not, no loop that is
stable without F' and F'' is unstable with them (``test/control/test_hand_lead.py``).

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
# Beyond what a weight below 1 can do to numbers of several units: no gain of a mechanism.
_MOST_GROWTH = 1e6


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
def weigh(gain: Array, hands: float, bend: Array) -> bool:
    """Replace ``bend`` (6,) by W bend; return whether that is regular.

    ``gain`` (36,) is G row by row, SI units, and ``hands`` K + 1.
    """
    ratio, factor, solved = shaped(local(36), (6, 6)), shaped(local(36), (6, 6)), local(6)
    for i in range(6):
        solved[i] = bend[i]
        for j in range(6):
            ratio[i, j] = hands * gain[6 * i + j]
        ratio[i, i] += hands
    for i in range(6):
        for j in range(6):
            factor[i, j] = 0.0
            for k in range(6):
                factor[i, j] += ratio[i, k] * ratio[k, j]
            factor[i, j] *= 2.0
        factor[i, i] += 1.0
    if not solve_in_place(factor, solved, 6):
        return False
    if largest(solved) > _MOST_GROWTH * largest(bend):
        return False
    for i in range(6):
        bend[i] = 1.8 * solved[i] - 0.8 * bend[i]
    return True


@inner
def lead(memory: Array, period: float, gain: Array, others: Array, command: Array) -> None:
    """Add what the module says to a command (6,), or nothing where it is not regular.

    ``gain`` (36,) is G row by row, SI units; ``others`` (13,) are both sums over H_j, and K.
    """
    change, line, bend, moves = local(12), local(6), local(6), False
    change_of_mean(memory, 0.0, period, change)
    for i in range(6):
        line[i], bend[i] = others[i], others[6 + i]
        for j in range(6):
            line[i] += gain[6 * i + j] * change[j]
            bend[i] += gain[6 * i + j] * change[6 + j]
        moves = moves or line[i] != 0.0 or bend[i] != 0.0
    if moves and weigh(gain, 1.0 + others[12], bend):
        for i in range(6):
            command[i] += line[i] + bend[i]


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
