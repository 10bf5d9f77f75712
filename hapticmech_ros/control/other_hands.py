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

from collections import deque
from collections.abc import Iterable, Mapping

import numpy as np

from hapticmech_ros.control.account_kernels import MOST, change_of_mean, remember, respond
from hapticmech_ros.control.loop_layout import (
    ControllerSettings,
    HandMemory,
    HandsCorrection,
    MeanChange,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import OperationalModelSample
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.scene import Scene

# Samples of another hand that are remembered.
REMEMBERED = 64
# After so many periods without a hand's sample nothing is corrected for it; and a period may begin
# at most so many periods after the sample from which its wrench is extrapolated.
SILENT, FARTHEST = 12, 1.0
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
    """

    def __init__(self, names: Iterable[str], period_ns: int) -> None:
        self._period_ns = period_ns
        self._samples: dict[str, deque[tuple[int, Array]]] = {
            name: deque(maxlen=REMEMBERED) for name in names
        }

    def forget(self, name: str) -> None:
        """Forget all samples of a hand, by its operational point."""
        self._samples[name].clear()

    def measured(self, name: str, wrench: Array, stamp_ns: int) -> None:
        """Remember a wrench.

        One that is older than the newest is dropped.

        Args:
            name: operational point.
            wrench: (6,) F_j, by the hand, N and N m, world axes at its point.
            stamp_ns: of the sample, ns.
        """
        samples = self._samples[name]
        if not samples or stamp_ns > samples[-1][0]:
            samples.append((stamp_ns, wrench.copy()))

    def known_at(self, name: str, stamp_ns: int) -> bool:
        """Return whether a sample of this time, or a later one, has come."""
        samples = self._samples[name]
        return bool(samples) and samples[-1][0] >= stamp_ns

    def received(self, name: str, now_ns: int) -> bool:
        """Return whether a hand's wrench is known at a time (ns)."""
        return self._newest(self._samples[name], now_ns) is not None

    def correction(self, gains: Mapping[str, Array], answered_ns: int, now_ns: int) -> Array:
        """Return (19,) a ``HandsCorrection``: sums of H_j, and K; world axes at the own point.

        Args:
            gains: H_j (6, 6) by operational point; see the module.
            answered_ns: t', stamp of the sample that the command answers, ns.
            now_ns: t, from which it is held, ns.
        """
        added = np.zeros((3, 6))
        for name, gain in gains.items():
            added += self._changes(name, answered_ns, now_ns) @ gain.T
        return np.append(added, float(len(gains)))

    def _changes(self, name: str, answered_ns: int, now_ns: int) -> Array:
        """Return (3, 6) F_j(t) - F_j(t' - T), F'_j and F''_j, as far as they are known."""
        samples, period = self._samples[name], self._period_ns
        at = self._newest(samples, now_ns)
        if at is None:
            return np.zeros((3, 6))
        stamp_ns, wrench = samples[at]
        change = wrench - samples[self._nearest(samples, at, answered_ns - period)][1]
        memory, mean = HandMemory(), MeanChange()
        first = max(at + 1 - MOST, 0)
        before_ns = samples[first][0]
        for number in range(first, at + 1):
            known_ns, known = samples[number]
            remember(memory, (known_ns - before_ns) / NANOSECONDS, known)
            before_ns = known_ns
        since = min(now_ns - stamp_ns, FARTHEST * period)
        change_of_mean(memory, since / NANOSECONDS, period / NANOSECONDS, mean)
        return np.array([change, mean.line, mean.bend])

    def _newest(self, samples: deque[tuple[int, Array]], now_ns: int) -> int | None:
        """Return which sample is the newest at a time (ns); None if the hand is silent then."""
        at = len(samples) - 1
        while at >= 0 and samples[at][0] > now_ns:
            at -= 1
        if at < 0 or now_ns - samples[at][0] > SILENT * self._period_ns:
            return None
        return at

    @staticmethod
    def _nearest(samples: deque[tuple[int, Array]], at: int, time_ns: int) -> int:
        """Return which sample, of those up to ``at``, is nearest to a time (ns)."""
        while at > 0 and abs(samples[at - 1][0] - time_ns) <= abs(samples[at][0] - time_ns):
            at -= 1
        return at
