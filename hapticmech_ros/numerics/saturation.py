# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Limits of force and torque of a wrench."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import dot


def limited(wrench: Array, force_limit: float, torque_limit: float) -> Array:
    """Return ``wrench`` (6,) with force and torque each shortened to its limit, directions kept.

    Args:
        wrench: (6,) N and N m.
        force_limit: N.
        torque_limit: N m.
    """
    force = float(np.sqrt(wrench[:3] @ wrench[:3]))
    torque = float(np.sqrt(wrench[3:] @ wrench[3:]))
    if force <= force_limit and torque <= torque_limit:
        return wrench
    shortened = wrench.copy()
    if force > force_limit:
        shortened[:3] *= force_limit / force
    if torque > torque_limit:
        shortened[3:] *= torque_limit / torque
    return shortened


@inner
def limit(vector: Array, largest: float) -> None:
    """Shorten a force or a torque (3,) to its limit, its direction kept."""
    length = np.sqrt(dot(vector, vector))
    if length > largest:
        for i in range(3):
            vector[i] *= largest / length
