# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""When a hand holds the device, and how much of its own mass then moves with it."""

from __future__ import annotations

from dataclasses import dataclass

from hapticmech_ros.scene.hand import ArmHand, Hand

# Half a nanosecond, s, absorbs the rounding of times that are sums of periods.
START_TOLERANCE = 5e-10
# Number of the window in which nobody holds.
OPEN = -1


@dataclass(frozen=True, slots=True)
class GraspSchedule:
    """Windows of time in which a hand holds, numbered by how many switches are passed.

    In window 0 the hand is where it could take hold first; in a later one, where the device was
    when that window began.

    Attributes:
        start: s since it could take hold.
        switches: s after the start, increasing: it lets go and takes hold in turns.
        holds_first: whether it holds before the first of them.
        mass: kg, of the hand, moves with the device while it holds; 0 behind a grip.
        inertia: kg m^2, likewise.
    """

    start: float = 0.0
    switches: tuple[float, ...] = ()
    holds_first: bool = True
    mass: float = 0.0
    inertia: float = 0.0


ALWAYS = GraspSchedule()


def grasp_schedule_of(hand: Hand) -> GraspSchedule:
    """Return when a scene's hand holds."""
    switches = tuple(sorted(hand.release_at + hand.grab_at))
    holds_first = not switches or switches[0] in hand.release_at
    mass = inertia = 0.0
    if isinstance(hand, ArmHand) and hand.grip is None:
        mass, inertia = hand.mass, hand.angular_inertia
    return GraspSchedule(hand.start_delay, switches, holds_first, mass, inertia)
