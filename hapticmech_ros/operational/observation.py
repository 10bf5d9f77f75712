# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the analysis of an operational point finds at a state, as one array.

Beside it: the number of joint constraints reported to the user, by a Schmitt trigger with dwell on
each s_i; and rates of a mechanism's last states, for the delay compensation of the next one.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pinocchio as pin

from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import PointKinematics
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import OPERATIONAL_MODEL, Field, Layout
from hapticmech_ros.operational.observe_kernels import (
    BEGUN,
    COUNT,
    COUNTER,
    PAST_SIZE,
    WANTED,
    count_constraints,
    rates_before,
    remember_state,
)
from hapticmech_ros.operational.results import CompensatedResponse, OperationalAnalysis, Spectrum
from hapticmech_ros.scene.controller import Perception

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


class ConstraintCounter:
    """Counts directions that are reported as rigid.

    A direction is rigid at first where s <= s_on. It turns rigid once s has stayed at or below s_on
    for the dwell time, and free once it has stayed at or above s_off for it; in between nothing
    changes.

    Args:
        perception: thresholds and dwell time.

    Attributes:
        numbers: a :data:`~hapticmech_ros.operational.observe_kernels.COUNTER`.
    """

    def __init__(self, perception: Perception) -> None:
        self.numbers: Array = np.zeros(COUNTER.size)
        constants = perception.s_on, perception.s_off, perception.dwell
        self.numbers[COUNTER.slice("s_on", "dwell")] = constants

    def begin(self) -> None:
        """Start anew with the next s."""
        self.numbers[BEGUN] = 0.0

    def update(self, s: Array, time: float) -> int:
        """Return the count after s was observed at ``time``.

        Args:
            s: (t,) singular values, descending.
            time: s.
        """
        return count_constraints(self.numbers, np.ascontiguousarray(s, dtype=float), time)


def rigid_count(s: Array, perception: Perception) -> int:
    """Return the count of a configuration by itself: directions with s at most s_on.

    Args:
        s: (t,) singular values, descending.
        perception: its thresholds.
    """
    return int(np.count_nonzero(s <= perception.s_on))


# Rates as much longer ago than wanted, in periods wanted, say nothing of now; and so much of a
# period may be missing.
FARTHEST, MISSING = 2.0, 0.25


class PastRates:
    """Remembers rates, and tells those of a number of periods ago.

    Args:
        periods: how many, see :func:`~hapticmech_ros.control.loop_delay.periods_before`; 0
            if none are ever wanted.
        period_ns: T, ns.
        size: nv.

    Attributes:
        arrays: for kernels; see :mod:`.observe_kernels`.
    """

    def __init__(self, periods: int, period_ns: int, size: int) -> None:
        remembered = round(FARTHEST * periods) + 2
        numbers = np.zeros(PAST_SIZE, dtype=np.int64)
        wanted = periods * period_ns
        numbers[WANTED:] = wanted, round(MISSING * period_ns), round(FARTHEST * wanted)
        self.arrays: tuple[Array, Array, Array] = (
            numbers,
            np.zeros(remembered, dtype=np.int64),
            np.zeros((remembered, size)),
        )
        self._active: Active | None = None

    def forget(self) -> None:
        """Forget all states: the mechanism may be elsewhere."""
        self.arrays[0][COUNT] = 0

    def add(self, stamp_ns: int, rates: Array, active: Active) -> None:
        """Remember a state.

        Args:
            stamp_ns: its time, ns; not before that of the one before, or those are forgotten.
            rates: (nv,) rad/s or m/s.
            active: which closures are closed; if others than before, those before are forgotten.
        """
        if active != self._active:
            self.forget()
            self._active = active
        remember_state(*self.arrays, stamp_ns, rates)

    def before(self, stamp_ns: int, active: Active) -> Array:
        """Return (1 + nv,) how long before a time, s, and the rates that were.

        They are the newest ones of so many periods ago or longer, of the same closures; zeros where
        there are none.

        Args:
            stamp_ns: the time, ns.
            active: which closures are closed then.
        """
        found = np.zeros(1 + self.arrays[2].shape[1])
        if active == self._active:
            rates_before(*self.arrays, stamp_ns, found)
        return found
