# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Four-channel teleoperation controller (Lawrence; Hashtrudi-Zaad and Salcudean).

On the device, and on the mechanism:

    Λ_d ẍ = Λ_d X ((1 + C6) F_h + C2 F_c) + ... - C4 (1 - Π) C e
    f     = C3 F_h + C5 F_c + C1 C e

Force channels carry the contact wrench to the hand (C2) and the hand's wrench to the mechanism
(C3). Position channels, a spring and damper C = C_m = C_s, pull operational point and device
together; on the device's side only in the range of X, since the joint-constraint controller has
the rest. C1 and C4 are shares of C: a local controller goes with its channel. C5 and C6 are local
force feedback. Both sides move alike, which is transparency, where C2 = 1 + C5 = C3 = 1 + C6 and
C1 = C4 = 1; then the mechanism feels 1 / (1 + C6) times as heavy.

With a connection that is late by τ there and back, C's bandwidth ω on the device is held to
ω τ <= 0.3: its stiffness is scaled by the square of a factor and its damping by the factor, so that
it stays as damped. The mechanism's side closes its loop without the connection, and keeps C.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.scene.controller import ForceChannelGains, PositionChannelGains
from hapticmech_ros.scene.gain_rule import DESIGN_PHASE_LAG


class FourChannel:
    """Channels with constant gains; kernels make their wrenches.

    Args:
        position: C, C1 and C4.
        force: C2, C3, C5 and C6.
        inertia: (6,) diagonal of Λ_d, kg and kg m²; needed with a lag.
        lag: s, from measuring to acting, there and back.

    Attributes:
        stiffness, damping: (6,) of C, N/m, N m/rad and N s/m, N m s/rad.
        held_stiffness, held_damping: (6,) of it as it acts on the device.
    """

    def __init__(
        self,
        position: PositionChannelGains,
        force: ForceChannelGains,
        inertia: Array | None = None,
        lag: float = 0.0,
    ) -> None:
        self.position, self.force = position, force
        stiffness = np.array([position.stiffness] * 3 + [position.angular_stiffness] * 3)
        damping = np.array([position.damping] * 3 + [position.angular_damping] * 3)
        share = (
            np.ones(6) if inertia is None else bandwidth_factor(stiffness, damping, inertia, lag)
        )
        self.stiffness, self.damping = stiffness, damping
        self.held_stiffness, self.held_damping = share**2 * stiffness, share * damping


def bandwidth_factor(stiffness: Array, damping: Array, inertia: Array, lag: float) -> Array:
    """Return the factor (6,) that keeps ω τ and its damper's phase lag within 0.3 rad.

    ω and damping are multiplied by it, stiffness by its square.

    Args:
        stiffness: (6,) of C, N/m and N m/rad.
        damping: (6,) of C, N s/m and N m s/rad.
        inertia: (6,) diagonal of Λ_d, kg and kg m².
        lag: τ, s.
    """
    pace = np.maximum(np.sqrt(stiffness / inertia), damping / inertia)
    return np.asarray(DESIGN_PHASE_LAG / np.maximum(pace * lag, DESIGN_PHASE_LAG))
