# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a command would be for another hand wrench: the force channel, closed in the device.

    u = u(F_h') + G (F_h - F_h'),      G = (1 + C6) Λ_d X - 1 + (1 - β) Π

is the impedance controller's answer to F_h, found from its answer to F_h' some samples before. A
force that is fed forward late acts like a damper of m_d/τ in series with the mass that is felt,
which a heavy mechanism on a light device does not allow; F_h is known where the device is.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array


def force_gain(
    device_inertia: Array,
    inverse_inertia: Array,
    wrench_projector: Array,
    feedforward: float,
    feedback: float = 0.0,
) -> Array:
    """Return G (6, 6), N and N m of the device per N and N m of the hand, world axes.

    Args:
        device_inertia: (6, 6) Λ_d, kg and kg m².
        inverse_inertia: (6, 6) X, 1/kg, 1/(kg m) and 1/(kg m²), world axes at the point.
        wrench_projector: (6, 6) Π; 1, m and 1/m, world axes at the point.
        feedforward: β in [0, 1].
        feedback: C6, local force feedback of the device.
    """
    moved = (1.0 + feedback) * (device_inertia @ inverse_inertia)
    return np.asarray(moved + (1.0 - feedforward) * wrench_projector - np.eye(6))


def lead_gains(gain: Array) -> tuple[Array, Array]:
    """Return G and W G, of F' and F'': how a hand's wrench changes until the next sample.

    W = (1 + 2 R²)⁻¹ (1 - 8/5 R²) with R = 1 + G, of a device whose user is the only one; see
    :mod:`~hapticmech_ros.control.hand_lead_kernels`.

    Args:
        gain: (n, n) G, or its rows and columns of the task space.
    """
    one = np.eye(len(gain))
    square = np.linalg.matrix_power(one + gain, 2)
    return gain, np.linalg.solve(one + 2.0 * square, (one - 1.6 * square) @ gain)
