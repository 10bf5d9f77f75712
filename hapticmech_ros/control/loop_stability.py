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

The device closes the force channel: it corrects a command for a newer hand wrench.

    u = u(F_h') + G (F_h - F_h'),      G = (1 + C6) Λ_d X - 1 + (1 - β) Π

is the impedance controller's answer to F_h, found from its answer to F_h' some samples before. A
force that is fed forward late acts like a damper of m_d/τ in series with the mass that is felt,
which a heavy mechanism on a light device does not allow; F_h is known where the device is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.measurements import OperationalModel
from hapticmech_ros.numerics import Array


def force_gain(
    device_inertia: Array,
    inverse_inertia: Array,
    wrench_projector: Array,
    feedforward: float,
    feedback: float = 0.0,
) -> Array:
    """Return G (6, 6), N and N m of the device per N and N m of the hand, world axes.

    Args:
        device_inertia: (6, 6) Λ_d, kg and kg m².
        inverse_inertia: (6, 6) X, 1/kg, 1/(kg m) and 1/(kg m²), world axes at the point.
        wrench_projector: (6, 6) Π; 1, m and 1/m, world axes at the point.
        feedforward: β in [0, 1].
        feedback: C6, local force feedback of the device.
    """
    moved = (1.0 + feedback) * (device_inertia @ inverse_inertia)
    return np.asarray(moved + (1.0 - feedforward) * wrench_projector - np.eye(6))


def lead_gains(gain: Array) -> tuple[Array, Array]:
    """Return G and W G, of F' and F'': how a hand's wrench changes until the next sample.

    W = (1 + 2 R²)⁻¹ (1 - 8/5 R²) with R = 1 + G, of a device whose user is the only one; see
    :mod:`~hapticmech_ros.control.account_kernels`.

    Args:
        gain: (n, n) G, or its rows and columns of the task space.
    """
    one = np.eye(len(gain))
    square = np.linalg.matrix_power(one + gain, 2)
    return gain, np.linalg.solve(one + 2.0 * square, (one - 1.6 * square) @ gain)


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
        margin = f"is stable up to a delay of {self.periods * period_ms:g} ms only"
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
