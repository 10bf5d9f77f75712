# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How springs, dampers, friction and stops resist change, as matrices of the kernels' functions."""

import numpy as np

from hapticmech_ros.mechanism.kernels.element_kernels import element_resistance, element_slopes
from hapticmech_ros.mechanism.kernels.model import Data, Model


def _parts(mechanism, q):
    closing = mechanism.closing_terms(q, mechanism.initially_active).dense
    active_set = closing.active_set
    return Model(*active_set.constants), Data(active_set.model.numbers, closing.packed)


def slopes(mechanism, q, v, horizon):
    """Return K and C (nv, nv) for an implicit rule that looks ``horizon`` (s) ahead."""
    found = np.full((2, v.size, v.size), np.nan)
    element_slopes(*_parts(mechanism, q), q, v, horizon, *found)
    return found


def tangents(mechanism, q, v):
    """Return K and C (nv, nv), of elastic forces and of all, as they are at a state."""
    parts, found = _parts(mechanism, q), np.full((2, v.size, v.size), np.nan)
    for kind in range(2):
        for rate in np.eye(v.size):
            force = np.full(v.size, np.nan)
            element_resistance(*parts, q, v, rate, 1.0 - kind, float(kind), force)
            found[kind, :, np.flatnonzero(rate)[0]] = force
    return found
