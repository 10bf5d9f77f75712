# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Energies of the controllers, sample by sample.

E_m   = ∫ f · v dt                       given to the mechanism at its operational point
S     = ½ k eᵀ P_c e + ½ eᵀ C_k e        held in the springs of joint constraint and C
E_inj = Σ ½ eᵀ (Δ(k P_c) + ΔC_k) e       that came by directions and gains that changed
E_b   = ∫ ėᵀ (b P_c + C_b) ė dt          lost in the dampers
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.architecture import FourChannel
from hapticmech_ros.scene.controller import JointConstraintGains


class LedgerEntry(NamedTuple):
    """Energies since rendering started, J.

    Attributes:
        to_mechanism: E_m.
        stored: S, now.
        injected: E_inj.
        dissipated: E_b.
    """

    to_mechanism: float
    stored: float
    injected: float
    dissipated: float


class EnergyLedger:
    """Adds up what flows between the controllers and the mechanism, and what springs take up.

    Attributes:
        entry: as of the last sample.
    """

    def __init__(self) -> None:
        self.entry = LedgerEntry(0.0, 0.0, 0.0, 0.0)
        self._acting = np.zeros(6)
        self._twist: Array | None = None
        self._error: Array | None = None
        self._springs = 0.0, np.zeros((6, 6)), np.zeros(6)

    def moved(self, twist: Array, duration: float) -> None:
        """Account for ``duration`` (s) under the wrench that acts, until the point's twist (6,)."""
        if self._twist is not None:
            middle = 0.5 * float(self._acting @ (self._twist + twist))
            given, stored, injected, dissipated = self.entry
            self.entry = LedgerEntry(given + duration * middle, stored, injected, dissipated)
        self._twist = twist.copy()

    def acts(self, wrench: Array) -> None:
        """Say which wrench (6,) acts on the mechanism from now on."""
        self._acting = wrench

    def answered(
        self,
        error: Array,
        projector: Array,
        joint: JointConstraintGains,
        channels: FourChannel,
        duration: float,
    ) -> None:
        """Account for the springs and dampers of an answer.

        Args:
            error: (6,) e of the answer.
            projector: (6, 6) P_c.
            joint: gains of the joint constraint.
            channels: C, as it is.
            duration: s, since the last answer.
        """
        stored = _energy(error, joint.stiffness, projector, channels.stiffness)
        given, _, injected, dissipated = self.entry
        if self._error is not None and duration > 0.0:
            injected += stored - _energy(error, *self._springs)
            way = error - self._error
            lost = 2.0 * _energy(way, joint.damping, projector, channels.damping)
            dissipated += lost / duration
        self._error, self._springs = error, (joint.stiffness, projector, channels.stiffness)
        self.entry = LedgerEntry(given, stored, injected, dissipated)

    def held_elsewhere(self) -> None:
        """Start springs and motion anew at another point; what has flowed stays in the account."""
        self._acting, self._twist, self._error = np.zeros(6), None, None


def _energy(error: Array, gain: float, projector: Array, channel: Array) -> float:
    """Return ½ eᵀ (gain P_c + C) e, with the diagonal (6,) of C."""
    return 0.5 * (gain * float(error @ (projector @ error)) + float(error @ (channel * error)))
