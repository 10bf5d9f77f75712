"""Why a device must not obey now: an emergency stop, or a second publisher of its commands."""

from __future__ import annotations

from hapticmech_ros.nodes.sources import Sources

STOPPED = "emergency stop"


class CommandGuard:
    """Watches who commands a device.

    Args:
        sources: of the commands.
    """

    def __init__(self, sources: Sources) -> None:
        self._sources = sources
        self.stopped = False

    def forget(self) -> None:
        """Forget who commanded; an emergency stop lasts."""
        self._sources.forget()

    def fault(self, now_ns: int) -> str:
        """Return why the device must not obey; empty if it may."""
        return STOPPED if self.stopped else self._sources.fault(now_ns)
