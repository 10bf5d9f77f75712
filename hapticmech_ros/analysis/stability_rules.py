# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rules of the literature for a sampled virtual wall of stiffness K and damping B with a hold.

They apply to one degree of freedom of mass m and physical damping b, held by any passive user. None
of them bounds B; docs/limits.md compares them with sessions.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hapticmech_ros.errors import InvalidInputError


def passive_stiffness(physical: float, damping: float, period: float) -> float:
    """Return the largest K of a passive wall, N/m: b > K T / 2 + |B|. 0 if there is none.

    Colgate and Schenkel, "Passivity of a class of sampled-data systems", J. Robotic Systems 1997.

    Args:
        physical: b of the device, N s/m.
        damping: B of the wall, N s/m.
        period: T, s.

    Raises:
        InvalidInputError: a damping below 0, or a period that is not positive.
    """
    _check(physical, damping, period, 0.0)
    return max(0.0, 2.0 * (physical - abs(damping)) / period)


def delayed_stiffness(physical: float, damping: float, period: float, delay: float) -> float:
    """Return the largest stable K by the rule with delay, N/m: (b + B) / (T / 2 + t_d).

    Gil, Sanchez, Hulin, Preusche and Hirzinger, "Stability boundary for haptic rendering: influence
    of damping and delay", J. Computing and Information Science in Engineering 2009.

    Args:
        physical: b of the device, N s/m.
        damping: B of the wall, N s/m.
        period: T, s.
        delay: t_d, s, from measuring to acting, without the hold.

    Raises:
        InvalidInputError: as :func:`passive_stiffness`, or a delay below 0.
    """
    _check(physical, damping, period, delay)
    return (physical + damping) / (0.5 * period + delay)


def quantised_stiffness(physical: float, friction: float, period: float, step: float) -> float:
    """Return the largest K without a limit cycle by encoder steps, N/m: min(2 b / T, 2 f_c / Δ).

    Diolaiti, Niemeyer, Barbagli and Salisbury, "Stability of haptic rendering: discretization,
    quantization, time delay, and Coulomb effects", IEEE Trans. Robotics 2006.

    Args:
        physical: b of the device, N s/m.
        friction: f_c, Coulomb friction of the device, N.
        period: T, s.
        step: Δ, m; 0 for an ideal encoder.

    Raises:
        InvalidInputError: as :func:`passive_stiffness`, or friction or step below 0.
    """
    _check(physical, friction, period, step)
    by_damping = 2.0 * physical / period
    return by_damping if step == 0.0 else min(by_damping, 2.0 * friction / step)


def lightest_mass(device: float, hand: float) -> float:
    """Return the lower bound of the virtual mass for stability, kg: m_d m_a / (m_d + 2 m_a).

    On a device of mass m_d with a rigidly fixed mass m_a, the force channel responds to
    F_h = -m_a ẍ of one sample with u = (m_d / m_v - 1) F_h in a later one. With (m_d + m_a) ẍ = u
    successive commands are u' = -(m_d / m_v - 1) m_a / (m_d + m_a) u; they decay if the factor is
    inside (-1, 1), for any number of samples of delay.

    Args:
        device: m_d, kg.
        hand: m_a, kg.

    Raises:
        InvalidInputError: a mass below 0, or no device.
    """
    if not (device > 0.0 and hand >= 0.0):
        raise InvalidInputError("masses", (device, hand), "device above 0, hand 0 or more")
    return device * hand / (device + 2.0 * hand)


def _check(first: float, second: float, period: float, other: float) -> None:
    if not (first >= 0.0 and second >= 0.0 and other >= 0.0 and period > 0.0):
        rule = "must be 0 or more, the period above 0"
        raise InvalidInputError("b, B or f_c, T, t_d or Δ", (first, second, period, other), rule)


# Relative resolution for sessions, and for eigenvalues.
RESOLUTION, FINE = 0.01, 1e-4


def frontier(
    stable: Callable[[float], bool],
    guess: float,
    least: float,
    most: float,
    resolution: float = RESOLUTION,
) -> float | None:
    """Return the largest stable value; None if ``least`` is not stable.

    The search goes outward from a guess until a stable and an unstable value are found, and bisects
    between them. If there is only one limit, the result does not depend on the guess.

    Args:
        stable: returns whether a positive value is stable.
        guess: first value to try.
        least: lower end of the search.
        most: upper end; returned if it is stable.
        resolution: relative resolution of the result.

    Raises:
        InvalidInputError: bounds that are not 0 < least < most.
    """
    if not 0.0 < least < most:
        raise InvalidInputError("bounds", (least, most), "must be positive and in order")
    low = high = float(np.clip(guess, least, most))
    step = 1.3
    if stable(low):
        while True:
            if low >= most:
                return most
            high = min(step * low, most)
            if not stable(high):
                break
            low, step = high, step**2
    else:
        while True:
            if high <= least:
                return None
            low = max(high / step, least)
            if stable(low):
                break
            high, step = low, step**2
    while high > (1.0 + resolution) * low:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low
