"""A period of the simulated device in one kernel.

What the device is, and what acts on it, is in one array, ``data``:

    STEP, PERIOD, SUBSTEPS, FILTER  s, s, number, gain of the velocity filter
    MOST_FORCE, MOST_TORQUE         of the actuators, N and N m
    POSITION_STEP, ANGLE_STEP       of the encoders, m and rad, 0 if ideal
    DAMPING  6, N s/m and N m s/rad
    GAIN     6, change of the twist per wrench and substep, 0 where the scene has no direction
    COMMAND  6, to the actuators
    PUSH     6, by others than the hand
    HELD     12, position and rotation when the hand took hold
    HAND     as :mod:`~hapticmech_ros.device.hand_kernels` says

A state is one array of 52: measured position 3, quaternion x y z w 4 and twist 6, hand's wrench 6,
wrench applied 6; then what is not published: position 3, rotation 9, twist 6, measured rotation 9.
Rotations go row by row.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel
from hapticmech_ros.device.hand_kernels import BODY_SIZE, WORK_SIZE, hand_wrench
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.rotation_kernels import (
    exp3,
    log3,
    multiply,
    multiply_transposed,
    quaternion_of,
)
from hapticmech_ros.saturation_kernels import limit

STEP, PERIOD, SUBSTEPS, FILTER = 0, 1, 2, 3
MOST_FORCE, MOST_TORQUE, POSITION_STEP, ANGLE_STEP = 4, 5, 6, 7
DAMPING, GAIN, COMMAND, PUSH, HELD, HAND = 8, 14, 20, 26, 32, 44
PUBLISHED_SIZE = 25
BODY, SEEN = PUBLISHED_SIZE, PUBLISHED_SIZE + BODY_SIZE
STATE_SIZE = SEEN + 9


@inner
def _move(data: Array, force: Array, body: Array, work: Array) -> None:
    """Advance a body (18,) by one substep under hand and actuators: ``force`` (6,)."""
    turn, turned = work[3:12].reshape(3, 3), work[12:21].reshape(3, 3)
    step, twist = data[STEP], body[12:]
    for i in range(6):
        net = force[i] - data[DAMPING + i] * twist[i]
        twist[i] += data[GAIN + i] * net
    for i in range(3):
        body[i] += step * twist[i]
        work[i] = step * twist[3 + i]
    exp3(work[:3], turn)
    multiply(turn, body[3:12].reshape(3, 3), turned)
    body[3:12] = work[12:21]


@inner
def _quantise(data: Array, body: Array, position: Array, seen: Array, work: Array) -> None:
    """Fill measured position (3,) and rotation (9,)."""
    fine, turn = data[POSITION_STEP], data[ANGLE_STEP]
    for i in range(3):
        position[i] = fine * np.rint(body[i] / fine) if fine > 0.0 else body[i]
    if turn > 0.0:
        log3(body[3:12].reshape(3, 3), work[:3])
        for i in range(3):
            work[i] = turn * np.rint(work[i] / turn)
        exp3(work[:3], seen.reshape(3, 3))
    else:
        seen[:] = body[3:12]


@inner
def _estimate(data: Array, before: Array, out: Array, work: Array) -> None:
    """Fill the measured twist from encoder differences, low-passed."""
    turn = work[6:15].reshape(3, 3)
    multiply_transposed(out[SEEN:].reshape(3, 3), before[SEEN:].reshape(3, 3), turn)
    log3(turn, work[3:6])
    for i in range(3):
        work[i] = out[i] - before[i]
    for i in range(6):
        old = before[7 + i]
        out[7 + i] = old + data[FILTER] * (work[i] / data[PERIOD] - old)


@inner
def _measure(data: Array, before: Array, out: Array, work: Array) -> None:
    """Fill what the encoders say of the body in ``out``."""
    body, seen = out[BODY:SEEN], out[SEEN:]
    if data[POSITION_STEP] == 0.0 and data[ANGLE_STEP] == 0.0:
        out[:3], seen[:] = body[:3], body[3:12]
        out[7:13] = body[12:]
    else:
        _quantise(data, body, out[:3], seen, work)
        _estimate(data, before, out, work)
    quaternion_of(seen.reshape(3, 3), out[3:7])


@kernel("void(float64[::1], float64[::1], int64, float64[::1])")
def advance(data: Array, state: Array, ticks: int, out: Array) -> None:
    """Fill ``out`` with the state one period after ``state``.

    Args:
        data: the device, and what acts on it.
        state: (52,) where to start.
        ticks: whole periods since the hand took hold; -1 if nobody holds.
        out: (52,) to fill.
    """
    scratch = np.empty(6 + WORK_SIZE)
    force, work = scratch[:6], scratch[6:]
    hand, held = data[HAND:], data[HELD:HAND]
    own, applied, body = out[13:19], out[19:25], out[BODY:SEEN]
    body[:] = state[BODY:SEEN]
    applied[:] = data[COMMAND:PUSH]
    limit(applied[:3], data[MOST_FORCE])
    limit(applied[3:], data[MOST_TORQUE])
    own[:] = 0.0
    for index in range(int(data[SUBSTEPS])):
        if ticks >= 0:
            elapsed = ticks * data[PERIOD] + index * data[STEP]
            hand_wrench(hand, elapsed, body, held, own, work)
        for i in range(6):
            force[i] = data[PUSH + i] + own[i] + applied[i]
        _move(data, force, body, work)
    if ticks >= 0:
        hand_wrench(hand, (ticks + 1) * data[PERIOD], body, held, own, work)
    _measure(data, state, out, work)
