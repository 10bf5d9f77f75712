"""Four-channel teleoperation controller (Lawrence; Hashtrudi-Zaad and Salcudean).

Force channels carry the contact wrench to the hand (C2) and the hand's wrench to the mechanism
(C3). Position channels, a spring and damper C_m = C_s, pull operational point and device together;
on the device's side only in the range of X, since the joint-constraint controller has the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.scene.rendering import ForceChannelGains, PositionChannelGains


@dataclass(frozen=True, slots=True)
class ChannelWrenches:
    """Wrenches of the channels on both sides, world axes, N and N m.

    Attributes:
        device: (6,) on the hand, by the device, at the point held.
        mechanism: (6,) on the mechanism, by the hand, at the operational point.
    """

    device: Array
    mechanism: Array


class FourChannel:
    """Channels with constant gains.

    Attributes:
        stiffness, damping: (6,) of C_m = C_s, N/m, N m/rad and N s/m, N m s/rad.
    """

    def __init__(self, position: PositionChannelGains, force: ForceChannelGains) -> None:
        self.force = force
        self.stiffness = np.array([position.stiffness] * 3 + [position.angular_stiffness] * 3)
        self.damping = np.array([position.damping] * 3 + [position.angular_damping] * 3)

    def wrenches(
        self,
        balanced_share: Array,
        error: Array,
        error_rate: Array,
        hand_wrench: Array,
        contact_wrench: Array,
    ) -> ChannelWrenches:
        """Return both sides' wrenches.

        Args:
            balanced_share: (6, 6) Π.
            error: (6,) e, twist that takes the operational point to the device, m and rad.
            error_rate: (6,) ė.
            hand_wrench: (6,) F_h, by the hand on the device.
            contact_wrench: (6,) F_c, by the environment on the mechanism at the operational point.
        """
        coupling = self.stiffness * error + self.damping * error_rate
        in_range = coupling - balanced_share @ coupling
        return ChannelWrenches(
            device=self.force.contact * contact_wrench - in_range,
            mechanism=self.force.hand * hand_wrench + coupling,
        )
