# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The scene's hand as numbers for kernels, and the law of a user's own hand.

:mod:`~hapticmech_ros.device.hand_kernels` computes the laws. A schedule has the times when a hand
holds the device, and the hand's mass that then moves with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pinocchio as pin

from hapticmech_ros.device import hand_kernels as laws
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene.hand import (
    ArmHand,
    ConstantWrenchHand,
    Grip,
    Hand,
    ScriptedHand,
    TargetHand,
    read_script,
)


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


class HandLaw(Protocol):
    """The law of a user's own hand: a function of time, pose and twist of the device."""

    def __call__(self, elapsed: float, pose: pin.SE3, twist: Array, anchor: pin.SE3, /) -> Array:
        """Return F_h (6,) on the device, N and N m, world axes.

        Args:
            elapsed: s since the hand could take hold.
            pose: of the device, in the world.
            twist: (6,) of the device, m/s and rad/s, world axes.
            anchor: pose of the device when the hand took hold.
        """
        ...


def hand_numbers(hand: Hand | None, schedule: GraspSchedule) -> Array:
    """Return a hand as (numbers,) for :mod:`~hapticmech_ros.device.hand_kernels`.

    Args:
        hand: of the scene; None for one without a law among them.
        schedule: when it holds.

    Raises:
        InvalidInputError: a script that cannot be read.
    """
    head, rows = laws.HandModel(), np.empty(0)
    head.fill(
        kind=laws.NOBODY,
        start=schedule.start,
        holds_first=schedule.holds_first,
        switches=len(schedule.switches),
    )
    if isinstance(hand, ConstantWrenchHand):
        head.kind = laws.CONSTANT
        head.spring.stiffness[:] = (*hand.force, *hand.torque)
    elif isinstance(hand, ScriptedHand):
        head.kind = laws.STAIRS if hand.interpolation == "held" else laws.SCRIPT
        rows = read_script(hand.file)
    elif hand is not None:
        head.kind = laws.SPRING
        head.spring.stiffness[:], head.spring.damping[:] = spring_gains(hand)
        rows = np.column_stack(_target_table(hand))
        if isinstance(hand, ArmHand) and hand.grip is not None:
            head.limb_mass[:] = np.repeat((hand.mass, hand.angular_inertia), 3)
            head.grip.stiffness[:], head.grip.damping[:] = spring_gains(hand.grip)
    tremor = None if hand is None else hand.tremor
    if tremor is not None:
        head.fill(
            speed=2.0 * np.pi * tremor.frequency,
            trembling=(*tremor.force, *tremor.torque),
            sway=(*tremor.xyz, *tremor.rotation),
        )
    return np.concatenate((head.values, schedule.switches, rows.ravel()))


def spring_gains(hand: TargetHand | Grip) -> tuple[Array, Array]:
    """Return stiffnesses and dampings (6,), N/m, N m/rad and N s/m, N m s/rad."""
    stiffness = np.array([hand.stiffness] * 3 + [hand.angular_stiffness] * 3)
    damping = np.array([hand.damping] * 3 + [hand.angular_damping] * 3)
    return stiffness, damping


def _target_table(hand: TargetHand) -> tuple[Array, Array]:
    """Return times (n,), s, the first one 0, and offsets (n, 6) of the target, m and rad."""
    times = np.array([waypoint.time for waypoint in hand.waypoints])
    offsets = np.array([waypoint.xyz + waypoint.rotation for waypoint in hand.waypoints])
    if times[0] > 0.0:
        times = np.concatenate(([0.0], times))
        offsets = np.vstack((np.zeros(6), offsets))
    return times, offsets
