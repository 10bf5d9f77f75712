"""A period of the simulated device in one kernel.

What the device is, and what acts on it, is in one array, ``data``:

    STEP, PERIOD, SUBSTEPS, FILTER  s, s, number, gain of the velocity filter
    MOST_FORCE, MOST_TORQUE         of the actuators, N and N m
    POSITION_STEP, ANGLE_STEP       of the encoders, m and rad, 0 if ideal
    LAG, LAG_MEAN                   of the actuators' error: what is left of it after a substep, and
                                    its mean over one, per unit; LAG_MEAN is 0 if there is none
    FRICTION, TURN_FRICTION         Coulomb's, N and N m
    STOP, TURN_STOP                 end stops, 3 numbers each
    DAMPING    6, N s/m and N m s/rad
    GAIN       6, change of the twist per wrench and substep, 0 where the scene has no direction
    HELD_GAIN  6, the same with the hand's own mass
    ARM        6, the hand's own mass (kg) and inertia (kg m^2)
    COMMAND    6, to the actuators
    PUSH       6, by others than the hand
    HELD       12, position and rotation when the hand could take hold
    HAND       as :mod:`~hapticmech_ros.device.hand_kernels` says

A state is one array of 83: measured position 3, quaternion x y z w 4 and twist 6, reported wrench
of the hand 6, wrench applied 6; then what is not published: position 3, rotation 9, twist 6,
measured rotation 9, where the device started 12, where the hand took hold 12, the window in which
it holds 1, its wrench 6. Rotations go row by row.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, kernel, local, put, shaped
from hapticmech_ros.device.grip import OPEN
from hapticmech_ros.device.hand_kernels import BODY_SIZE, WORK_SIZE, grip_window, hand_wrench
from hapticmech_ros.device.resistance_kernels import rub, stop
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
LAG, LAG_MEAN, FRICTION, TURN_FRICTION, STOP, TURN_STOP = 8, 9, 10, 11, 12, 15
DAMPING, GAIN, HELD_GAIN, ARM, COMMAND, PUSH, HELD, HAND = 18, 24, 30, 36, 42, 48, 54, 66
REPORTED, APPLIED, PUBLISHED_SIZE = 13, 19, 25
BODY, SEEN = PUBLISHED_SIZE, PUBLISHED_SIZE + BODY_SIZE
HOME = SEEN + 9
ANCHOR, WINDOW, OWN = HOME + 12, HOME + 24, HOME + 25
STATE_SIZE = OWN + 6


@inner
def _move(data: Array, gain: Array, force: Array, home: Array, body: Array, work: Array) -> None:
    """Advance a body (18,) by one substep under hand and actuators: ``force`` (6,)."""
    turn, turned = shaped(work[3:12], (3, 3)), shaped(work[12:21], (3, 3))
    step, twist = data[STEP], body[12:]
    for i in range(6):
        net = force[i] - data[DAMPING + i] * twist[i]
        twist[i] += gain[i] * net
    _resist(data, gain, home, body, work)
    for i in range(3):
        body[i] += step * twist[i]
        work[i] = step * twist[3 + i]
    exp3(work[:3], turn)
    multiply(turn, shaped(body[3:12], (3, 3)), turned)
    put(body[3:12], work[12:21])


@inner
def _resist(data: Array, gain: Array, home: Array, body: Array, work: Array) -> None:
    """Let end stops and friction act on a body's twist."""
    step, rate, spin = data[STEP], body[12:15], body[15:18]
    if data[STOP] > 0.0:
        for i in range(3):
            work[i] = body[i] - home[i]
        stop(data[STOP:TURN_STOP], work[:3], rate, gain[0], step)
    if data[TURN_STOP] > 0.0:
        turn = shaped(work[3:12], (3, 3))
        multiply_transposed(shaped(body[3:12], (3, 3)), shaped(home[3:12], (3, 3)), turn)
        log3(turn, work[:3])
        stop(data[TURN_STOP:DAMPING], work[:3], spin, gain[5], step)
    if data[FRICTION] > 0.0:
        rub(rate, gain[0] * data[FRICTION])
    if data[TURN_FRICTION] > 0.0:
        rub(spin, gain[5] * data[TURN_FRICTION])


@inner
def _give(data: Array, asked: Array, applied: Array, given: Array) -> None:
    """Advance what actuators apply by a substep, and fill its mean over that."""
    if data[LAG_MEAN] == 0.0:
        put(given, asked)
        put(applied, asked)
        return
    for i in range(6):
        behind = applied[i] - asked[i]
        given[i] = asked[i] + data[LAG_MEAN] * behind
        applied[i] = asked[i] + data[LAG] * behind


@inner
def _hold(data: Array, elapsed: float, out: Array, work: Array) -> None:
    """Fill the hand's wrench at a time (s), the window in which it holds, and from where."""
    hand, body, anchor = data[HAND:], out[BODY:SEEN], out[ANCHOR:WINDOW]
    window = grip_window(hand, elapsed)
    if window == 0:
        put(anchor, data[HELD:HAND])
    elif window > 0 and window != out[WINDOW]:
        put(anchor, body[:12])
    out[WINDOW] = window
    if window == OPEN:
        out[OWN:] = 0.0
    else:
        hand_wrench(hand, elapsed, body, anchor, out[OWN:], work)


@inner
def _quantise(data: Array, body: Array, position: Array, seen: Array, work: Array) -> None:
    """Fill measured position (3,) and rotation (9,)."""
    fine, turn = data[POSITION_STEP], data[ANGLE_STEP]
    for i in range(3):
        position[i] = fine * np.rint(body[i] / fine) if fine > 0.0 else body[i]
    if turn > 0.0:
        log3(shaped(body[3:12], (3, 3)), work[:3])
        for i in range(3):
            work[i] = turn * np.rint(work[i] / turn)
        exp3(work[:3], shaped(seen, (3, 3)))
    else:
        put(seen, body[3:12])


@inner
def _estimate(data: Array, before: Array, out: Array, work: Array) -> None:
    """Fill the measured twist from encoder differences, low-passed."""
    turn = shaped(work[6:15], (3, 3))
    multiply_transposed(shaped(out[SEEN:HOME], (3, 3)), shaped(before[SEEN:HOME], (3, 3)), turn)
    log3(turn, work[3:6])
    for i in range(3):
        work[i] = out[i] - before[i]
    for i in range(6):
        old = before[7 + i]
        out[7 + i] = old + data[FILTER] * (work[i] / data[PERIOD] - old)


@inner
def _measure(data: Array, before: Array, out: Array, work: Array) -> None:
    """Fill what the encoders say of the body in ``out``."""
    body, seen = out[BODY:SEEN], out[SEEN:HOME]
    if data[POSITION_STEP] == 0.0 and data[ANGLE_STEP] == 0.0:
        put(out[:3], body[:3])
        put(seen, body[3:12])
        put(out[7:13], body[12:])
    else:
        _quantise(data, body, out[:3], seen, work)
        _estimate(data, before, out, work)
    quaternion_of(shaped(seen, (3, 3)), out[3:7])


@kernel("void(float64[::1], float64[::1], int64, float64[::1])")
def advance(data: Array, state: Array, ticks: int, out: Array) -> None:
    """Fill ``out`` with the state one period after ``state``.

    Args:
        data: the device, and what acts on it.
        state: (83,) where to start.
        ticks: whole periods since the hand could take hold; -1 if nobody holds.
        out: (83,) to fill.
    """
    scratch = local(24 + WORK_SIZE)
    force, asked, given = scratch[:6], scratch[6:12], scratch[12:18]
    before, work = scratch[18:24], scratch[24:]
    own, applied, body = out[OWN:], out[APPLIED:PUBLISHED_SIZE], out[BODY:SEEN]
    put(body, state[BODY:SEEN])
    put(out[HOME:OWN], state[HOME:OWN])
    put(applied, state[APPLIED:PUBLISHED_SIZE])
    put(asked, data[COMMAND:PUSH])
    limit(asked[:3], data[MOST_FORCE])
    limit(asked[3:], data[MOST_TORQUE])
    own[:] = 0.0
    if ticks < 0:
        out[WINDOW] = OPEN
    for index in range(int(data[SUBSTEPS])):
        if ticks >= 0:
            _hold(data, ticks * data[PERIOD] + index * data[STEP], out, work)
        _give(data, asked, applied, given)
        for i in range(6):
            force[i] = data[PUSH + i] + own[i] + given[i]
        put(before, body[12:])
        start = GAIN if out[WINDOW] == OPEN else HELD_GAIN
        _move(data, data[start : start + 6], force, out[HOME:ANCHOR], body, work)
    if ticks >= 0:
        carried = out[WINDOW] != OPEN
        _hold(data, (ticks + 1) * data[PERIOD], out, work)
        if data[ARM] + data[ARM + 3] > 0.0 and carried and out[WINDOW] != OPEN:
            for i in range(6):
                own[i] -= data[ARM + i] * ((body[12 + i] - before[i]) / data[STEP])
    put(out[REPORTED:APPLIED], own)
    _measure(data, state, out, work)
