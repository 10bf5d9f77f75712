"""Whether the springs and dampers of a scene bear the loop's delay: exact for the sampled loop.

With positions frozen, what is between device and operational point obeys

    ë = -A_k e(t - τ) - A_b ė(t - τ),      A_k = Λ_d⁻¹ (k P_c + (1 - Π) C_k) + X C_k

and A_b likewise of the dampers: sampled, held over a period T, and acting d periods after it was
measured. The loop is stable where
all eigenvalues of one period's step are inside the unit circle. The hand is left out: it can only
damp, unless it is stiff itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.measurements import RenderingModel
from hapticmech_ros.mechanism.model import Array

# More periods, or more gain, than anybody asks for.
MOST_PERIODS = 64
MOST_GAIN = 1024.0
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


def loop_terms(control: ControlArchitecture, model: RenderingModel) -> tuple[Array, Array]:
    """Return A_k (6, 6), 1/s², and A_b (6, 6), 1/s, with the springs and dampers of a scene.

    Args:
        control: whose gains.
        model: what the analysis reports at a position.
    """
    gains = control.gains.joint_constraint
    stiffness, damping = control.channels.stiffness, control.channels.damping
    mobility = np.linalg.inv(control.device_inertia)
    free = np.eye(6) - model.balanced_share
    x, projector = model.inverse_inertia, model.constraint_projector
    return (
        mobility @ (gains.stiffness * projector + free * stiffness) + x * stiffness,
        mobility @ (gains.damping * projector + free * damping) + x * damping,
    )


def spectral_radius(stiff: Array, damp: Array, period: float, delay: int, substeps: int) -> float:
    """Return the largest eigenvalue's size of one period's step.

    Args:
        stiff: (n, n) A_k, 1/s².
        damp: (n, n) A_b, 1/s.
        period: s.
        delay: whole periods from measuring to acting.
        substeps: of the device in a period.
    """
    n = len(stiff)
    size = n * (2 + delay)
    step = np.zeros((size, size))
    one = np.eye(n)
    # What a held acceleration adds to the position over semi-implicit steps.
    moved = 0.5 * period**2 * (1.0 + 1.0 / substeps)
    step[:n, :n], step[:n, n : 2 * n] = one, period * one
    step[n : 2 * n, n : 2 * n] = one
    answer = np.hstack((-stiff, -damp))
    if delay == 0:
        step[:n, : 2 * n] += moved * answer
        step[n : 2 * n, : 2 * n] += period * answer
    else:
        step[:n, -n:], step[n : 2 * n, -n:] = moved * one, period * one
        step[2 * n : 3 * n, : 2 * n] = answer
        for k in range(1, delay):
            step[(2 + k) * n : (3 + k) * n, (1 + k) * n : (2 + k) * n] = one
    return float(np.abs(np.linalg.eigvals(step)).max())


def loop_margins(
    control: ControlArchitecture, model: RenderingModel, rows: Array, period: float, delay: int = 1
) -> LoopMargins:
    """Return how far the loop of a scene is from being unstable at a position.

    Args:
        control: of the scene.
        model: what the analysis reports there.
        rows: of a six-vector that the task space has.
        period: s.
        delay: whole periods from measuring to acting.
    """
    stiff, damp = (term[np.ix_(rows, rows)] for term in loop_terms(control, model))

    def stable(gain: float, periods: int) -> bool:
        radius = spectral_radius(gain * stiff, gain * damp, period, periods, control.substeps)
        return radius < 1.0 + ON_CIRCLE

    periods = -1
    while periods < MOST_PERIODS and stable(1.0, periods + 1):
        periods += 1
    low, high = 1.0 / MOST_GAIN, MOST_GAIN
    if stable(high, delay):
        return LoopMargins(periods, high)
    while high > 1.01 * low:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if stable(middle, delay) else (low, middle)
    return LoopMargins(periods, low)
