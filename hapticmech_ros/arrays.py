# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The name of an array's type, for everything that takes or returns one."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
