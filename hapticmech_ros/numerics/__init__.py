# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays, rotations, small matrices, limits and layouts: what every computation here uses."""

from __future__ import annotations

import numpy as np

# For everything that takes or returns one.
Array = np.ndarray
