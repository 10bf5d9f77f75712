# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a device's samples can be one motion: see :mod:`~hapticmech_ros.device.safety`.

For translation and rotation alike, with samples Δt apart, Δp the displacement between their poses
(a rotation vector), v their twists, and v̄ the mean of both:

    d⁺ = e d + v̄ Δt - Δp,   h⁺ = e h + Δv,   e = exp(-Δt/T)

d is the difference between the twist's integral and the poses' displacement within the last T. A
twist that has passed a filter with a lag τ makes d = -τ h, so the distance of d from all -τ h with
τ from 0 to LONGEST_LAG is checked. It may be at most

    slack + a Δt²/4 + u (Δt/2 + SHARE T)

a Δt²/4 is the error that an acceleration a makes in v̄ Δt, for the longest Δt within T; u is the
largest speed within T: half a Δt of it allows for stamps that are late, a share for a wrong scale.
There, and where speeds are compared, Δt is no shorter than the period of the scene.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel, local, put, shaped
from hapticmech_ros.compilation.records import Nested, Number, Record, Vector
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import DeviceSample
from hapticmech_ros.numerics.rotation_kernels import log3, multiply_transposed, rotation_of
from hapticmech_ros.numerics.small_matrices import subtract3

SHARE, LONGEST_LAG = 0.1, 0.015
# Samples further apart, s, are not compared.
LONGEST_GAP = 0.1
SOUND, SPEED, ACCELERATION, DISAGREES, AWAY = 0, 1, 2, 3, 4
ROTATION = 8


class Motion(Record):
    """Limits of a device's samples, and the check's state.

    For translation and rotation: m, m/s and m/s², rad, rad/s and rad/s².

    Attributes:
        window: T of two windows, s.
        most_speed, most_acceleration: of translation and rotation.
        slack: by window, of translation and rotation.
        reach: furthest from the first sample, m.
        period: s.
        started: 1 if there was a sample.
        first: its position, m.
        sample: the last one, see ``layout.DeviceSample``.
        apart, change: d and h, by window, of translation and rotation.
        speed, curve: the largest speed and a Δt²/4 within a window, likewise.
        found, most: the value that was found last, and its limit.
    """

    window = Vector(2)
    most_speed = Vector(2)
    most_acceleration = Vector(2)
    slack = Vector(4)
    reach = Number()
    period = Number()
    started = Number()
    first = Vector(3)
    sample = Nested(DeviceSample)
    apart = Vector(12)
    change = Vector(12)
    speed = Vector(4)
    curve = Vector(4)
    found = Number()
    most = Number()


@inner
def _length(vector: Array) -> float:
    return float(np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2))


@inner
def is_too_fast(twist: Array, most: Array) -> bool:
    """Return whether a device moves faster than possible.

    Args:
        twist: (6,) m/s and rad/s.
        most: (2,) ``device.motion.speed`` and ``angular_speed``, m/s and rad/s.
    """
    return not (_length(twist) <= most[0] and _length(twist[3:]) <= most[1])


@inner
def _exceeds(motion: Motion, found: float, most: float) -> bool:
    """Return whether a value exceeds its limit, and store both then."""
    exceeds = not found <= most
    if exceeds:
        motion.found = found
        motion.most = most
    return exceeds


@inner
def _forget(motion: Motion) -> None:
    """Let poses and twists agree from now on."""
    motion.apart[:] = 0.0
    motion.change[:] = 0.0
    motion.speed[:] = 0.0
    motion.curve[:] = 0.0


@inner
def _begin(motion: Motion, sample: DeviceSample) -> None:
    """Let a sample be the first one."""
    put(motion.first, sample.position)
    _forget(motion)
    motion.started = 1.0


@inner
def _from_lag(apart: Array, change: Array) -> float:
    """Return the distance of d (3,) from all -τ h, h (3,)."""
    along, square = 0.0, 0.0
    for i in range(3):
        along -= apart[i] * change[i]
        square += change[i] * change[i]
    lag = min(max(along / square, 0.0), LONGEST_LAG) if square > 0.0 else 0.0
    total = 0.0
    for i in range(3):
        total += (apart[i] + lag * change[i]) ** 2
    return float(np.sqrt(total))


@inner
def _disagrees(
    motion: Motion, moved: Array, now: Array, before: Array, elapsed: float, part: int
) -> bool:
    """Return whether poses and twists disagree, of translation (part 0) or rotation (1)."""
    speed, pace = max(_length(now), _length(before)), max(elapsed, motion.period)
    curve = 0.25 * motion.most_acceleration[part] * pace * pace
    wrong = False
    for window in range(2):
        span, index = motion.window[window], 2 * window + part
        left = np.exp(-elapsed / span)
        apart = motion.apart[3 * index : 3 * index + 3]
        change = motion.change[3 * index : 3 * index + 3]
        for i in range(3):
            apart[i] = left * apart[i] + 0.5 * elapsed * (now[i] + before[i]) - moved[i]
            change[i] = left * change[i] + now[i] - before[i]
        top = max(left * motion.speed[index], speed)
        bend = max(left * motion.curve[index], curve)
        motion.speed[index], motion.curve[index] = top, bend
        most = motion.slack[index] + bend + top * (0.5 * pace + SHARE * span)
        if not wrong and _exceeds(motion, _from_lag(apart, change), most):
            wrong = True
            if window == 0:
                # After a jump the new pose counts from now on; a slow drift stays a fault.
                _forget(motion)
                break
    return wrong


@inner
def _follow(
    motion: Motion, sample: DeviceSample, last: DeviceSample, before: Array, elapsed: float
) -> int:
    """Return the fault code between a sample and the one before it."""
    twist, moved, pace = sample.twist, local(6), max(elapsed, motion.period)
    subtract3(sample.position, last.position, moved)
    now_axes, last_axes, turn = local(9), local(9), local(9)
    rotation_of(sample.quaternion, shaped(now_axes, (3, 3)))
    rotation_of(last.quaternion, shaped(last_axes, (3, 3)))
    multiply_transposed(shaped(now_axes, (3, 3)), shaped(last_axes, (3, 3)), shaped(turn, (3, 3)))
    log3(shaped(turn, (3, 3)), moved[3:])
    for part in range(2):
        at, change = 3 * part, local(3)
        subtract3(twist[at:], before[at:], change)
        # Encoder steps make a twist of their own.
        most = motion.most_acceleration[part] + motion.slack[part] / (pace * pace)
        if _exceeds(motion, _length(change) / pace, most):
            _forget(motion)
            return ACCELERATION + part * ROTATION
        if _disagrees(motion, moved[at:], twist[at:], before[at:], elapsed, part):
            return DISAGREES + part * ROTATION
    return SOUND


@kernel("int64(Motion, DeviceSample, float64)")
def follow_sample(motion: Motion, sample: DeviceSample, elapsed: float) -> int:
    """Return whether a sample can follow the one before it: one of the codes above.

    Args:
        motion: limits and state, changed.
        sample: the sample.
        elapsed: s since the one before it.
    """
    last = motion.sample
    twist, before = sample.twist, local(6)
    put(before, last.twist)
    code = SOUND
    for part in range(2):
        if _exceeds(motion, _length(twist[3 * part :]), motion.most_speed[part]):
            code = SPEED + part * ROTATION
            break
    follows = motion.started != 0.0 and 0.0 < elapsed <= LONGEST_GAP
    if not follows:
        _begin(motion, sample)
    elif code == SOUND:
        code = _follow(motion, sample, last, before, elapsed)
    if code == SOUND:
        moved = local(3)
        subtract3(sample.position, motion.first, moved)
        if _exceeds(motion, _length(moved), motion.reach):
            code = AWAY
    put(last.values, sample.values)
    return code
