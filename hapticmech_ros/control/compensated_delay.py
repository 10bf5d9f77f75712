# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The delay τ of a loop that ``operational/delay_compensation`` compensates for.

A command computed from a state acts d periods later, on average half a period longer for being
held. Where the device closes the force channel, the mechanism's state is as late besides: it learns
of F_h that much later than the device, and in samples that are held. A controller that closes it
tells both at once. A connection between device and controller makes both ways longer.
"""

from __future__ import annotations

from math import ceil

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.controller import Connection

# Silence that jitter alone explains, s, is waited for beside a timeout; no more than so much, for
# the hand's sake: whoever falls silent, it is without force soon after the last command.
MOST_ALLOWED_S = 0.005


def jitter_allowance(connection: Connection) -> float:
    """Return how much longer (s) than a timeout a network may be silent: its jitter, to 5 ms."""
    return min(connection.expected_jitter * connection.expected, MOST_ALLOWED_S)


def compensated_loop_delay(scene: Scene, delay: int = 1) -> float:
    """Return τ in s: 2 t_c + (2 d + 1) T with the force channel closed in the device.

    Closed in the controller it is half of that, t_c the delay of the connection.

    Args:
        scene: its period, and what closes the force channel.
        delay: whole periods d from measuring to acting.

    Raises:
        InvalidInputError: a negative delay.
    """
    if delay < 0:
        raise InvalidInputError("delay", delay, "must be 0 or more periods")
    times = 2 if scene.controller.force_channel.local else 1
    return times * (scene.connection.designed + (delay + 0.5) * scene.simulation.period)


def periods_before(scene: Scene, delay: int = 1) -> int:
    """Return how many periods before a state the rates are of that its compensation knows.

    As many as τ has, rounded up. Over a connection it is none: rates of so long ago say nothing of
    what a hand does now.

    Args:
        scene: as of :func:`compensated_loop_delay`.
        delay: likewise.
    """
    if scene.connection.designed > 0.0:
        return 0
    return ceil(compensated_loop_delay(scene, delay) / scene.simulation.period - 1e-6)
