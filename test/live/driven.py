# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Live sessions by a clock of the test's, and drags in them."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.live.commands import Drag, Draggable

# Turns in which a session does what is due.
CATCHES_UP = 1000


def until(session, start, end, *commands):
    """Let time pass in steps of 5 ms, with commands in each; return the end."""
    for now in np.arange(start, end, 0.005):
        for command in commands:
            assert session.take(command, now) is None
        session.advance(now)
        for _ in range(CATCHES_UP):
            if not session.is_behind:
                break
            session.advance(now)
        assert not session.is_behind
    return end


def pull(session, x, y=0.0, user=0):
    """Return a drag of a user's hand from where its device is."""
    held = session.state().users[user]
    goal = held.device[:, 3] + np.array((x, y, 0.0))
    return Drag(Draggable("hand", held.point), np.zeros(3), goal)
