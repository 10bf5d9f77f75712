# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Time-domain passivity of what a robot's contact does to the mechanism that leads it.

    W = Σ T F · (v + v') / 2      energy that the contact has given to the mechanism, net of what
                                  it took; v and v' at the ends of the period in which F acts

An environment that is passive, felt without delay, never makes W positive: what it gives is what
the mechanism gave it. Delays and joints' servos do. As the account of the mechanism's own port
(:mod:`~hapticmech_ros.control.account_kernels`), W is held to an allowance: a wrench that would
give more in the coming period is changed by the least damper -λ M v that gives no more, with M of
1 kg and a lever of 0.1 m. At rest there is no power, and nothing is changed.

A wrench acts from the next sample of the mechanism on. What it gives is known two samples later,
with what it has itself added to v; until then T F · v of the last sample stands for it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.saturation import limited

_METRIC = np.array([1.0, 1.0, 1.0, 0.01, 0.01, 0.01])


@dataclass(frozen=True, slots=True)
class FeedbackSettings:
    """What of a contact acts on the mechanism.

    Attributes:
        period: T, s, for which a wrench is given.
        share: of the contact, 0 to 1.
        force: the largest, N.
        torque: the largest, N m.
        passive: whether W is held to the allowance.
        allowance: J that the contact may give beyond what it took.

    Raises:
        InvalidInputError: one is negative or not finite, a share above 1, or no period.
    """

    period: float
    share: float = 1.0
    force: float = 20.0
    torque: float = 2.0
    passive: bool = True
    allowance: float = 5e-4

    def __post_init__(self) -> None:
        for name in ("period", "share", "force", "torque", "allowance"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InvalidInputError(name, value, "must be a number of 0 or more")
        if self.share > 1.0:
            raise InvalidInputError("share", self.share, "must be at most 1")
        if self.period == 0.0:
            raise InvalidInputError("period", self.period, "must be positive")


class FeedbackPort:
    """Turns contacts of a robot into wrenches on the mechanism that give it no energy of their own.

    Args:
        settings: of it.

    Attributes:
        settings: as above; may be replaced at any time.
        given: W, J.
        dissipated: J that the damper has taken.
        changed: periods in which a wrench was changed.
    """

    def __init__(self, settings: FeedbackSettings) -> None:
        self.settings = settings
        self.given = self.dissipated = 0.0
        self.changed = 0
        self._acted, self._acting, self._twist = np.zeros(6), np.zeros(6), np.zeros(6)

    def begin(self) -> None:
        """Begin a new account."""
        self.given = 0.0
        self._acted, self._acting, self._twist = np.zeros(6), np.zeros(6), np.zeros(6)

    def wrench(self, contact: Array, twist: Array) -> Array:
        """Return the wrench (6,) on the mechanism from its next sample on, N and N m, world axes.

        Args:
            contact: (6,) by the environment on the robot, N and N m, world axes at its point.
            twist: (6,) of the mechanism's operational point now, m/s and rad/s, world axes.
        """
        settings = self.settings
        self.given += 0.5 * settings.period * float(self._acted @ (self._twist + twist))
        found = limited(settings.share * contact, settings.force, settings.torque)
        if settings.passive:
            found = self._held(found, twist)
        self._acted, self._acting, self._twist = self._acting, found, np.array(twist)
        return found

    def _held(self, wrench: Array, twist: Array) -> Array:
        """Return a wrench that keeps W within the allowance, if the twist stays."""
        period = self.settings.period
        power = float(wrench @ twist)
        # What acts by now is not counted yet.
        under_way = max(float(self._acting @ twist), 0.0)
        most = (self.settings.allowance - self.given) / period - under_way
        if power <= max(most, 0.0):
            return wrench
        momentum = _METRIC * twist
        excess = power - max(most, 0.0)
        self.changed += 1
        self.dissipated += period * excess
        return np.asarray(wrench - excess / float(momentum @ twist) * momentum)
