"""A period of the simulated device and of its driver in one kernel.

What the device is, and what acts on it, is one array, ``data``, and its state another one; they are
laid out as :mod:`~hapticmech_ros.device.device_layout` says. Behind the device in ``data`` is its
hand, as :mod:`~hapticmech_ros.device.hand_kernels` says.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, kernel, local, put, shaped
from hapticmech_ros.device.device_layout import DEVICE_MODEL, DEVICE_STATE
from hapticmech_ros.device.grip import OPEN
from hapticmech_ros.device.hand_kernels import WORK_SIZE, grip_window, hand_wrench
from hapticmech_ros.device.resistance_kernels import rub, stop
from hapticmech_ros.mechanism.kernels.small_matrices import dot
from hapticmech_ros.rotation_kernels import (
    exp3,
    log3,
    multiply,
    multiply_transposed,
    quaternion_of,
)
from hapticmech_ros.saturation_kernels import limit

STEP, PERIOD, SUBSTEPS, FILTER = DEVICE_MODEL.starts("step", "period", "substeps", "filter_gain")
MOST_FORCE, MOST_TORQUE, POSITION_STEP, ANGLE_STEP = DEVICE_MODEL.starts(
    "force_limit", "torque_limit", "position_step", "angle_step"
)
LAG, LAG_MEAN, FRICTION, TURN_FRICTION, STOP, TURN_STOP = DEVICE_MODEL.starts(
    "lag", "lag_mean", "friction", "angular_friction", "stop", "angular_stop"
)
DAMPING, GAIN, HELD_GAIN, ARM, COMMAND, WEIGHT, PUSH, HELD = DEVICE_MODEL.starts(
    *("damping", "gain", "held_gain", "arm", "command", "weight", "push", "held")
)
TASK, ACTS, COMPENSATED, DEAD_ZONE, ANGULAR_DEAD_ZONE, LIFTS = DEVICE_MODEL.starts(
    *("task", "acts", "compensated", "dead_zone", "angular_dead_zone", "lifts")
)
SENSES_ITSELF, OBSERVER_SHARE, ACTUATOR_SHARE, INERTIA = DEVICE_MODEL.starts(
    "senses_itself", "observer_share", "actuator_share", "inertia"
)
HAND = DEVICE_MODEL.size
# Of what a device reports of its hand's wrench.
MEASURED, ESTIMATED, ABSENT = 0.0, 1.0, 2.0
SPEED, REPORTED, APPLIED, BODY, SEEN = DEVICE_STATE.starts(
    "twist", "hand_wrench", "applied", "body", "seen"
)
HOME, ANCHOR, WINDOW, OWN = DEVICE_STATE.starts("home", "anchor", "window", "own")
PUBLISHED_SIZE, STATE_SIZE = BODY, DEVICE_STATE.size


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
        put(anchor, data[HELD:TASK])
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
        old = before[SPEED + i]
        out[SPEED + i] = old + data[FILTER] * (work[i] / data[PERIOD] - old)


@inner
def _measure(data: Array, before: Array, out: Array, work: Array) -> None:
    """Fill what the encoders say of the body in ``out``."""
    body, seen = out[BODY:SEEN], out[SEEN:HOME]
    if data[POSITION_STEP] == 0.0 and data[ANGLE_STEP] == 0.0:
        put(out[:3], body[:3])
        put(seen, body[3:12])
        put(out[SPEED:REPORTED], body[12:])
    else:
        _quantise(data, body, out[:3], seen, work)
        _estimate(data, before, out, work)
    quaternion_of(shaped(seen, (3, 3)), out[3:SPEED])


@inner
def _add_friction(
    share: float, dead_zone: float, coulomb: float, damping: float, rate: Array, given: Array
) -> None:
    """Fill a share of friction's force or torque (3,) at a rate (3,), none in the dead zone."""
    speed = np.sqrt(dot(rate, rate))
    known = min(max(speed / dead_zone - 1.0, 0.0), 1.0)
    for i in range(3):
        given[i] = 0.0
        if known > 0.0:
            given[i] = share * (known * (coulomb / speed + damping) * rate[i])


@inner
def compensate(data: Array, twist: Array, added: Array) -> None:
    """Fill what the driver adds (6,) to a command, at a measured twist (6,)."""
    added[:] = 0.0
    if data[COMPENSATED] > 0.0:
        share, turning = data[COMPENSATED], data[ANGULAR_DEAD_ZONE]
        friction, damping = data[FRICTION], data[DAMPING]
        _add_friction(share, data[DEAD_ZONE], friction, damping, twist[:3], added[:3])
        friction, damping = data[TURN_FRICTION], data[DAMPING + 3]
        _add_friction(share, turning, friction, damping, twist[3:], added[3:])
    for i in range(6):
        added[i] = data[TASK + i] * (added[i] - data[LIFTS] * data[WEIGHT + i])


@inner
def _estimate_hand(data: Array, before: Array, asked: Array, out: Array) -> None:
    """Fill what is reported of the hand without a sensor; see :mod:`.force_observer`.

    Args:
        data: the device.
        before: its state at the period's start.
        asked: (6,) of the actuators.
        out: its state at the end.
    """
    reported = out[REPORTED:APPLIED]
    if data[SENSES_ITSELF] == ABSENT:
        reported[:] = 0.0
        return
    mean, known = local(6), local(6)
    known[:] = 0.0
    for i in range(6):
        mean[i] = 0.5 * (before[SPEED + i] + out[SPEED + i])
    if data[COMPENSATED] > 0.0:
        share, turning = data[COMPENSATED], data[ANGULAR_DEAD_ZONE]
        _add_friction(share, data[DEAD_ZONE], data[FRICTION], 0.0, mean[:3], known[:3])
        _add_friction(share, turning, data[TURN_FRICTION], 0.0, mean[3:], known[3:])
    for i in range(6):
        given = asked[i] + data[ACTUATOR_SHARE] * (before[APPLIED + i] - asked[i])
        change = data[INERTIA + i] * (out[SPEED + i] - before[SPEED + i]) / data[PERIOD]
        pushed = change - given - data[TASK + i] * data[WEIGHT + i]
        resisted = data[DAMPING + i] * mean[i] + known[i]
        estimate = before[REPORTED + i]
        behind = data[TASK + i] * (pushed + resisted) - estimate
        reported[i] = estimate + data[OBSERVER_SHARE] * behind


@inner
def move_device(data: Array, state: Array, ticks: int, out: Array) -> None:
    """Fill ``out`` with the state one period after ``state``; see :func:`advance`."""
    scratch = local(24 + WORK_SIZE)
    force, asked, given = scratch[:6], scratch[6:12], scratch[12:18]
    before, work = scratch[18:24], scratch[24:]
    own, applied, body = out[OWN:], out[APPLIED:PUBLISHED_SIZE], out[BODY:SEEN]
    put(body, state[BODY:SEEN])
    put(out[HOME:OWN], state[HOME:OWN])
    put(applied, state[APPLIED:PUBLISHED_SIZE])
    put(asked, data[COMMAND:WEIGHT])
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
            force[i] = data[PUSH + i] + data[WEIGHT + i] + own[i] + given[i]
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
    if data[SENSES_ITSELF] != MEASURED:
        _estimate_hand(data, state, asked, out)


@inner
def command_device(data: Array, state: Array, command: Array) -> None:
    """Ask the actuators for a command (6,) and for what the driver adds at a state."""
    compensate(data, state[SPEED:REPORTED], data[COMMAND:WEIGHT])
    for i in range(6):
        asked = command[i] + data[COMMAND + i]
        data[COMMAND + i] = data[ACTS + i] * asked


@kernel("void(float64[::1], float64[::1], float64[::1], boolean, int64, float64[::1])")
def advance(data: Array, state: Array, command: Array, obeys: bool, ticks: int, out: Array) -> None:
    """Fill ``out`` with the state one period after ``state``.

    Args:
        data: the device, and what acts on it.
        state: (83,) where to start.
        command: (6,) to the actuators, N and N m, world axes.
        obeys: whether it is obeyed; else the actuators are off, and compensation with them.
        ticks: whole periods since the hand could take hold; -1 if nobody holds.
        out: (83,) to fill.
    """
    if obeys:
        command_device(data, state, command)
    else:
        data[COMMAND:WEIGHT] = 0.0
    move_device(data, state, ticks, out)


@kernel("void(float64[::1], float64[::1], float64[::1])")
def compensation(data: Array, twist: Array, added: Array) -> None:
    """Fill what the driver adds (6,) to a command, at a measured twist (6,)."""
    compensate(data, twist, added)
