# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A device renders other hands' wrenches on a mechanism without the delay of the loop.

F_c of a command contains the other hands' wrenches of when their last commands were computed: a
period before the sample that the command answers, and so two periods before the command acts. A
device that has their newest samples F_j corrects its command, as it does for its own hand's:

    u = u' + Σ H_j (F_j(t) - F_j(t' - T)) + Σ H_j F'_j + W Σ H_j F''_j,
    H_j = C2 C3_j (s Λ_d X + r (1 - β) Π) Y_ij

t' is the time of the sample answered, Y_ij F_j the wrench at the own point that accelerates it as
F_j does (:mod:`~hapticmech_ros.operational.analysis`), and C3_j the other's gain to the mechanism.
A command is held over a period: F'_j and F''_j are by how much the mean of F_j over it differs from
F_j(t), and W is the weight that makes no loop unstable
(:mod:`~hapticmech_ros.control.account_kernels`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from hapticmech_ros.compilation import arrays_of
from hapticmech_ros.control import other_hands_kernels as kernels
from hapticmech_ros.control.account_kernels import respond
from hapticmech_ros.control.loop_layout import ControllerSettings, HandsCorrection
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import OperationalModelSample
from hapticmech_ros.scene import Scene

# Samples of another hand that are remembered.
REMEMBERED = 64
# The correction of a command without other hands.
NO_OTHERS = HandsCorrection().values
NO_OTHERS.flags.writeable = False


def received_directly(scene: Scene, point: str, points: Iterable[str]) -> dict[str, float]:
    """Return C3_j of the hands whose wrenches a device gets without delay, by their points.

    Those are of other points, with nothing between device and controller on either side: where
    all messages are late, correcting for two periods gains nothing. The device closes
    the force channel by itself.

    Args:
        scene: with all its ``hands``.
        point: operational point that the device holds.
        points: that are held, or may be.
    """
    own = scene.held_at(point)
    if not (own.connection.direct and own.controller.force_channel.local):
        return {}
    others = {name: scene.held_at(name) for name in points if name != point}
    return {
        name: other.controller.force_channel.hand
        for name, other in others.items()
        if other.connection.direct
    }


def coupling_gain(
    settings: Array, operational_model: Array, time: float, transmitted: Array, share: float
) -> Array:
    """Return H_j (6, 6), see the module: 1, m and 1/m, force before torque, world axes.

    Args:
        settings: (59,) of the controllers, a ``ControllerSettings``.
        operational_model: (139,) of the own point; see ``layout.OperationalModelSample``.
        time: s, of the controllers.
        transmitted: (6, 6) Y_ij, see :func:`~hapticmech_ros.operational.analysis.transmission`.
        share: C3_j.
    """
    response, gains = np.empty((6, 6)), ControllerSettings(settings)
    respond(gains, OperationalModelSample(operational_model), time, response)
    return np.asarray(share * ((gains.c2 * response) @ transmitted))


class OtherHands:
    """Remembers the other hands' wrenches, and corrects commands for their changes.

    Args:
        names: operational points that the others hold.
        period_ns: T, ns.

    Attributes:
        names: as given.
        data: for kernels.
    """

    def __init__(self, names: Iterable[str], period_ns: int) -> None:
        self.names = list(names)
        count = len(self.names)
        parts = {
            "notes": np.zeros(kernels.HandsNotes.layout.size),
            "counts": np.zeros(count),
            "holding": np.zeros(count),
            "stamps": np.zeros((count, REMEMBERED)),
            "wrenches": np.zeros((count * REMEMBERED, 6)),
            "gains": np.zeros((count, kernels.SQUARE)),
        }
        self.data = kernels.HandsData(*arrays_of(kernels.HandsData, {}, parts))
        self.data.notes.period = period_ns

    def forget(self, name: str) -> None:
        """Forget all samples of a hand, by its operational point."""
        self.data.counts[self.names.index(name)] = 0

    def measured(self, name: str, wrench: Array, stamp_ns: int) -> None:
        """Remember a wrench.

        One that is older than the newest is dropped.

        Args:
            name: operational point.
            wrench: (6,) F_j, by the hand, N and N m, world axes at its point.
            stamp_ns: of the sample, ns.
        """
        kernels.remember_hand(self.data, self.names.index(name), stamp_ns, wrench)

    def known_at(self, name: str, stamp_ns: int) -> bool:
        """Return whether a sample of this time, or a later one, has come."""
        data, hand = self.data, self.names.index(name)
        last = int(data.counts[hand]) - 1
        return last >= 0 and bool(data.stamps[hand, last % REMEMBERED] >= stamp_ns)

    def couple(self, gains: Mapping[str, Array], now_ns: int) -> None:
        """Correct for these hands from now on.

        Args:
            gains: H_j (6, 6) by operational point; see the module.
            now_ns: present time, ns.
        """
        data = self.data
        data.notes.coupled = now_ns
        for hand, name in enumerate(self.names):
            data.holding[hand] = name in gains
            if name in gains:
                data.gains[hand] = gains[name].ravel()

    def correction(self, answered_ns: int, now_ns: int) -> Array:
        """Return (19,) a ``HandsCorrection``: sums of H_j, and K; world axes at the own point.

        Args:
            answered_ns: t', stamp of the sample that the command answers, ns.
            now_ns: t, from which it is held, ns.
        """
        found = HandsCorrection()
        kernels.correct_for_hands(self.data, answered_ns, now_ns, found)
        return found.values
