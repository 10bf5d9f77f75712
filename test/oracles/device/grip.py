"""When a hand holds."""

from __future__ import annotations

from hapticmech_ros.device.grip import OPEN, START_TOLERANCE, Grip


def window_of(grip: Grip, elapsed: float) -> int:
    """Return the number of switches passed if it holds then, else ``OPEN``.

    Args:
        grip: of the hand.
        elapsed: s since it could take hold.
    """
    moving = elapsed - grip.start
    if moving < -START_TOLERANCE:
        return OPEN
    passed = sum(moving - time >= -START_TOLERANCE for time in grip.switches)
    return passed if (passed % 2 == 0) == grip.holds_first else OPEN
