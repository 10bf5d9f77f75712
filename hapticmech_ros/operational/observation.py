# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the analysis of an operational point finds at a state, as one array."""

from __future__ import annotations

from functools import cached_property

import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.layout import OPERATIONAL_MODEL, Field, Layout
from hapticmech_ros.mechanism.evaluation import PointKinematics
from hapticmech_ros.operational.delay_compensation import CompensatedResponse
from hapticmech_ros.operational.results import OperationalAnalysis
from hapticmech_ros.operational.spectrum import Spectrum

_FREE = OPERATIONAL_MODEL.slice("free_acceleration")
_X, _P_C, _SHARE = (
    OPERATIONAL_MODEL.slice(name)
    for name in ("inverse_inertia", "constraint_projector", "wrench_projector")
)
_PLACE = OPERATIONAL_MODEL.slice("position", "quaternion")


def observation_layout(rows: int, nv: int) -> Layout:
    """Return how an observation is laid out.

    The operational model, with X_τ and a_τ in place of X and a_0 (equal at τ = 0); X and a_0;
    weights w(s_i), and columns n_i and I_ℓ⁻¹ n_i; J_h, J_h v and J̇_h v. Matrices go row by row.

    Args:
        rows: t, of the task space.
        nv: number of rates.
    """
    return Layout(
        {
            **OPERATIONAL_MODEL.fields,
            "inverse_inertia_now": Field(36),
            "free_acceleration_now": Field(6),
            "weights": Field(rows),
            "directions": Field(rows * rows),
            "duals": Field(rows * rows),
            "jacobian": Field(6 * nv),
            "motion": Field(12),
        }
    )


class Observation:
    """An operational point at a state; what is asked for are views of one array.

    Args:
        numbers: all of it; see :func:`observation_layout`.
        layout: of it.
        rows: (t,) rows of a six-vector that the task space has.
        nv: number of rates.

    Attributes:
        numbers: all of it.
        model: (139,) operational model; F_c in it is zero, for others to fill.
    """

    def __init__(self, numbers: Array, layout: Layout, rows: Array, nv: int) -> None:
        self.numbers = numbers
        self.model: Array = numbers[: OPERATIONAL_MODEL.size]
        self._layout, self._rows, self._nv = layout, rows, nv

    def _part(self, name: str) -> Array:
        return self.numbers[self._layout.slice(name)]

    @property
    def s(self) -> Array:
        """(t,) singular values s_i, descending."""
        return self.numbers[: self._rows.size]

    @cached_property
    def analysis(self) -> OperationalAnalysis:
        """Λ_h⁻¹ at the state, and what follows from it."""
        t = self._rows.size
        found = Spectrum(
            self.s, self._part("directions").reshape(t, t), self._part("duals").reshape(t, t)
        )
        return OperationalAnalysis(
            inverse_inertia=self._part("inverse_inertia_now").reshape(6, 6),
            spectrum=found,
            weights=self._part("weights"),
            constraint_projector=self.numbers[_P_C].reshape(6, 6),
            wrench_projector=self.numbers[_SHARE].reshape(6, 6),
            free_acceleration=self._part("free_acceleration_now"),
            rows=self._rows,
        )

    @property
    def compensated(self) -> CompensatedResponse:
        """X_τ and a_τ; X and a_0 without delay compensation."""
        return CompensatedResponse(self.numbers[_X].reshape(6, 6), self.numbers[_FREE])

    @cached_property
    def point(self) -> PointKinematics:
        """The operational point's kinematics."""
        motion = self._part("motion")
        jacobian = self._part("jacobian").reshape(6, self._nv)
        pose = pin.XYZQUATToSE3(self.numbers[_PLACE])
        return PointKinematics(pose, jacobian, motion[:6], motion[6:])
