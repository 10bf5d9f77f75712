# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What resists a device's motion besides viscous damping: end stops, then Coulomb friction.

Both are implicit in the speed at the end of a step h, so that neither adds energy at any stiffness
or friction; g = h / m, or h / I of rotation.

End stop, along the way out n, where d is the distance beyond the limit in the middle of the step:
the force f = k (d + ½ h v⁺) + b v⁺, if positive, gives

    v⁺ = (v - g k d) / (1 + g (b + ½ h k))

without b where the speed turns round, since work is done by the mean of both speeds.

Coulomb friction takes up to g F_c of the speed, never more than there is:

    v⁺ = max(1 - g F_c / |v|, 0) v

A stop is three numbers: limit (m or rad, 0 for none), stiffness and damping.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner
from hapticmech_ros.mechanism.kernels.small_matrices import dot


@inner
def stop(end: Array, away: Array, rate: Array, gain: float, left: float) -> None:
    """Slow a rate (3,) of ``away`` (3,) down at the end of the workspace.

    ``left`` s are left of the step.
    """
    distance = np.sqrt(dot(away, away))
    if distance == 0.0:
        return
    beyond = distance - end[0]
    speed = dot(away, rate) / distance
    if beyond + left * speed <= 0.0:
        return
    pushed = speed - gain * end[1] * beyond
    damping = end[2] if pushed * speed >= 0.0 else 0.0
    after = pushed / (1.0 + gain * (damping + left * end[1]))
    if after < speed:
        for i in range(3):
            rate[i] += (after - speed) / distance * away[i]


@inner
def rub(rate: Array, most: float) -> None:
    """Take ``most`` of a rate (3,) away, or all."""
    speed = np.sqrt(dot(rate, rate))
    share = 0.0 if speed <= most else 1.0 - most / speed
    for i in range(3):
        rate[i] *= share
