# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The limit of a force or a torque inside kernels, as :mod:`saturation` has it."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner
from hapticmech_ros.mechanism.kernels.small_matrices import dot


@inner
def limit(vector: Array, largest: float) -> None:
    """Shorten a force or a torque (3,) to its limit, its direction kept."""
    length = np.sqrt(dot(vector, vector))
    if length > largest:
        for i in range(3):
            vector[i] *= largest / length
