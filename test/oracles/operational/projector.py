# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Smooth choice of the constrained directions; see ``operational.results``."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.operational.results import Spectrum


def rigidity(s: Array, s_on: float, s_off: float) -> Array:
    """Return w(s): 1 up to s_on, 0 from s_off, with continuous first and second derivative."""
    t = np.clip((s_off - s) / (s_off - s_on), 0.0, 1.0)
    return np.asarray(t**3 * (10.0 - 15.0 * t + 6.0 * t**2))


def constraint_projector(spectrum: Spectrum, weights: Array, mass: float) -> Array:
    """Return P_c (t, t), symmetric positive semi-definite; maps a twist error to a wrench shape."""
    return np.asarray((spectrum.wrenches * (weights / mass)) @ spectrum.wrenches.T)


def wrench_projector(spectrum: Spectrum, weights: Array) -> Array:
    """Return Π (t, t): the part of a wrench that the joints balance."""
    return np.asarray((spectrum.wrenches * weights) @ spectrum.duals.T)
