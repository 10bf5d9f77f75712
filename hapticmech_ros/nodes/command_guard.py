"""Why a device must not obey now: an emergency stop, or a second publisher of its commands."""

from __future__ import annotations

from collections.abc import Callable

from hapticmech_ros.nodes.inputs import NEVER
from hapticmech_ros.times import NANOSECONDS

STOPPED = "emergency stop"
SECOND = "second publisher of servo_cf"
# A second publisher is forgotten when nobody commanded for so long: who spoke last is gone.
FORGET_NS = NANOSECONDS


class CommandGuard:
    """Watches who commands a device.

    A publisher that joins while another's commands are fresh is one too many, and so are two that
    answer one sample differently. A node that died without saying so counts as a publisher until
    the middleware gives it up, so that two alone are no fault: who replaces it is obeyed.

    Args:
        publishers: returns how many publishers the middleware knows.

    Attributes:
        fault: why the device must not obey; empty if it may.
    """

    def __init__(self, publishers: Callable[[], int]) -> None:
        self._publishers = publishers
        self._stopped = self._second = False
        self._known = 0
        self._heard_ns = NEVER
        self._stamp_ns, self._command = NEVER, b""

    @property
    def fault(self) -> str:
        """Why the device must not obey; empty if it may."""
        return STOPPED if self._stopped else SECOND if self._second else ""

    def stop(self, on: bool) -> None:
        """Begin or end an emergency stop."""
        self._stopped = on

    def matched(self, count: int, now_ns: int, timeout_ns: int) -> None:
        """Note that so many publishers are known now, and how long a command is fresh."""
        if count > max(self._known, 1) and now_ns - self._heard_ns <= timeout_ns:
            self._second = True
        elif count <= 1:
            self._second = False
        self._known = count

    def heard(self, command: bytes, stamp_ns: int, now_ns: int) -> None:
        """Note a command, as bytes, and the sample that it answers."""
        if now_ns - self._heard_ns > FORGET_NS:
            self._second = False
        again = stamp_ns == self._stamp_ns and command != self._command
        if again and not self._second and self._publishers() > 1:
            self._second = True
        self._heard_ns, self._stamp_ns, self._command = now_ns, stamp_ns, command
