"""Smooth choice of the constrained directions, for control.

    P_c = Σ w(s_i) n_i n_iᵀ / m_ℓ,       Π = Σ w(s_i) n_i n_iᵀ I_ℓ⁻¹

w falls smoothly from 1 at s_on to 0 at s_off, so both are continuous through changes of rank and
blind to the sign and order of singular vectors. m_ℓ is the metric's mass: a stiffness k multiplied
by P_c is k N/m against pure translation of the link, and the link's own mix of N/m and N m/rad in
other directions.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.operational.spectrum import Spectrum


def rigidity(s: Array, s_on: float, s_off: float) -> Array:
    """Return w(s): 1 up to s_on, 0 from s_off, with continuous first and second derivative."""
    t = np.clip((s_off - s) / (s_off - s_on), 0.0, 1.0)
    return np.asarray(t**3 * (10.0 - 15.0 * t + 6.0 * t**2))


def constraint_projector(spectrum: Spectrum, weights: Array, mass: float) -> Array:
    """Return P_c (t, t), symmetric positive semi-definite; maps a twist error to a wrench shape."""
    return np.asarray((spectrum.wrenches * (weights / mass)) @ spectrum.wrenches.T)


def balanced_share(spectrum: Spectrum, weights: Array) -> Array:
    """Return Π (t, t): the part of a wrench that the joints balance."""
    return np.asarray((spectrum.wrenches * weights) @ spectrum.duals.T)
