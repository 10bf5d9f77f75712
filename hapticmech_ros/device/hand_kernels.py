# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The hand's laws: a push, or a spring and damper to a target; a wrench by a script; tremor.

A target goes from waypoint to waypoint with minimum jerk, from where the hand took hold. The laws
leave out the inertial wrench of the hand's own mass. Before its start the hand's wrench is zero. A
mass behind a grip is pulled to the target instead, and the grip's spring and damper pull the device
to the mass.

A hand is one array: a :class:`HandModel`, and behind it its plan: times when it switches, s after
the start, and a table of rows of 7: a waypoint's time (s), displacement (m) and rotation vector
(rad), or a script's time, force and torque.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, local, put, shaped
from hapticmech_ros.compilation.records import Nested, Number, Record, Vector, matrix
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import TWIST
from hapticmech_ros.numerics.rotation_kernels import (
    angular_rate,
    exp3,
    log3,
    multiply,
    multiply_transposed,
)
from hapticmech_ros.numerics.small_matrices import add_scaled

# Half a nanosecond, s, absorbs the rounding of times that are sums of periods.
START_TOLERANCE = 5e-10
# Number of the window in which no hand holds.
OPEN = -1
NOBODY, CONSTANT, SPRING, SCRIPT, STAIRS = 0.0, 1.0, 2.0, 3.0, 4.0
ROW_SIZE = 7


class Place(Record):
    """Where a body is, in the world.

    Attributes:
        position: m.
        rotation: its axes, in columns.
    """

    position, rotation = Vector(3), matrix(3, 3)


class Body(Place):
    """A body that moves.

    Attributes:
        twist: m/s and rad/s, world axes at its position.
    """

    twist = Vector(6, TWIST)


class Spring(Record):
    """A spring and a damper.

    Attributes:
        stiffness: N/m and N m/rad.
        damping: N s/m and N m s/rad.
    """

    stiffness, damping = Vector(6), Vector(6)


class HandModel(Record):
    """A hand's parameters.

    Attributes:
        kind: which law: ``NOBODY``, ``CONSTANT``, ``SPRING``, ``SCRIPT`` or ``STAIRS``.
        start: s, its delay since it could take hold.
        spring: to the target; of a constant wrench, its stiffness is that wrench, N and N m.
        trembling: amplitude of the wrench that tremor adds, N and N m.
        sway: amplitude of what tremor adds to the target, m and rad.
        speed: of tremor, rad/s; 0 for none.
        holds_first: 1 if it holds before it first switches.
        switches: how often it lets go and takes hold.
        limb_mass: masses and inertias behind the grip, kg and kg m²; 0 without one.
        grip: spring and damper of the grip.
    """

    kind, start = Number(), Number()
    spring = Nested(Spring)
    trembling, sway, speed = Vector(6), Vector(6), Number()
    holds_first, switches = Number(), Number()
    limb_mass = Vector(6)
    grip = Nested(Spring)


BODY_SIZE = Body.layout.size


@inner
def grasp_window(hand: HandModel, plan: Array, elapsed: float) -> int:
    """Return the number of switches passed if the hand holds, else -1; see ``GraspSchedule``."""
    moving = elapsed - hand.start
    if moving < -START_TOLERANCE:
        return OPEN
    passed = 0
    for i in range(int(hand.switches)):
        if moving - plan[i] >= -START_TOLERANCE:
            passed += 1
    holds = hand.holds_first == 1.0 if passed % 2 == 0 else hand.holds_first == 0.0
    return passed if holds else OPEN


@inner
def hand_wrench(
    hand: HandModel, plan: Array, elapsed: float, body: Body, held: Place, wrench: Array
) -> None:
    """Fill ``wrench`` (6,) with F_h of the hand's own law.

    Args:
        hand: its parameters.
        plan: times when it switches, and its table.
        elapsed: s since it could take hold.
        body: the device.
        held: where it was when the hand took hold.
        wrench: to fill, N and N m.
    """
    wrench[:] = 0.0
    moving = elapsed - hand.start
    if moving < -START_TOLERANCE:
        return
    table = plan[int(hand.switches) :]
    if hand.kind == CONSTANT:
        put(wrench, hand.spring.stiffness)
    elif hand.kind == SPRING:
        _follow(hand, table, max(moving, 0.0), body, held, wrench)
    elif hand.kind != NOBODY:
        _script(hand, table, moving, wrench)
    if hand.speed > 0.0:
        add_scaled(wrench, np.sin(hand.speed * max(moving, 0.0)), hand.trembling)


@inner
def _follow(
    hand: HandModel, table: Array, time: float, body: Body, held: Place, wrench: Array
) -> None:
    """Fill the wrench that pulls a body to the target's place ``time`` (s) after the start."""
    offset, rate, turn, goal = local(6), local(6), shaped(local(9), (3, 3)), Body(local(BODY_SIZE))
    _target(table, time, offset, rate)
    if hand.speed > 0.0:
        add_scaled(offset, np.sin(hand.speed * time), hand.sway)
        add_scaled(rate, hand.speed * np.cos(hand.speed * time), hand.sway)
    exp3(offset[3:], turn)
    multiply(turn, held.rotation, goal.rotation)
    angular_rate(offset[3:], rate[3:], goal.twist[3:])
    for i in range(3):
        goal.position[i] = held.position[i] + offset[i]
        goal.twist[i] = rate[i]
    pull(hand.spring, goal, body, wrench)


@inner
def pull(spring: Spring, goal: Body, body: Body, wrench: Array) -> None:
    """Fill ``wrench`` (6,) with what a spring exerts on a body, pulling it to another one."""
    turn, stretch = shaped(local(9), (3, 3)), local(3)
    stiffness, damping = spring.stiffness, spring.damping
    multiply_transposed(goal.rotation, body.rotation, turn)
    log3(turn, stretch)
    for i in range(3):
        way = goal.position[i] - body.position[i]
        angular = damping[3 + i] * (goal.twist[3 + i] - body.twist[3 + i])
        wrench[i] = stiffness[i] * way + damping[i] * (goal.twist[i] - body.twist[i])
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
def _script(hand: HandModel, table: Array, time: float, wrench: Array) -> None:
    """Fill the wrench of a script ``time`` (s) after the start."""
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
    if hand.kind == SCRIPT and after < table.size:
        share = (time - table[at]) / (table[after] - table[at])
    for i in range(6):
        wrench[i] = table[at + 1 + i]
        if share != 0.0:
            wrench[i] += share * (table[after + 1 + i] - table[at + 1 + i])
