# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a controller says of its engagements: each change, but no more than a few lines a second."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hapticmech_ros.times import NANOSECONDS

PERIOD_S = 1.0
_PERIOD_NS = round(PERIOD_S * NANOSECONDS)


class EngagementLog:
    """Says when a controller engages and disengages.

    On a machine that stalls, rendering ends and resumes many times a second. Inputs that are lost
    within a second of the last that was said are counted, and told by :meth:`tell`.

    Args:
        logger: returns the node's.
        now_ns: returns the time, ns.
    """

    def __init__(self, logger: Callable[[], Any], now_ns: Callable[[], int]) -> None:
        self._logger, self._now_ns = logger, now_ns
        self._said_ns: int | None = None
        self._untold, self._explained, self._reason, self._engaged = 0, 0, "", False

    def engaged(self, explanation: str = "") -> None:
        """Say that the controller is engaged, unless it is told later why it was not.

        Args:
            explanation: what explains the last loss, if that has become known since; else empty.
        """
        self._engaged = True
        if not self._untold:
            self._logger().info(f"engaged: {explanation}" if explanation else "engaged")
        elif explanation:
            self._explained, self._reason = self._explained + 1, f"{self._reason}: {explanation}"

    def lost(self, reason: str, explanation: str = "") -> None:
        """Say that the controller is disengaged because of inputs, now or later.

        Args:
            reason: what is lost.
            explanation: the pause of a process that explains it, if one is known; else empty.
        """
        self._engaged, now = False, self._now_ns()
        if explanation:
            reason = f"{reason}: {explanation}"
        if self._said_ns is not None and now - self._said_ns < _PERIOD_NS:
            self._untold, self._reason = self._untold + 1, reason
            self._explained += bool(explanation)
            return
        self._said_ns = now
        self._logger().warning(f"disengaged: {reason}")

    def fault(self, reason: str) -> None:
        """Say that the controller is disengaged because it must not render."""
        self._engaged = False
        self._logger().warning(f"disengaged: {reason}")

    def stopped(self, reason: str) -> None:
        """Say that the controller is disengaged because somebody wants it so."""
        self._engaged = False
        self._logger().info(f"disengaged: {reason}")

    def tell(self) -> None:
        """Say what has not been said; to be called once in ``PERIOD_S``."""
        if not self._untold:
            return
        state = "engaged" if self._engaged else "disengaged"
        times = f"{self._untold} more time{'s' * (self._untold > 1)}"
        if self._explained:
            times += f" ({self._explained} by pauses of a process)"
        self._logger().warning(f"disengaged {times}, the last: {self._reason}; now {state}")
        self._untold, self._explained, self._said_ns = 0, 0, self._now_ns()
