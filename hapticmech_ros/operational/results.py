"""Λ_h⁻¹ of an operational point at a state, and what follows from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.operational.spectrum import Spectrum


@dataclass(frozen=True, slots=True)
class OperationalAnalysis:
    """Λ_h⁻¹ and what follows from it; world axes, origin at the operational point, force first.

    Attributes:
        inverse_inertia: (6, 6) X; zero in rows a planar scene does not have.
        spectrum: s, μ, rank and directions, on the task's rows only.
        weights: (t,) rigidity w(s_i).
        constraint_projector: (6, 6) P_c.
        balanced_share: (6, 6) Π.
        free_acceleration: (6,) a_0, acceleration of the point with no wrench on it; m/s², rad/s².
        rows: (t,) rows of a six-vector that the task space has.
    """

    inverse_inertia: Array
    spectrum: Spectrum
    weights: Array
    constraint_projector: Array
    balanced_share: Array
    free_acceleration: Array
    rows: Array

    @property
    def rank(self) -> int:
        """Rank of X."""
        return self.spectrum.rank

    @property
    def constraint_wrenches(self) -> Array:
        """Return N_c (6, k): wrenches at the hand that the joints balance entirely."""
        full = np.zeros((6, self.spectrum.s.size - self.rank))
        full[self.rows] = self.spectrum.constraint_wrenches
        return full
