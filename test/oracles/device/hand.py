# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The laws of a scene's hands: pushes, or a spring and damper to a moving target."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.device import HandLaw
from hapticmech_ros.device.hand_kernels import START_TOLERANCE
from hapticmech_ros.scene.hand import (
    ConstantWrenchHand,
    Hand,
    ScriptedHand,
    TargetHand,
    Tremor,
    read_script,
)


def hand_law(hand: Hand) -> HandLaw:
    """Return the law of a scene's hand.

    The law takes s since engagement, the device's pose and twist, and its pose when the hand took
    hold; it returns F_h (6,), by the hand on the device, world axes, N and N m. Before the hand's
    ``start_delay`` it is zero. What the hand's own mass takes of it is not in it.
    """
    law = _steady(hand)
    return law if hand.tremor is None else _trembling(law, hand.tremor, hand.start_delay)


def no_hand(elapsed: float, pose: pin.SE3, twist: Array, held: pin.SE3) -> Array:
    """Return the wrench (6,) of a hand that is not there: zero."""
    del elapsed, pose, twist, held
    return np.zeros(6)


def spring_gains(hand: TargetHand) -> tuple[Array, Array]:
    """Return stiffnesses and dampings (6,), N/m, N m/rad and N s/m, N m s/rad."""
    stiffness = np.array([hand.stiffness] * 3 + [hand.angular_stiffness] * 3)
    damping = np.array([hand.damping] * 3 + [hand.angular_damping] * 3)
    return stiffness, damping


def target_table(hand: TargetHand) -> tuple[Array, Array]:
    """Return times (n,), s, the first one 0, and offsets (n, 6) of the target, m and rad."""
    times = np.array([waypoint.time for waypoint in hand.waypoints])
    offsets = np.array([waypoint.xyz + waypoint.rotation for waypoint in hand.waypoints])
    if times[0] > 0.0:
        times = np.concatenate(([0.0], times))
        offsets = np.vstack((np.zeros(6), offsets))
    return times, offsets


def _steady(hand: Hand) -> HandLaw:
    """Return the law without what tremor pushes."""
    if isinstance(hand, ConstantWrenchHand):
        return _constant(hand)
    return _scripted(hand) if isinstance(hand, ScriptedHand) else _spring_damper(hand)


def _constant(hand: ConstantWrenchHand) -> HandLaw:
    pushing = np.array(hand.force + hand.torque)
    idle = np.zeros(6)
    pushing.flags.writeable = idle.flags.writeable = False

    def law(elapsed: float, pose: pin.SE3, twist: Array, held: pin.SE3) -> Array:
        del pose, twist, held
        return pushing if elapsed - hand.start_delay >= -START_TOLERANCE else idle

    return law


def _scripted(hand: ScriptedHand) -> HandLaw:
    rows = read_script(hand.file)
    times, wrenches = rows[:, 0], rows[:, 1:]

    def law(elapsed: float, pose: pin.SE3, twist: Array, held: pin.SE3) -> Array:
        del pose, twist, held
        moving = elapsed - hand.start_delay
        if moving < -START_TOLERANCE:
            return np.zeros(6)
        # What is on a row's time but for rounding has reached it.
        at = int(np.searchsorted(times, moving + START_TOLERANCE, side="right")) - 1
        if at < 0:
            return np.zeros(6)
        if hand.interpolation == "held" or at == times.size - 1:
            return np.array(wrenches[at])
        share = (moving - times[at]) / (times[at + 1] - times[at])
        return np.asarray(wrenches[at] + share * (wrenches[at + 1] - wrenches[at]))

    return law


def _trembling(law: HandLaw, tremor: Tremor, start: float) -> HandLaw:
    """Return a law with A sin(2 π f t) added, t since the start."""
    amplitude = np.array(tremor.force + tremor.torque)

    def trembling(elapsed: float, pose: pin.SE3, twist: Array, held: pin.SE3) -> Array:
        steady, moving = law(elapsed, pose, twist, held), elapsed - start
        if moving < -START_TOLERANCE:
            return steady
        phase = 2.0 * np.pi * tremor.frequency * max(moving, 0.0)
        return np.asarray(steady + np.sin(phase) * amplitude)

    return trembling


def _spring_damper(hand: TargetHand) -> HandLaw:
    stiffness, damping = spring_gains(hand)
    times, offsets = target_table(hand)
    idle = np.zeros(6)

    def law(elapsed: float, pose: pin.SE3, twist: Array, held: pin.SE3) -> Array:
        moving = elapsed - hand.start_delay
        if moving < -START_TOLERANCE:
            return idle
        offset, rate = _target(times, offsets, max(moving, 0.0))
        if hand.tremor is not None:
            offset, rate = _swayed(offset, rate, hand.tremor, max(moving, 0.0))
        goal = held.translation + offset[:3]
        turned = pin.exp3(offset[3:]) @ held.rotation
        # Left Jacobian of exp: from the rate of a rotation vector to angular velocity, world axes.
        rate = np.concatenate((rate[:3], pin.Jexp3(-offset[3:]) @ rate[3:]))
        stretch = np.concatenate((goal - pose.translation, pin.log3(turned @ pose.rotation.T)))
        return np.asarray(stiffness * stretch + damping * (rate - twist))

    return law


def _swayed(offset: Array, rate: Array, tremor: Tremor, time: float) -> tuple[Array, Array]:
    """Return offset and rate of the target with a tremor's displacement added."""
    speed = 2.0 * np.pi * tremor.frequency
    amplitude = np.array(tremor.xyz + tremor.rotation)
    sine, cosine = np.sin(speed * time), np.cos(speed * time)
    return offset + sine * amplitude, rate + speed * cosine * amplitude


def _target(times: Array, offsets: Array, time: float) -> tuple[Array, Array]:
    """Return offset and rate of the target: minimum-jerk moves from waypoint to waypoint."""
    if time >= times[-1]:
        return offsets[-1], np.zeros(6)
    index = int(np.searchsorted(times, time, side="right")) - 1
    span = times[index + 1] - times[index]
    u = (time - times[index]) / span
    way = offsets[index + 1] - offsets[index]
    share = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    speed = 30.0 * u**2 * (1.0 - u) ** 2 / span
    return offsets[index] + share * way, speed * way
