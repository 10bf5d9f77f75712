# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Virtual coupling to a proxy: the same stiff spring and damper in all directions.

    u = -(κ Λ_d e + β Λ_d ė)   on the device,      κ Λ_d e + β Λ_d ė   on the mechanism

It uses neither Λ_h⁻¹ nor force feedforward, and does not distinguish constrained directions. The
hand feels the mechanism through the spring, with the device's inertia added.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.analysis.frontier import FINE, frontier
from hapticmech_ros.analysis.linear_loop import Law
from hapticmech_ros.arrays import Array
from hapticmech_ros.control.architecture import device_inertia
from hapticmech_ros.control.law import LawControl, LawInput
from hapticmech_ros.control.loop_stability import LoopTerms, spectral_radius
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.scene import Scene

# Gain margin of the chosen gains.
GAIN_MARGIN = 2.0
# Candidates for β / κ, in units of the loop's latency (delay + 1/2) T.
RATIOS = np.geomspace(0.5, 8.0, 17)


class ProxyControl(LawControl):
    """A spring and damper between device and operational point.

    Args:
        scene: whose device, limits and ramps are used.
        stiffness: κ, 1/s².
        damping: β, 1/s.

    Raises:
        InvalidInputError: a gain that is negative or not finite.
    """

    def __init__(self, scene: Scene, stiffness: float, damping: float) -> None:
        super().__init__(scene, self._pulled)
        for name, value in (("stiffness", stiffness), ("damping", damping)):
            if not (np.isfinite(value) and value >= 0.0):
                raise InvalidInputError(f"proxy's {name}", value, "must be 0 or more")
        self.spring = stiffness * self.device_inertia
        self.damper = damping * self.device_inertia

    def _pulled(self, seen: LawInput, /) -> tuple[Array, Array]:
        pull = self.spring @ seen.error + self.damper @ seen.rate
        return -pull, pull

    def law(self) -> Law:
        """Return the linear law of this controller."""
        zero = np.zeros((6, 6))
        return Law(zero, self.spring, self.damper, zero, self.spring, self.damper, local=False)


def stiffest_proxy(scene: Scene, found: OperationalAnalysis, delay: int) -> tuple[float, float]:
    """Return κ (1/s²) and β (1/s) of the stiffest proxy with a gain margin of 2.

    With the position frozen ë = -(1 + X Λ_d) (κ e + β ė), delayed; see :func:`stiffest_gains`.

    Args:
        scene: whose device and period are used.
        found: analysis at the position where the loop has to be stable.
        delay: whole periods from measuring to acting.

    Raises:
        InvalidInputError: a delay below 0.
    """
    rows = found.rows
    inertia = device_inertia(scene.device)[np.ix_(rows, rows)]
    loop = np.eye(len(rows)) + found.inverse_inertia[np.ix_(rows, rows)] @ inertia
    return stiffest_gains(scene, loop, delay)


def stiffest_gains(scene: Scene, loop: Array, delay: int) -> tuple[float, float]:
    """Return the largest k and b of a delayed ë = -A (k e + b ė) with a gain margin of 2.

    They are half of the limit gains for the ratio of b to k with the largest stable k.

    Args:
        scene: whose period is used.
        loop: (n, n) A; without unit for k in 1/s² and b in 1/s, in 1/kg for N/m and N s/m.
        delay: whole periods from measuring to acting.

    Raises:
        InvalidInputError: a delay below 0.
    """
    if delay < 0:
        raise InvalidInputError("delay", delay, "must be 0 or more periods")
    period = scene.simulation.period
    latency = (delay + 0.5) * period
    best = (0.0, 0.0)
    for ratio in latency * RATIOS:

        def stable(gain: float, ratio: float = ratio) -> bool:
            late = gain * loop, gain * ratio * loop
            terms = LoopTerms(late, (np.zeros_like(loop), np.zeros_like(loop)))
            return spectral_radius(terms, period, delay) < 1.0

        guess = 0.25 / latency**2 / float(np.trace(loop))
        most = frontier(stable, guess, 1e-6 * guess, 1e3 * guess, FINE)
        if most is not None and most > best[0]:
            best = (most, most * float(ratio))
    return best[0] / GAIN_MARGIN, best[1] / GAIN_MARGIN
