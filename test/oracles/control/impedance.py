# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Impedance controller: the device feels as heavy as the mechanism, in the range space of Λ_h⁻¹.

    u_imp = Λ_d X (F + C6 F_h) - (1 - (1 - β) Π) F + Λ_d a_0 + device bias,   F = F_h + C2 F_c

Together with the hand and the contact channel the device then obeys, with C6 = 0,
Λ_d ẍ = Λ_d (X F + a_0) + (1 - β) Π F: it accelerates as the operational point does, and what is
left is the push along constrained directions. X is never inverted.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.loop_stability import force_gain


def impedance_wrench(
    device_inertia: Array,
    inverse_inertia: Array,
    wrench_projector: Array,
    free_acceleration: Array,
    wrench: Array,
    feedforward: float,
    device_bias: Array,
    local_feedback: Array | None = None,
) -> Array:
    """Return u_imp (6,): on the hand, by the device, at the point held, world axes, N and N m.

    Args:
        device_inertia: (6, 6) Λ_d, kg and kg m².
        inverse_inertia: (6, 6) X.
        wrench_projector: (6, 6) Π.
        free_acceleration: (6,) a_0, m/s² and rad/s².
        wrench: (6,) F_h + C2 F_c.
        feedforward: β in [0, 1], share of Π F that is cancelled ahead.
        device_bias: (6,) the device's own Coriolis, gravity and friction wrench.
        local_feedback: (6,) C6 F_h; none if left out.
    """
    gain = force_gain(device_inertia, inverse_inertia, wrench_projector, feedforward)
    answer = gain @ wrench + device_inertia @ free_acceleration + device_bias
    if local_feedback is not None:
        answer = answer + device_inertia @ (inverse_inertia @ local_feedback)
    return np.asarray(answer)
