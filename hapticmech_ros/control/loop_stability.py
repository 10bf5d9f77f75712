"""Whether the springs and dampers of a scene bear the loop's delay: exact for the sampled loop.

With positions frozen, what is between device and operational point obeys

    ë = -A_k e(t - τ) - A_b ė(t - τ) - N_k e - N_b ė,      A_k = Λ_d⁻¹ (1 - Π) C_k + X C_k,
                                                             N_k = Λ_d⁻¹ k P_c

and A_b, N_b likewise of the dampers: sampled, held over a period T, and what is not closed in the
device acting d periods after it was measured. A joint constraint that is not closed in the device
counts among A. The loop is stable where all eigenvalues of one period's step are inside the unit
circle. The hand is left out: it can only
damp, unless it is stiff itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.measurements import OperationalModel

# More periods, or more gain, than anybody asks for.
MOST_PERIODS = 64
MOST_GAIN = 1024.0
# That a loop should bear: one is always there, and a graph is late now and then.
ENOUGH_PERIODS = 2
# Eigenvalues of rigid motions lie on the circle, up to rounding of their double roots.
ON_CIRCLE = 1e-6


@dataclass(frozen=True, slots=True)
class LoopMargins:
    """How far a loop is from being unstable.

    Attributes:
        periods: most whole periods of delay at which it is stable; -1 if at none.
        gain: factor on stiffnesses and dampings at which it becomes unstable, at the delay given;
            below 1 where it is unstable as it is.
    """

    periods: int
    gain: float

    def warning(self, point: str, period: float, needed: int) -> str | None:
        """Return what is wrong with a loop that bears fewer than the periods needed, or None.

        Args:
            point: its name.
            period: s.
            needed: periods.
        """
        if self.periods >= needed:
            return None
        period_ms = 1e3 * period
        borne = f"{self.periods * period_ms:g} ms" if self.periods >= 0 else "no delay at all"
        return (
            f"at {point} the loop bears {borne}: with one period of {period_ms:g} ms the "
            f"controller's stiffness and damping may be {self.gain:.2g} times as large, no more"
        )


class LoopTerms(NamedTuple):
    """Springs, 1/s², and dampers, 1/s, of a loop, (n, n) each.

    Attributes:
        late: A_k and A_b.
        local: N_k and N_b.
    """

    late: tuple[Array, Array]
    local: tuple[Array, Array]

    def scaled(self, gain: float) -> LoopTerms:
        """Return all of it, so many times as strong."""
        (a, b), (c, d) = self
        return LoopTerms((gain * a, gain * b), (gain * c, gain * d))


def loop_terms(control: ControlArchitecture, model: OperationalModel, rows: Array) -> LoopTerms:
    """Return the springs and dampers of a scene.

    Args:
        control: whose gains.
        model: what the analysis reports at a position.
        rows: of a six-vector that the task space has.
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


def spectral_radius(terms: LoopTerms, period: float, delay: int, substeps: int) -> float:
    """Return the largest eigenvalue's size of one period's step.

    Args:
        terms: springs and dampers.
        period: s.
        delay: whole periods from measuring to acting.
        substeps: of the device in a period.
    """
    (stiff, damp), local = terms
    n = len(stiff)
    size = n * (2 + delay)
    step = np.zeros((size, size))
    one = np.eye(n)
    # What a held acceleration adds to the position over semi-implicit steps.
    moved = 0.5 * period**2 * (1.0 + 1.0 / substeps)
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
    """Return what an answer (n, 2 n) that is held adds to errors and their rates."""
    return np.vstack((moved * answer, period * answer))


def loop_margins(
    control: ControlArchitecture,
    model: OperationalModel,
    rows: Array,
    period: float,
    delay: int = 1,
    most_periods: int = MOST_PERIODS,
) -> LoopMargins:
    """Return how far the loop of a scene is from being unstable at a position.

    Args:
        control: of the scene.
        model: what the analysis reports there.
        rows: of a six-vector that the task space has.
        period: s.
        delay: whole periods from measuring to acting.
        most_periods: at which the search for delays that are borne ends.
    """
    terms = loop_terms(control, model, rows)

    def stable(gain: float, periods: int) -> bool:
        radius = spectral_radius(terms.scaled(gain), period, periods, control.substeps)
        return radius < 1.0 + ON_CIRCLE

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
