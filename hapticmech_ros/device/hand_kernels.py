"""The hand's laws inside kernels; :mod:`~hapticmech_ros.device.hand` says what they compute.

A hand is one array: KIND, START (s, its delay), STIFFNESS 6 or the constant wrench, DAMPING 6, and
from WAYPOINTS a row of 7 per waypoint: time (s), displacement (m), rotation vector (rad).
A body is 18 numbers: position 3, rotation 9 row by row, twist 6, world axes.
"""

from __future__ import annotations

from hapticmech_ros.compilation import inner
from hapticmech_ros.device.hand import START_TOLERANCE
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.rotation_kernels import (
    angular_rate,
    exp3,
    log3,
    multiply,
    multiply_transposed,
)

NOBODY, CONSTANT, SPRING = 0.0, 1.0, 2.0
KIND, START, STIFFNESS, DAMPING, WAYPOINTS = 0, 1, 2, 8, 14
WAYPOINT_SIZE = 7
BODY_SIZE = 18
# Numbers that the laws need for what they compute on the way.
WORK_SIZE = 36


@inner
def hand_wrench(
    hand: Array, elapsed: float, body: Array, held: Array, wrench: Array, work: Array
) -> None:
    """Fill ``wrench`` (6,) with F_h of the hand's own law.

    Args:
        hand: its numbers.
        elapsed: s since it took hold.
        body: (18,) the device.
        held: (12,) position and rotation when the hand took hold.
        wrench: to fill, N and N m.
        work: (36,) scratch.
    """
    wrench[:] = 0.0
    moving = elapsed - hand[START]
    if moving < -START_TOLERANCE:
        return
    if hand[KIND] == CONSTANT:
        wrench[:] = hand[STIFFNESS:DAMPING]
    elif hand[KIND] == SPRING:
        _spring(hand, max(moving, 0.0), body, held, wrench, work)


@inner
def _spring(hand: Array, time: float, body: Array, held: Array, wrench: Array, work: Array) -> None:
    offset, rate, stretch, spin = work[:6], work[6:12], work[12:15], work[15:18]
    turn, goal = work[18:27].reshape(3, 3), work[27:36].reshape(3, 3)
    stiffness, damping = hand[STIFFNESS:DAMPING], hand[DAMPING:WAYPOINTS]
    _target(hand[WAYPOINTS:], time, offset, rate)
    exp3(offset[3:], turn)
    multiply(turn, held[3:12].reshape(3, 3), goal)
    multiply_transposed(goal, body[3:12].reshape(3, 3), turn)
    log3(turn, stretch)
    angular_rate(offset[3:], rate[3:], spin)
    for i in range(3):
        way = held[i] + offset[i] - body[i]
        wrench[i] = stiffness[i] * way + damping[i] * (rate[i] - body[12 + i])
        angular = damping[3 + i] * (spin[i] - body[15 + i])
        wrench[3 + i] = stiffness[3 + i] * stretch[i] + angular


@inner
def _target(table: Array, time: float, offset: Array, rate: Array) -> None:
    """Fill offset and rate (6,) of the target ``time`` (s) after the start."""
    last = table.size - WAYPOINT_SIZE
    at = 0
    while at < last and table[at + WAYPOINT_SIZE] <= time:
        at += WAYPOINT_SIZE
    if at == last:
        offset[:] = table[at + 1 :]
        rate[:] = 0.0
        return
    after = at + WAYPOINT_SIZE
    span = table[after] - table[at]
    u = (time - table[at]) / span
    share = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u)
    speed = 30.0 * u * u * (1.0 - u) * (1.0 - u) / span
    for i in range(1, WAYPOINT_SIZE):
        way = table[after + i] - table[at + i]
        offset[i - 1] = table[at + i] + share * way
        rate[i - 1] = speed * way
