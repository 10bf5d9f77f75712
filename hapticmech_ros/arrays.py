"""The name of an array's type, for everything that takes or returns one."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
