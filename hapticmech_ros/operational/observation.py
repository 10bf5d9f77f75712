# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Result of the analysis of an operational point at a state, as one array.

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
from hapticmech_ros.operational.observe_kernels import (
    COUNT,
    MODEL_SIZE,
    PAST_SIZE,
    WANTED,
    ConstraintTrigger,
    Details,
    Observed,
    count_rigid,
    details_in,
    rates_before,
    remember_state,
)
from hapticmech_ros.operational.results import CompensatedResponse, OperationalAnalysis, Spectrum
from hapticmech_ros.scene.controller import Perception


class Observation:
    """An operational point at a state; its parts are views of one array.

    Args:
        numbers: all of it; see :func:`~hapticmech_ros.operational.observe_kernels.observe_point`.
        rows: (t,) rows of a six-vector that the task space has.
        nv: number of rates.

    Attributes:
        numbers: all of it.
        model: (139,) operational model; F_c in it is zero, for others to fill.
    """

    def __init__(self, numbers: Array, rows: Array, nv: int) -> None:
        self.numbers = numbers
        self.model: Array = numbers[:MODEL_SIZE]
        self._head, self._rows, self._nv = Observed(numbers), rows, nv

    @cached_property
    def _details(self) -> Details:
        return details_in(self.numbers, self._rows.size, self._nv)

    @property
    def s(self) -> Array:
        """(t,) singular values s_i, descending."""
        return self.numbers[: self._rows.size]

    @cached_property
    def analysis(self) -> OperationalAnalysis:
        """Λ_h⁻¹ at the state, and its analysis."""
        head, details = self._head, self._details
        return OperationalAnalysis(
            inverse_inertia=head.now.inverse_inertia,
            spectrum=Spectrum(self.s, *details.directions),
            weights=details.weights,
            constraint_projector=head.constraint_projector,
            wrench_projector=head.wrench_projector,
            free_acceleration=head.now.free_acceleration,
            rows=self._rows,
        )

    @property
    def compensated(self) -> CompensatedResponse:
        """X_τ and a_τ; X and a_0 without delay compensation."""
        return CompensatedResponse(self._head.inverse_inertia, self._head.free_acceleration)

    @cached_property
    def point(self) -> PointKinematics:
        """The operational point's kinematics."""
        head, details = self._head, self._details
        pose = pin.XYZQUATToSE3(np.concatenate((head.position, head.quaternion)))
        return PointKinematics(pose, details.jacobian, details.motion[:6], details.motion[6:])


class ConstraintCounter:
    """Counts directions that are reported as rigid.

    A direction is rigid at first where s <= s_on. It turns rigid once s has stayed at or below s_on
    for the dwell time, and free once it has stayed at or above s_off for it; in between nothing
    changes.

    Args:
        perception: thresholds and dwell time.

    Attributes:
        numbers: all that it knows.
    """

    def __init__(self, perception: Perception) -> None:
        self.numbers = ConstraintTrigger()
        self.numbers.fill(s_on=perception.s_on, s_off=perception.s_off, dwell=perception.dwell)

    def begin(self) -> None:
        """Start anew with the next s."""
        self.numbers.begun = 0.0

    def update(self, s: Array, time: float) -> int:
        """Return the count after s was observed at ``time``.

        Args:
            s: (t,) singular values, descending.
            time: s.
        """
        return count_rigid(self.numbers, np.ascontiguousarray(s, dtype=float), time)


def rigid_count(s: Array, perception: Perception) -> int:
    """Return the count of a configuration by itself: directions with s at most s_on.

    Args:
        s: (t,) singular values, descending.
        perception: its thresholds.
    """
    return int(np.count_nonzero(s <= perception.s_on))


# Rates from this many times longer ago than wanted are not used; and so much of a period may be
# missing.
FARTHEST, MISSING = 2.0, 0.25


class PastRates:
    """Remembers rates, and returns those of a number of periods ago.

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
        """Return (1 + nv,) how long before a time, s, and the rates then.

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
