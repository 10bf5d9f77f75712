# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A period of the simulated device in one kernel, or a kernel for each of its substeps.

    (Λ_d + Λ_a) ẍ = F_s + F_o + u + w - b ẋ - f

u follows the command, limited by the actuators and held over a sample period (zero-order hold),
with the actuators' lag; F_o, by others than the hand, is held as well. The hand's own law F_s acts
all through the period, and its own mass Λ_a while it holds. w is weight, f end stops and Coulomb
friction. F_h, between device and hand, is
F_s - Λ_a ẍ. A mass behind a grip is a body of its own, moved by the same steps: F_s pulls it, and
F_h is what the grip's spring and damper exert.

A substep of length h drifts for h/2, changes the twist by the forces there, and drifts for h/2 with
the new one (position Verlet), so that a wrench acts by its mean over the substep to second order:

    p' = p + h/2 v,     v⁺ = v + h (Λ_d + Λ_a)⁻¹ (F_s(p', v') + ... - b (v + v⁺)/2)
    p⁺ = p' + h/2 v⁺

with v' = v + h/2 (Λ_d + Λ_a)⁻¹ (F_s + ... - b v) by the hand's wrench of the time before.

What the device is, and what acts on it, is one array, ``data``, and its state another one; they are
laid out as :mod:`~hapticmech_ros.device.kernels` says. Behind the device in ``data`` is its
hand, as :mod:`~hapticmech_ros.device.hand_kernels` says.

What resists a device's motion besides viscous damping: end stops, then Coulomb friction.

Both are implicit in the speed at the end of a step h, so that neither adds energy at any stiffness
or friction; g = h / m, or h / I of rotation.

End stop, along the way out n, where d is the distance beyond the limit in the middle of the step:
the force f = k (d + ½ h v⁺) + b v⁺, if positive, gives

    v⁺ = (v - g k d) / (1 + g (b + ½ h k))

without b where the speed turns round, since work is done by the mean of both speeds.

Coulomb friction takes up to g F_c of the speed, never more than there is:

    v⁺ = max(1 - g F_c / |v|, 0) v

A stop is three numbers: limit (m or rad, 0 for none), stiffness and damping.

What a device's driver does at the sample rate: compensation before, force sensing after.

The hand's wrench without a sensor is a momentum observer's, from encoders and actuators. Momentum
p = Λ_d v changes by all that acts. What is known of it, actuators u, weight w, viscous damping b v
and friction f, is taken off, and the rest is passed through a low-pass r:

    ṙ = ω (ṗ - u - w + b v + f - r),      ω = 2 π bandwidth

over a period T, with means of the period and the exact step of the low-pass,

    r⁺ = r + (1 - e^(-ω T)) (Λ_d (v⁺ - v) / T - u - w + b (v + v⁺) / 2 + f - r)

(after De Luca and Mattone, "Sensorless robot collision detection and hybrid force/motion control",
ICRA 2005, here for a body in Cartesian space). A constant wrench is found without bias, a sinusoid
of frequency f Hz lags by arctan(f / bandwidth) and half a period. What the model does not know is
taken for the hand: Coulomb friction beyond its compensated share, end stops, an error of the mass.

What a simulated device is, and its state: arrays that its kernels work on.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel, local, put, shaped
from hapticmech_ros.device.hand_kernels import (
    LIMB_MASS,
    OPEN,
    WORK_SIZE,
    grasp_window,
    grip_wrench,
    hand_wrench,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import DEVICE_SAMPLE, TWIST, WRENCH, Field, Layout
from hapticmech_ros.numerics.rotation_kernels import (
    exp3,
    log3,
    multiply,
    multiply_transposed,
    quaternion_of,
)
from hapticmech_ros.numerics.saturation import limit
from hapticmech_ros.numerics.small_matrices import dot

ONE, THREE, SIX, PLACE = Field(1), Field(3), Field(6), Field(12)
# Step and period, s; number of steps in a period; gain of the velocity filter; limits of the
# actuators, N and N m; steps of the encoders, m and rad, 0 if ideal; of the actuators' error what
# is left after a step, and its mean over one, per unit, 0 if there is none; Coulomb friction, N and
# N m; end stops: limit, stiffness and damping; damping; change of the twist per wrench and step, 0
# where the scene has no direction, and the same with the hand's own mass; that mass and inertia.
# Then what acts: command, weight, the wrench by others than the hand; and where the hand could take
# hold: position and rotation.
# Of the driver: 1 where the scene has a direction; 1 where there are actuators; share of the
# friction that is compensated, from which speeds on, m/s and rad/s; 1 if weight is; 1 if what it
# reports of the hand is estimated, and 2 if it is nothing; share of the observer's error that a
# period takes away; share of the actuators' error in a period's mean; and Λ_d.
DEVICE_MODEL = Layout(
    {
        **dict.fromkeys(("step", "period", "substeps", "filter_gain"), ONE),
        **dict.fromkeys(("force_limit", "torque_limit", "position_step", "angle_step"), ONE),
        **dict.fromkeys(("lag", "lag_mean", "friction", "angular_friction"), ONE),
        **dict.fromkeys(("stop", "angular_stop"), THREE),
        **dict.fromkeys(("damping", "gain", "held_gain", "arm"), SIX),
        **dict.fromkeys(("command", "weight", "push"), SIX),
        "held": PLACE,
        **dict.fromkeys(("task", "acts"), SIX),
        **dict.fromkeys(("compensated", "dead_zone", "angular_dead_zone", "lifts"), ONE),
        **dict.fromkeys(("senses_itself", "observer_share", "actuator_share"), ONE),
        "inertia": SIX,
    }
)
# What is published: what is measured, the wrench of the hand as it is reported, and the wrench
# applied; and what is not: position, rotation and twist of the body; measured rotation; where the
# device started, and where the hand took hold; the window in which it holds; position, rotation and
# twist of its mass behind a grip, and what pulls that; and its wrench. Rotations go row by row.
DEVICE_STATE = Layout(
    {
        **DEVICE_SAMPLE.fields,
        "applied": Field(6, WRENCH),
        "body": PLACE,
        "body_twist": Field(6, TWIST),
        "seen": Field(9),
        "home": PLACE,
        "anchor": PLACE,
        "window": ONE,
        "limb": PLACE,
        "limb_twist": Field(6, TWIST),
        "pull": Field(6, WRENCH),
        "own": Field(6, WRENCH),
    }
)


STEP, PERIOD, SUBSTEPS, FILTER = DEVICE_MODEL.starts("step", "period", "substeps", "filter_gain")
POSITION_STEP, ANGLE_STEP, LAG, LAG_MEAN = DEVICE_MODEL.starts(
    "position_step", "angle_step", "lag", "lag_mean"
)
FRICTION, TURN_FRICTION, STOP, TURN_STOP = DEVICE_MODEL.starts(
    "friction", "angular_friction", "stop", "angular_stop"
)
DAMPING, GAIN, HELD_GAIN, ARM, COMMAND, WEIGHT, PUSH, HELD, TASK = DEVICE_MODEL.starts(
    *("damping", "gain", "held_gain", "arm", "command", "weight", "push", "held", "task")
)
HAND = DEVICE_MODEL.size
SPEED, REPORTED, APPLIED, BODY, SEEN = DEVICE_STATE.starts(
    "twist", "hand_wrench", "applied", "body", "seen"
)
HOME, ANCHOR, WINDOW, LIMB, PULL, OWN = DEVICE_STATE.starts(
    "home", "anchor", "window", "limb", "pull", "own"
)
PUBLISHED_SIZE = BODY
MOST_FORCE, MOST_TORQUE = DEVICE_MODEL.starts("force_limit", "torque_limit")
ACTS, COMPENSATED, DEAD_ZONE, ANGULAR_DEAD_ZONE, LIFTS = DEVICE_MODEL.starts(
    *("acts", "compensated", "dead_zone", "angular_dead_zone", "lifts")
)
SENSES_ITSELF, OBSERVER_SHARE, ACTUATOR_SHARE, INERTIA = DEVICE_MODEL.starts(
    "senses_itself", "observer_share", "actuator_share", "inertia"
)
# Of what a device reports of its hand's wrench.
MEASURED, ESTIMATED, ABSENT = 0.0, 1.0, 2.0


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
def estimate_hand(data: Array, before: Array, out: Array) -> None:
    """Fill what is reported of the hand without a sensor; r⁺ of the module.

    Args:
        data: the device, and what its actuators were asked for.
        before: its state at the period's start.
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
        asked = data[COMMAND + i]
        given = asked + data[ACTUATOR_SHARE] * (before[APPLIED + i] - asked)
        change = data[INERTIA + i] * (out[SPEED + i] - before[SPEED + i]) / data[PERIOD]
        pushed = change - given - data[TASK + i] * data[WEIGHT + i]
        resisted = data[DAMPING + i] * mean[i] + known[i]
        estimate = before[REPORTED + i]
        behind = data[TASK + i] * (pushed + resisted) - estimate
        reported[i] = estimate + data[OBSERVER_SHARE] * behind


@inner
def command_device(data: Array, state: Array, command: Array) -> None:
    """Ask actuators, within their limits, for a command (6,) and what is added at a state."""
    compensate(data, state[SPEED:REPORTED], data[COMMAND:WEIGHT])
    for i in range(6):
        asked = command[i] + data[COMMAND + i]
        data[COMMAND + i] = data[ACTS + i] * asked
    limit(data[COMMAND : COMMAND + 3], data[MOST_FORCE])
    limit(data[COMMAND + 3 : WEIGHT], data[MOST_TORQUE])


@inner
def stop(end: Array, away: Array, rate: Array, gain: float, left: float) -> None:
    """Slow a rate (3,) of ``away`` (3,) down at the end of the workspace.

    ``left`` s are left of the step.
    """
    distance = np.sqrt(dot(away, away))
    if distance == 0.0:
        return
    beyond = distance - end[0]
    speed = dot(away, rate) / distance
    if beyond + left * speed <= 0.0:
        return
    pushed = speed - gain * end[1] * beyond
    damping = end[2] if pushed * speed >= 0.0 else 0.0
    after = pushed / (1.0 + gain * (damping + left * end[1]))
    if after < speed:
        for i in range(3):
            rate[i] += (after - speed) / distance * away[i]


@inner
def rub(rate: Array, most: float) -> None:
    """Take ``most`` of a rate (3,) away, or all."""
    speed = np.sqrt(dot(rate, rate))
    share = 0.0 if speed <= most else 1.0 - most / speed
    for i in range(3):
        rate[i] *= share


# Of a substep: the twist at its start, all forces but the hand's, the hand's in its middle, and the
# twist of the mass behind a grip at its start.
BEFORE_SIZE = 24


@inner
def _drift(data: Array, body: Array, work: Array) -> None:
    """Carry the pose of a body (18,) on by half a substep."""
    turn, turned = shaped(work[3:12], (3, 3)), shaped(work[12:21], (3, 3))
    half, twist = 0.5 * data[STEP], body[12:]
    for i in range(3):
        body[i] += half * twist[i]
        work[i] = half * twist[3 + i]
    exp3(work[:3], turn)
    multiply(turn, shaped(body[3:12], (3, 3)), turned)
    put(body[3:12], work[12:21])


@inner
def _resist(data: Array, gain: Array, home: Array, body: Array, work: Array) -> None:
    """Let end stops and friction act on a body's twist in the middle of a substep."""
    left, rate, spin = 0.5 * data[STEP], body[12:15], body[15:18]
    if data[STOP] > 0.0:
        for i in range(3):
            work[i] = body[i] - home[i]
        stop(data[STOP:TURN_STOP], work[:3], rate, gain[0], left)
    if data[TURN_STOP] > 0.0:
        turn = shaped(work[3:12], (3, 3))
        multiply_transposed(shaped(body[3:12], (3, 3)), shaped(home[3:12], (3, 3)), turn)
        log3(turn, work[:3])
        stop(data[TURN_STOP:DAMPING], work[:3], spin, gain[5], left)
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
def time_of(data: Array, ticks: int, index: int) -> float:
    """Return s since the hand could take hold, ``index`` substeps into a period."""
    elapsed: float = (ticks + 1) * data[PERIOD]
    if index < data[SUBSTEPS]:
        elapsed = ticks * data[PERIOD] + index * data[STEP]
    return elapsed


@inner
def middle_of(data: Array, ticks: int, index: int) -> float:
    """Return s since the hand could take hold, in the middle of substep ``index`` of a period."""
    elapsed: float = ticks * data[PERIOD] + (index + 0.5) * data[STEP]
    return elapsed


@inner
def _take(data: Array, ticks: int, index: int, out: Array) -> None:
    """Fill the window in which the hand holds, and from where."""
    window = OPEN if ticks < 0 else grasp_window(data[HAND:], time_of(data, ticks, index))
    anchor = out[ANCHOR:WINDOW]
    if window == 0:
        put(anchor, data[HELD:TASK])
    elif window > 0 and window != out[WINDOW]:
        put(anchor, out[BODY : BODY + 12])
    if window != OPEN and window != out[WINDOW]:
        put(out[LIMB:PULL], out[BODY:SEEN])
    out[WINDOW] = window


@inner
def _has_limb(data: Array, out: Array) -> bool:
    """Return whether a mass behind a grip moves with the hand now."""
    moves: bool = out[WINDOW] != OPEN and data[HAND + LIMB_MASS] > 0.0
    return moves


@inner
def _speed_up(data: Array, out: Array, share: float) -> None:
    """Change the twist of the mass behind a grip by what acts on it over a share of a substep."""
    for i in range(6):
        gain = share * data[STEP] * data[TASK + i] / data[HAND + LIMB_MASS + i]
        out[LIMB + 12 + i] += gain * (out[PULL + i] - out[OWN + i])


@inner
def _push(data: Array, elapsed: float, out: Array, work: Array) -> None:
    """Fill the wrench of the scene's hand, ``elapsed`` (s) since it could hold, if it holds."""
    if out[WINDOW] == OPEN:
        out[OWN:] = 0.0
        return
    hand, body, anchor = data[HAND:], out[BODY:SEEN], out[ANCHOR:WINDOW]
    if _has_limb(data, out):
        limb = out[LIMB:PULL]
        hand_wrench(hand, elapsed, limb, anchor, out[PULL:OWN], work)
        grip_wrench(hand, limb, body, out[OWN:], work)
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
def _begin(data: Array, state: Array, ticks: int, out: Array) -> None:
    """Begin a period: ``out`` is where ``state`` is, and the hand takes hold if it is time to."""
    put(out[BODY:SEEN], state[BODY:SEEN])
    put(out[HOME:OWN], state[HOME:OWN])
    put(out[APPLIED:PUBLISHED_SIZE], state[APPLIED:PUBLISHED_SIZE])
    _take(data, ticks, 0, out)


@inner
def _half_substep(data: Array, out: Array, before: Array, work: Array) -> None:
    """Move ``out`` to the middle of a substep, with the twist that is predicted there.

    ``before`` (24,) is filled with the twists at its start, and all forces but the hand's.
    """
    body, own, given = out[BODY:SEEN], out[OWN:], work[:6]
    _give(data, data[COMMAND:WEIGHT], out[APPLIED:PUBLISHED_SIZE], given)
    put(before[:6], body[12:])
    _drift(data, body, work[6:])
    start = HELD_GAIN if out[WINDOW] != OPEN else GAIN
    for i in range(6):
        before[6 + i] = data[PUSH + i] + data[WEIGHT + i] + given[i]
        net = before[6 + i] + own[i] - data[DAMPING + i] * before[i]
        body[12 + i] += 0.5 * data[start + i] * net
    if _has_limb(data, out):
        put(before[18:], out[LIMB + 12 : PULL])
        _drift(data, out[LIMB:PULL], work[6:])
        _speed_up(data, out, 0.5)


@inner
def _end_substep(
    data: Array, ticks: int, index: int, out: Array, before: Array, work: Array
) -> bool:
    """End substep ``index`` from its middle; then the hand lets go or takes hold.

    ``before`` (24,) is as of :func:`_half_substep`, and is filled with the hand's wrench (6,) in
    the middle. Return whether the hand held.
    """
    body, own = out[BODY:SEEN], out[OWN:]
    held: bool = out[WINDOW] != OPEN
    start = HELD_GAIN if held else GAIN
    gain = data[start : start + 6]
    for i in range(6):
        lost = 0.5 * gain[i] * data[DAMPING + i]
        pushed = gain[i] * (before[6 + i] + own[i])
        body[12 + i] = ((1.0 - lost) * before[i] + pushed) / (1.0 + lost)
    put(before[12:18], own)
    if _has_limb(data, out):
        put(out[LIMB + 12 : PULL], before[18:])
        _speed_up(data, out, 1.0)
        _drift(data, out[LIMB:PULL], work)
    _resist(data, gain, out[HOME:ANCHOR], body, work)
    _drift(data, body, work)
    _take(data, ticks, index + 1, out)
    if out[WINDOW] == OPEN:
        own[:] = 0.0
    return held


@inner
def _finish(data: Array, state: Array, held: bool, before: Array, out: Array, work: Array) -> None:
    """Fill what is measured at the end of a period.

    Args:
        data: the device.
        state: at the period's start.
        held: whether the hand held in the last substep.
        before: (24,) as of :func:`_end_substep`, of that.
        out: at its end; of the hand's wrench its own mass takes its part away.
        work: (42,) scratch.
    """
    body, own = out[BODY:SEEN], out[OWN:]
    if data[ARM] + data[ARM + 3] > 0.0 and held and out[WINDOW] != OPEN:
        for i in range(6):
            # In the middle of the substep, and by how much the hand's wrench changes it since.
            rate = body[12 + i] - before[i] + data[HELD_GAIN + i] * (own[i] - before[12 + i])
            own[i] -= data[ARM + i] * (rate / data[STEP])
    put(out[REPORTED:APPLIED], own)
    _measure(data, state, out, work)
    if data[SENSES_ITSELF] != MEASURED:
        estimate_hand(data, state, out)


@inner
def move_device(data: Array, state: Array, ticks: int, out: Array) -> None:
    """Fill ``out`` with the state one period after ``state``; see :func:`advance`."""
    scratch, held = local(BEFORE_SIZE + WORK_SIZE), False
    before, work = scratch[:BEFORE_SIZE], scratch[BEFORE_SIZE:]
    substeps = int(data[SUBSTEPS])
    _begin(data, state, ticks, out)
    _push(data, time_of(data, ticks, 0), out, work)
    for index in range(substeps):
        _half_substep(data, out, before, work)
        _push(data, middle_of(data, ticks, index), out, work)
        held = _end_substep(data, ticks, index, out, before, work)
    _push(data, time_of(data, ticks, substeps), out, work)
    _finish(data, state, held, before, out, work)


@inner
def _command(data: Array, state: Array, command: Array, obeys: bool) -> None:
    """Ask the actuators for a command (6,) and what is added to it, or for nothing."""
    if obeys:
        command_device(data, state, command)
    else:
        data[COMMAND:WEIGHT] = 0.0


@kernel("void(float64[::1], float64[::1], float64[::1], boolean, int64, float64[::1])")
def advance(data: Array, state: Array, command: Array, obeys: bool, ticks: int, out: Array) -> None:
    """Fill ``out`` with the state one period after ``state``.

    Args:
        data: (numbers,) the device; see ``device_layout``.
        state: (107,) where to start.
        command: (6,) servo_cf, N and N m, world axes; the driver's compensation is added to it.
        obeys: whether it is obeyed; else the actuators are off, and compensation with them.
        ticks: whole periods since the hand could take hold; -1 if nobody holds.
        out: (107,) to fill.
    """
    _command(data, state, command, obeys)
    move_device(data, state, ticks, out)


@kernel("void(float64[::1], float64[::1], float64[::1], boolean, int64, float64[::1])")
def begin(data: Array, state: Array, command: Array, obeys: bool, ticks: int, out: Array) -> None:
    """Begin a period, arguments as of :func:`advance`, whose hand is not the scene's.

    Then, in the middle of each of the substeps that follow, and before :func:`finish`, the hand's
    wrench is to be put into ``out``: zero unless it holds.

    Args:
        data: (numbers,) the device; see ``device_layout``.
        state: (107,) at the period's start.
        command: (6,) servo_cf, N and N m, world axes; the driver's compensation is added to it.
        obeys: whether it is obeyed; else the actuators are off, and compensation with them.
        ticks: whole periods since the hand could take hold; -1 if nobody holds.
        out: (107,) to fill.
    """
    _command(data, state, command, obeys)
    _begin(data, state, ticks, out)


@kernel("void(float64[::1], float64[::1], float64[::1])")
def half_substep(data: Array, out: Array, before: Array) -> None:
    """Move ``out`` to the middle of a substep; its twist is the one predicted there.

    Args:
        data: (numbers,) the device; see ``device_layout``.
        out: (107,) state, changed.
        before: (24,) to fill in part, for :func:`end_substep`.
    """
    _half_substep(data, out, before, local(WORK_SIZE))


@kernel("boolean(float64[::1], int64, int64, float64[::1], float64[::1])")
def end_substep(data: Array, ticks: int, index: int, out: Array, before: Array) -> bool:
    """Move ``out`` from the middle of substep ``index`` to its end; return whether the hand held.

    Args:
        data: (numbers,) the device; see ``device_layout``.
        ticks: whole periods since the hand could take hold; -1 if nobody holds.
        index: of the substep.
        out: (107,) state, changed.
        before: (24,) of :func:`half_substep`, completed for :func:`finish`.
    """
    return _end_substep(data, ticks, index, out, before, local(WORK_SIZE))


@kernel("void(float64[::1], float64[::1], boolean, float64[::1], float64[::1])")
def finish(data: Array, state: Array, held: bool, before: Array, out: Array) -> None:
    """End a period that began at ``state``: fill what is measured; see :func:`end_substep`.

    Args:
        data: (numbers,) the device; see ``device_layout``.
        state: (107,) at the period's start.
        held: whether the hand held in the last substep.
        before: (24,) of the last substep; see :func:`end_substep`.
        out: (107,) state, completed.
    """
    _finish(data, state, held, before, out, local(WORK_SIZE))


@kernel("void(float64[::1], boolean, float64[::1])")
def stand(data: Array, holds: bool, out: Array) -> None:
    """Fill a device that stands still.

    Args:
        data: (numbers,) the device; see ``device_layout``.
        holds: whether the hand can take hold now.
        out: (107,) zero but for where it is, its home and its anchor.
    """
    work = local(WORK_SIZE)
    out[WINDOW] = grasp_window(data[HAND:], 0.0) if holds else OPEN
    put(out[LIMB:PULL], out[BODY:SEEN])
    _push(data, 0.0, out, work)
    _quantise(data, out[BODY:SEEN], out[:3], out[SEEN:HOME], work)
    quaternion_of(shaped(out[SEEN:HOME], (3, 3)), out[3:SPEED])
    if data[SENSES_ITSELF] == MEASURED:
        put(out[REPORTED:APPLIED], out[OWN:])


@kernel("void(float64[::1], float64[::1], float64[::1])")
def observe(data: Array, before: Array, out: Array) -> None:
    """Fill what is known of the hand from a device's motion, see above.

    Args:
        data: (numbers,) the device, and what its actuators did; see ``device_layout``.
        before: (107,) its state at the period's start.
        out: (107,) its state at the end, of which F_h is filled.
    """
    estimate_hand(data, before, out)


@kernel("void(float64[::1], float64[::1], float64[::1])")
def compensation(data: Array, twist: Array, added: Array) -> None:
    """Fill what the driver adds (6,) to a command, at a measured twist (6,).

    Args:
        data: (numbers,) the device; see ``device_layout``.
        twist: (6,) measured, m/s and rad/s, world axes.
        added: (6,) to fill, N and N m, world axes.
    """
    compensate(data, twist, added)
