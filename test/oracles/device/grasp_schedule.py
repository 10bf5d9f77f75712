# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""When a hand holds."""

from __future__ import annotations

from hapticmech_ros.device.hand import GraspSchedule
from hapticmech_ros.device.hand_kernels import OPEN, START_TOLERANCE


def window_of(schedule: GraspSchedule, elapsed: float) -> int:
    """Return the number of switches passed if it holds then, else ``OPEN``.

    Args:
        schedule: of the hand.
        elapsed: s since it could take hold.
    """
    moving = elapsed - schedule.start
    if moving < -START_TOLERANCE:
        return OPEN
    passed = sum(moving - time >= -START_TOLERANCE for time in schedule.switches)
    return passed if (passed % 2 == 0) == schedule.holds_first else OPEN
