# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Times as ROS has them: whole nanoseconds."""

from __future__ import annotations

NANOSECONDS = 1_000_000_000


def nanoseconds(seconds: float) -> int:
    """Return a duration of seconds in nanoseconds, rounded."""
    return round(seconds * NANOSECONDS)
