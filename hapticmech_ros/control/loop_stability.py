# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Delay margin and gain margin of a scene's springs and dampers, exact for the sampled loop.

With positions frozen, the error between device and operational point obeys

    ë = -A_k e(t - τ) - A_b ė(t - τ) - N_k e - N_b ė,      A_k = Λ_d⁻¹ (1 - Π) C_k + X C_k,
                                                             N_k = Λ_d⁻¹ k P_c

and A_b, N_b are defined likewise with the dampers. Wrenches are held over a period T; those of A
act d periods after the measurement, those of N are closed in the device. A joint constraint that
the device does not close belongs to A. The loop is stable if all eigenvalues of the transition
matrix of one period are inside the unit circle. The hand is left out: it adds damping, unless it is
stiff itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.measurements import OperationalModel

# Upper ends of the searches for the margins.
MOST_PERIODS = 64
MOST_GAIN = 1024.0
# Delay margin below which a warning is given: one period is inherent, a graph may add another.
ENOUGH_PERIODS = 2
# Eigenvalues of rigid motions lie on the circle, up to rounding of their double roots.
ON_CIRCLE = 1e-6


@dataclass(frozen=True, slots=True)
class LoopMargins:
    """Stability margins of a loop.

    Attributes:
        periods: delay margin, the most whole periods of delay with which the loop is stable; -1 if
            it is unstable without delay.
        gain: gain margin at the given delay, the factor on stiffness and damping at which the loop
            becomes unstable; below 1 if it is unstable.
    """

    periods: int
    gain: float

    def warning(self, point: str, period: float, needed: int) -> str | None:
        """Return a warning if the delay margin is smaller than needed, else None.

        Args:
            point: name of the operational point.
            period: s.
            needed: required delay margin, periods.
        """
        if self.periods >= needed:
            return None
        period_ms = 1e3 * period
        margin = f"has a delay margin of {self.periods * period_ms:g} ms"
        if self.periods < 0:
            margin = "is unstable even without delay"
        return (
            f"at {point} the loop {margin}: with one period of delay ({period_ms:g} ms) the "
            f"stability limit is {self.gain:.2g} times the controller's stiffness and damping"
        )


class LoopTerms(NamedTuple):
    """Stiffness, 1/s², and damping, 1/s, of a loop, (n, n) each.

    Attributes:
        late: A_k and A_b, which act with delay.
        local: N_k and N_b, which the device closes.
    """

    late: tuple[Array, Array]
    local: tuple[Array, Array]

    def scaled(self, gain: float) -> LoopTerms:
        """Return all terms multiplied by a gain."""
        (a, b), (c, d) = self
        return LoopTerms((gain * a, gain * b), (gain * c, gain * d))


def loop_terms(control: ControlArchitecture, model: OperationalModel, rows: Array) -> LoopTerms:
    """Return the stiffness and damping of a scene's loop.

    Args:
        control: control architecture with the gains.
        model: operational model at a position.
        rows: (t,) indices of the task space's rows in a six-vector.
    """
    position = control.gains.position_channel
    to_mechanism, to_device = position.to_mechanism, position.to_device
    gains = control.gains.joint_constraint
    channels = control.channels
    mobility = np.linalg.inv(control.device_inertia) * control.acts
    free = np.eye(6) - model.wrench_projector
    x, constraint = model.inverse_inertia, mobility @ model.constraint_projector

    def coupling(gain: Array, held: Array) -> Array:
        return np.asarray(to_device * (mobility @ (free * held)) + to_mechanism * (x * gain))

    def part(matrix: Array) -> Array:
        return np.asarray(matrix[np.ix_(rows, rows)])

    late = (
        part(coupling(channels.stiffness, channels.held_stiffness)),
        part(coupling(channels.damping, channels.held_damping)),
    )
    rigid = part(gains.stiffness * constraint), part(gains.damping * constraint)
    if gains.local:
        return LoopTerms(late, rigid)
    nothing = np.zeros_like(rigid[0])
    return LoopTerms((late[0] + rigid[0], late[1] + rigid[1]), (nothing, nothing))


def spectral_radius(terms: LoopTerms, period: float, delay: int) -> float:
    """Return the spectral radius of the transition matrix of one period.

    Args:
        terms: stiffness and damping.
        period: s.
        delay: whole periods from measuring to acting.
    """
    (stiff, damp), local = terms
    n = len(stiff)
    size = n * (2 + delay)
    step = np.zeros((size, size))
    one = np.eye(n)
    # Change of position by a held acceleration.
    moved = 0.5 * period**2
    step[:n, :n], step[:n, n : 2 * n] = one, period * one
    step[n : 2 * n, n : 2 * n] = one
    step[: 2 * n, : 2 * n] += _acting(-np.hstack(local), moved, period)
    answer = -np.hstack((stiff, damp))
    if delay == 0:
        step[: 2 * n, : 2 * n] += _acting(answer, moved, period)
    else:
        step[:n, -n:], step[n : 2 * n, -n:] = moved * one, period * one
        step[2 * n : 3 * n, : 2 * n] = answer
        for k in range(1, delay):
            step[(2 + k) * n : (3 + k) * n, (1 + k) * n : (2 + k) * n] = one
    return float(np.abs(np.linalg.eigvals(step)).max())


def _acting(answer: Array, moved: float, period: float) -> Array:
    """Return the change of errors and their rates by a held acceleration (n, 2 n)."""
    return np.vstack((moved * answer, period * answer))


def loop_margins(
    control: ControlArchitecture,
    model: OperationalModel,
    rows: Array,
    period: float,
    delay: int = 1,
    most_periods: int = MOST_PERIODS,
) -> LoopMargins:
    """Return the delay margin and the gain margin of a scene's loop at a position.

    Args:
        control: control architecture of the scene.
        model: operational model at the position.
        rows: (t,) indices of the task space's rows in a six-vector.
        period: s.
        delay: whole periods from measuring to acting.
        most_periods: at which the search for the delay margin ends.
    """
    terms = loop_terms(control, model, rows)

    def stable(gain: float, periods: int) -> bool:
        return spectral_radius(terms.scaled(gain), period, periods) < 1.0 + ON_CIRCLE

    periods = -1
    while periods < most_periods and stable(1.0, periods + 1):
        periods += 1
    low, high = 1.0 / MOST_GAIN, MOST_GAIN
    if stable(high, delay):
        return LoopMargins(periods, high)
    while high > 1.01 * low:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if stable(middle, delay) else (low, middle)
    return LoopMargins(periods, low)
