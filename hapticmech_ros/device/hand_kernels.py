# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The hand's laws: a push, or a spring and damper to a target; a wrench by a script; tremor.

A target goes from waypoint to waypoint with minimum jerk, from where the hand took hold. What the
hand's own mass takes of its wrench is not in these. Before its start the hand's wrench is zero.
A mass behind a grip is pulled to the target instead, and the grip's spring and damper pull the
device to the mass.

A hand is one array:

    KIND, START   which law; s, its delay
    STIFFNESS     6, or the constant wrench
    DAMPING       6
    TREMBLING     6, amplitude of the wrench that tremor adds
    SWAY          6, amplitude of what it adds to the target
    SPEED         rad/s, of tremor; 0 for none
    HOLDS_FIRST   1 if it holds before it first switches
    SWITCHES      how often it lets go and takes hold; from TIMES on, when, s after the start
    LIMB_MASS     6, masses and inertias behind the grip; 0 without one
    GRIP          12, its stiffness and damping

and behind those times a table of rows of 7: a waypoint's time (s), displacement (m) and rotation
vector (rad), or a script's time, force and torque.
A body is 18 numbers: position 3, rotation 9 row by row, twist 6, world axes.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, put, shaped
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.rotation_kernels import (
    angular_rate,
    exp3,
    log3,
    multiply,
    multiply_transposed,
)

# Half a nanosecond, s, absorbs the rounding of times that are sums of periods.
START_TOLERANCE = 5e-10
# Number of the window in which nobody holds.
OPEN = -1
NOBODY, CONSTANT, SPRING, SCRIPT, STAIRS = 0.0, 1.0, 2.0, 3.0, 4.0
KIND, START, STIFFNESS, DAMPING, TREMBLING, SWAY = 0, 1, 2, 8, 14, 20
SPEED, HOLDS_FIRST, SWITCHES, LIMB_MASS, GRIP, TIMES = 26, 27, 28, 29, 35, 47
ROW_SIZE = 7
# Numbers that the laws need for what they compute on the way.
WORK_SIZE = 42


@inner
def grasp_window(hand: Array, elapsed: float) -> int:
    """Return the number of switches passed if the hand holds, else -1; see ``GraspSchedule``."""
    moving = elapsed - hand[START]
    if moving < -START_TOLERANCE:
        return OPEN
    passed = 0
    for i in range(int(hand[SWITCHES])):
        if moving - hand[TIMES + i] >= -START_TOLERANCE:
            passed += 1
    holds = hand[HOLDS_FIRST] == 1.0 if passed % 2 == 0 else hand[HOLDS_FIRST] == 0.0
    return passed if holds else OPEN


@inner
def hand_wrench(
    hand: Array, elapsed: float, body: Array, held: Array, wrench: Array, work: Array
) -> None:
    """Fill ``wrench`` (6,) with F_h of the hand's own law.

    Args:
        hand: its numbers.
        elapsed: s since it could take hold.
        body: (18,) the device.
        held: (12,) position and rotation when the hand took hold.
        wrench: to fill, N and N m.
        work: (42,) scratch.
    """
    wrench[:] = 0.0
    moving = elapsed - hand[START]
    if moving < -START_TOLERANCE:
        return
    if hand[KIND] == CONSTANT:
        put(wrench, hand[STIFFNESS:DAMPING])
    elif hand[KIND] == SPRING:
        _spring(hand, max(moving, 0.0), body, held, wrench, work)
    elif hand[KIND] != NOBODY:
        _script(hand, moving, wrench)
    if hand[SPEED] > 0.0:
        sine = np.sin(hand[SPEED] * max(moving, 0.0))
        for i in range(6):
            wrench[i] += sine * hand[TREMBLING + i]


@inner
def grip_wrench(hand: Array, limb: Array, body: Array, wrench: Array, work: Array) -> None:
    """Fill ``wrench`` (6,) with F_h of a grip between a mass and the device, (18,) each."""
    grip = hand[GRIP:TIMES]
    _pull(grip[:6], grip[6:], limb, body, wrench, work)


@inner
def _spring(hand: Array, time: float, body: Array, held: Array, wrench: Array, work: Array) -> None:
    offset, rate, goal, turn = work[:6], work[6:12], work[12:30], shaped(work[30:39], (3, 3))
    _target(hand[TIMES + int(hand[SWITCHES]) :], time, offset, rate)
    if hand[SPEED] > 0.0:
        sine, cosine = np.sin(hand[SPEED] * time), np.cos(hand[SPEED] * time)
        for i in range(6):
            offset[i] += sine * hand[SWAY + i]
            rate[i] += hand[SPEED] * cosine * hand[SWAY + i]
    exp3(offset[3:], turn)
    multiply(turn, shaped(held[3:12], (3, 3)), shaped(goal[3:12], (3, 3)))
    angular_rate(offset[3:], rate[3:], goal[15:])
    for i in range(3):
        goal[i] = held[i] + offset[i]
        goal[12 + i] = rate[i]
    _pull(hand[STIFFNESS:DAMPING], hand[DAMPING:TREMBLING], goal, body, wrench, work[30:])


@inner
def _pull(
    stiffness: Array, damping: Array, goal: Array, body: Array, wrench: Array, work: Array
) -> None:
    """Fill what spring and damper (6,) exert on a body, pulling it to another one, (18,) each."""
    turn, stretch = shaped(work[:9], (3, 3)), work[9:12]
    multiply_transposed(shaped(goal[3:12], (3, 3)), shaped(body[3:12], (3, 3)), turn)
    log3(turn, stretch)
    for i in range(3):
        way, angular = goal[i] - body[i], damping[3 + i] * (goal[15 + i] - body[15 + i])
        wrench[i] = stiffness[i] * way + damping[i] * (goal[12 + i] - body[12 + i])
        wrench[3 + i] = stiffness[3 + i] * stretch[i] + angular


@inner
def _target(table: Array, time: float, offset: Array, rate: Array) -> None:
    """Fill offset and rate (6,) of the target ``time`` (s) after the start."""
    last = table.size - ROW_SIZE
    at = 0
    while at < last and table[at + ROW_SIZE] <= time:
        at += ROW_SIZE
    if at == last:
        put(offset, table[at + 1 :])
        rate[:] = 0.0
        return
    after = at + ROW_SIZE
    span = table[after] - table[at]
    u = (time - table[at]) / span
    share = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u)
    speed = 30.0 * u * u * (1.0 - u) * (1.0 - u) / span
    for i in range(1, ROW_SIZE):
        way = table[after + i] - table[at + i]
        offset[i - 1] = table[at + i] + share * way
        rate[i - 1] = speed * way


@inner
def _script(hand: Array, time: float, wrench: Array) -> None:
    """Fill the wrench of a script ``time`` (s) after the start."""
    table = hand[TIMES + int(hand[SWITCHES]) :]
    # Rows before ``first`` are past; those from ``last`` on are not.
    first, last = 0, table.size // ROW_SIZE
    while first < last:
        middle = (first + last) // 2
        if table[middle * ROW_SIZE] <= time + START_TOLERANCE:
            first = middle + 1
        else:
            last = middle
    if first == 0:
        return
    at, after = (first - 1) * ROW_SIZE, first * ROW_SIZE
    share = 0.0
    if hand[KIND] == SCRIPT and after < table.size:
        share = (time - table[at]) / (table[after] - table[at])
    for i in range(6):
        wrench[i] = table[at + 1 + i]
        if share != 0.0:
            wrench[i] += share * (table[after + 1 + i] - table[at + 1 + i])
