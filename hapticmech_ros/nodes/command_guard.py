# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Why a device must not obey now: an emergency stop, or two where one may command it."""

from __future__ import annotations

from hapticmech_ros.nodes.sources import Sources

STOPPED = "emergency stop"


class CommandGuard:
    """Watches who commands a device.

    Args:
        sources: of each topic by which it is commanded; none may have a second publisher.
    """

    def __init__(self, *sources: Sources) -> None:
        self._sources = sources
        self.stopped = False

    def forget(self) -> None:
        """Forget who commanded; an emergency stop lasts."""
        for one in self._sources:
            one.forget()

    def fault(self, now_ns: int) -> str:
        """Return why the device must not obey; empty if it may."""
        if self.stopped:
            return STOPPED
        return next((fault for one in self._sources if (fault := one.fault(now_ns))), "")
