# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The controllers of Fig. 3 as one kernel, from flat measurements to wrenches.

A scene and a clutch fix the :class:`~hapticmech_ros.control.loop_layout.ControllerSettings`,
measurements records of :mod:`~hapticmech_ros.numerics.layout`.

Poses inside kernels: the logarithm, and the error between device and operational point.

Control laws in Python have :mod:`~hapticmech_ros.control.clutch` and
:mod:`~hapticmech_ros.control.measurements` for the same. Rotations are quaternions x, y, z, w here,
as they come: of any length but 0. Two that are equal then differ by no rotation at all, to the bit,
so a device at rest on a mechanism at rest is left at rest.

One direction of a simulated connection in kernels: messages that are late, uneven, and lost.

A message of number n that is sent at t arrives at t + d (1 + j u), with u evenly spread between -1
and 1, or not at all. The receiver takes the newest that has arrived; it drops one that a later one
has overtaken. u and the loss are functions of seed, direction and n: the same connection gives the
same bits, in a session and in a graph.

A channel is two arrays. Whole numbers: a
:class:`~hapticmech_ros.control.loop_layout.ChannelState`, then for each slot a
:class:`~hapticmech_ros.control.loop_layout.ChannelSlot`. And a message in each row of the other
one; the last row is the message that was received last.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel, local, put, shaped
from hapticmech_ros.control.loop_layout import (
    BRAKE,
    ChannelSlot,
    ChannelState,
    ControllerSettings,
    ControlWrenches,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import (
    DeviceSample,
    OperationalModelSample,
    Pose,
)
from hapticmech_ros.numerics.saturation import limit
from hapticmech_ros.numerics.small_matrices import cross, dot

STATE_SIZE, SLOT_SIZE = ChannelState.layout.size, ChannelSlot.layout.size
MODEL_SIZE = OperationalModelSample.layout.size
# Two random numbers, of loss and delay, for each message.
DRAWS = 2
NANOSECONDS = 1e9
WORDS = 18446744073709551616.0


@inner
def mixed(number: int | np.uint64) -> np.uint64:
    """Return 64 bits without any pattern: SplitMix64 (Steele, Lea, Flood 2014)."""
    bits = np.uint64(number) + np.uint64(1)
    bits = bits * np.uint64(0x9E3779B97F4A7C15)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))


@inner
def drawn(stream: int | np.int64, index: int) -> float:
    """Return the random number of an index, in [0, 1]."""
    return float(np.float64(mixed(np.uint64(stream) + np.uint64(index))) / WORDS)


@inner
def slot_of(numbers: Array, slot: int) -> ChannelSlot:
    """Return a slot of a channel's whole numbers."""
    return ChannelSlot(numbers[STATE_SIZE + SLOT_SIZE * slot :])


@kernel(
    "boolean(int64[::1], float64[:,::1], float64, float64, float64, int64,"
    " int64, Array(float64, 1, 'C', readonly=True))"
)
def send(
    numbers: Array,
    rows: Array,
    delay: float,
    jitter: float,
    loss: float,
    time_ns: int,
    tag: int,
    message: Array,
) -> bool:
    """Send a message; return whether there is room for it.

    Args:
        numbers: (5 + 3 slots,) whole numbers of the channel, changed.
        rows: (slots + 1, n) messages in flight, and the last one that arrived.
        delay: d, s.
        jitter: j, share of the delay.
        loss: share of messages that do not arrive.
        time_ns: now.
        tag: a number that goes with it.
        message: (n,) numbers.
    """
    state = ChannelState(numbers)
    number, stream = state.sent, np.int64(state.stream)
    state.sent += 1
    if loss > 0.0 and drawn(stream, DRAWS * number) < loss:
        state.lost += 1
        return True
    uneven = 2.0 * drawn(stream, DRAWS * number + 1) - 1.0 if jitter > 0.0 else 0.0
    late = int(np.rint(delay * (1.0 + jitter * uneven) * NANOSECONDS))
    for row in range(rows.shape[0] - 1):
        slot = slot_of(numbers, row)
        if slot.number < 0:
            slot.arrives, slot.number, slot.tag = time_ns + late, number, tag
            put(rows[row], message)
            return True
    return False


@kernel("boolean(int64[::1], float64[:,::1], int64)")
def receive(numbers: Array, rows: Array, time_ns: int) -> bool:
    """Put the newest message that has arrived since the last call into the last row, if any.

    Args:
        numbers: (5 + 3 slots,) whole numbers of the channel, changed.
        rows: (slots + 1, n) messages in flight, and the last one that arrived.
        time_ns: present time, ns.

    Returns:
        Whether one has arrived.
    """
    state, last, found = ChannelState(numbers), rows.shape[0] - 1, -1
    for row in range(last):
        slot = slot_of(numbers, row)
        number = slot.number
        if number < 0 or slot.arrives > time_ns:
            continue
        slot.number = -1
        if number > state.newest:
            state.newest, state.tag, found = number, slot.tag, row
    if found < 0:
        return False
    put(rows[last], rows[found])
    return True


# Below this θ², rad², three terms of a series are exact to rounding.
SMALL_SQUARE = 1e-3


@inner
def follow(second: Array, first: Array, out: Array) -> None:
    """Put the rotation by ``first``, then by ``second``, into ``out``, which is neither of them."""
    cross(second[:3], first[:3], out[:3])
    for i in range(3):
        out[i] += second[3] * first[i] + second[i] * first[3]
    along = second[0] * first[0] + second[1] * first[1] + second[2] * first[2]
    out[3] = second[3] * first[3] - along


@inner
def turn_between(start: Array, end: Array, out: Array) -> None:
    """Put the rotation, world axes, that takes ``start`` to ``end`` into ``out``, neither of them.

    Zero to the bit where they are equal: products cancel in pairs.
    """
    cross(start[:3], end[:3], out[:3])
    for i in range(3):
        out[i] += end[i] * start[3] - end[3] * start[i]
    along = end[0] * start[0] + end[1] * start[1] + end[2] * start[2]
    out[3] = end[3] * start[3] + along


@inner
def log6(rotation: Array, translation: Array, out: Array) -> None:
    """Fill ``out`` (6,) with the logarithm of a pose: V⁻¹(ω) t, then ω; m and rad, 0 ≤ θ ≤ π.

    V⁻¹(ω) t = t - ½ ω × t + β ω × (ω × t),   β = (1 - θ/2 cot θ/2) / θ²

    Args:
        rotation: (4,) quaternion.
        translation: (3,) m.
        out: to fill.
    """
    linear, angle = out[:3], out[3:]
    x, y, z, cosine = rotation[0], rotation[1], rotation[2], rotation[3]
    sine = np.sqrt(x * x + y * y + z * z)
    # q and -q are one rotation.
    half = np.arctan2(sine, abs(cosine))
    ratio = 2.0 * half / sine if sine > 0.0 else 2.0 / abs(cosine)
    if cosine < 0.0:
        ratio = -ratio
    angle[0], angle[1], angle[2] = ratio * x, ratio * y, ratio * z
    square = 4.0 * half * half
    if square < SMALL_SQUARE:
        beta = 1.0 / 12.0 + square * (1.0 / 720.0 + square / 30240.0)
    else:
        beta = (1.0 - half * abs(cosine) / sine) / square
    turned = shaped(local(2 * 3), (2, 3))
    cross(angle, translation, turned[0])
    cross(angle, turned[0], turned[1])
    for i in range(3):
        linear[i] = translation[i] - 0.5 * turned[0, i] + beta * turned[1, i]


@inner
def carry_on(position: Array, quaternion: Array, twist: Array, duration: float, out: Pose) -> None:
    """Fill ``out`` with a frame's pose after ``duration`` (s).

    Args:
        position: (3,) of the frame, m.
        quaternion: (4,) likewise.
        twist: (6,) of its origin, constant, world axes, m/s and rad/s.
        duration: s, may be negative.
        out: to fill.
    """
    turn, place = local(4), out.position
    x, y, z = duration * twist[3], duration * twist[4], duration * twist[5]
    angle = np.sqrt(x * x + y * y + z * z)
    ratio = np.sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    turn[0], turn[1], turn[2], turn[3] = ratio * x, ratio * y, ratio * z, np.cos(0.5 * angle)
    follow(turn, quaternion, out.quaternion)
    for i in range(3):
        place[i] = position[i] + duration * twist[i]


@inner
def clutch_error(
    settings: ControllerSettings,
    device: DeviceSample,
    model: OperationalModelSample,
    ahead: float,
    error: Array,
) -> None:
    """Fill ``error`` (6,) with e, from the point, carried on, to the device through the clutch.

    In world axes log(point⁻¹ device) is the logarithm of the rotation from one to the other and of
    the translation from origin to origin.

    Args:
        settings: with the clutch.
        device: its sample.
        model: the point's.
        ahead: s, for which the point is carried on.
        error: to fill, m and rad.
    """
    point, mapped, between, way = Pose(local(7)), local(4), local(4), local(3)
    carry_on(model.position, model.quaternion, model.twist, ahead, point)
    follow(device.quaternion, settings.turn, mapped)
    turn_between(point.quaternion, mapped, between)
    for i in range(3):
        way[i] = device.position[i] + settings.displacement[i] - point.position[i]
    log6(between, way, error)


@inner
def displacement(start: Pose, end: Pose, way: Array) -> None:
    """Fill ``way`` (6,) with the displacement from one pose to another, world axes; m and rad.

    The translation from origin to origin, and the rotation vector of end start⁻¹. Equal poses
    differ by nothing, to the bit.

    Args:
        start: with a quaternion of length 1.
        end: the same, later.
        way: to fill.
    """
    turn = local(4)
    turn_between(start.quaternion, end.quaternion, turn)
    x, y, z, cosine = turn[0], turn[1], turn[2], turn[3]
    sine = np.sqrt(x * x + y * y + z * z)
    scale = 2.0 * np.arctan2(sine, abs(cosine)) / sine if sine > 0.0 else 0.0
    # q and -q are one rotation.
    if cosine < 0.0:
        scale = -scale
    for i in range(3):
        way[i] = end.position[i] - start.position[i]
        way[3 + i] = scale * turn[i]


@inner
def scale_within(wrench: Array, force_limit: float, torque_limit: float) -> None:
    """Shorten a wrench (6,) as a whole, as saturation.py does."""
    force = np.sqrt(dot(wrench[:3], wrench[:3]))
    torque = np.sqrt(dot(wrench[3:], wrench[3:]))
    excess = max(force / force_limit, torque / torque_limit)
    if excess > 1.0:
        for i in range(6):
            wrench[i] /= excess


@inner
def limit_wrench(wrench: Array, force_limit: float, torque_limit: float) -> None:
    """Shorten force and torque of a wrench (6,) each to its limit."""
    limit(wrench[:3], force_limit)
    limit(wrench[3:], torque_limit)


@inner
def let_through(settings: ControllerSettings, time: float) -> float:
    """Return the share of springs at ``time`` (s): see :meth:`Clutch.ramp`."""
    duration, begun = settings.ramp, settings.engaged_at
    if duration <= 0.0:
        return 1.0
    if settings.carries == 0.0:
        duration *= 0.5
        begun += duration
    return float(min(max((time - begun) / duration, 0.0), 1.0))


@inner
def brake(settings: ControllerSettings, time: float, mass: float, damping: float) -> float:
    """Return the share of a damper on a mass at ``time`` (s): see :meth:`Clutch.brake`."""
    if settings.carries != 0.0:
        return float(let_through(settings, time))
    left = settings.engaged_at + 0.5 * settings.ramp - time
    if left <= 0.0 or damping * left <= BRAKE * mass:
        return 1.0
    return float(BRAKE * mass / (damping * left))


@inner
def force_let_through(settings: ControllerSettings, time: float) -> float:
    """Return the share of the force channel: see :meth:`Clutch.force_ramp`."""
    return 1.0 if settings.carries == 0.0 else let_through(settings, time)


@kernel("void(ControllerSettings, DeviceSample, OperationalModelSample, float64, float64[::1])")
def hand_on_mechanism(
    settings: ControllerSettings,
    device: DeviceSample,
    model: OperationalModelSample,
    time: float,
    commanded: Array,
) -> None:
    """Fill the wrench that measured forces command on the mechanism, s (C3 F_h + C5 F_c).

    Args:
        settings: what the scene and the clutch fix.
        device: the device's sample.
        model: the operational model.
        time: s.
        commanded: (6,) to fill, N and N m, world axes.
    """
    through, task = force_let_through(settings, time), settings.task
    for i in range(6):
        hand, touch = device.hand_wrench[i], model.contact[i]
        commanded[i] = through * task[i] * (settings.c3 * hand + settings.c5 * touch)


@inner
def parts(
    settings: ControllerSettings,
    device: DeviceSample,
    model: OperationalModelSample,
    time: float,
    out: ControlWrenches,
) -> None:
    """Fill all but ``out.on_hand``, without the device's limits, given e in it."""
    task, inertia, beta = settings.task, settings.inertia, settings.feedforward
    stiffness, damping = settings.stiffness, settings.damping
    held_stiffness, held_damping = settings.held_stiffness, settings.held_damping
    spring, damper = settings.joint_stiffness, settings.joint_damping
    c1, c2, c4, c6 = settings.c1, settings.c2, settings.c4, settings.c6
    x, p_c, share = model.inverse_inertia, model.constraint_projector, model.wrench_projector
    free, twist, contact = model.free_acceleration, model.twist, model.contact
    ramp, through = let_through(settings, time), force_let_through(settings, time)
    damper *= brake(settings, time, inertia[0], damper)
    hand_on_mechanism(settings, device, model, time, out.on_mechanism)
    push, pull, coupling, drive, held = local(6), local(6), local(6), local(6), local(6)
    error = out.error
    for i in range(6):
        error[i] *= task[i]
        rate = task[i] * (device.twist[i] - twist[i])
        hand = task[i] * device.hand_wrench[i]
        push[i] = hand + c2 * (task[i] * contact[i])
        drive[i] = push[i] + c6 * hand
        pull[i] = ramp * spring * error[i] + damper * rate
        slow = brake(settings, time, inertia[i], damping[i]) * damping[i]
        coupling[i] = ramp * stiffness[i] * error[i] + slow * rate
        slow = brake(settings, time, inertia[i], held_damping[i]) * held_damping[i]
        held[i] = ramp * held_stiffness[i] * error[i] + slow * rate
    for i in range(6):
        motion = inertia[i] * (dot(x[i], drive) + free[i])
        joined = ramp * (1.0 - beta) * dot(share[i], push)
        out.on_mechanism[i] += c1 * coupling[i]
        out.impedance[i] = task[i] * (through * (motion - push[i]) + joined)
        out.joint_constraint[i] = -dot(p_c[i], pull)
        in_range = c4 * (held[i] - dot(share[i], held))
        out.four_channel[i] = through * (c2 * (task[i] * contact[i])) - in_range
    if through > 0.0:
        force_limit, torque_limit = settings.joint_force_limit, settings.joint_torque_limit
        scale_within(out.joint_constraint, through * force_limit, through * torque_limit)


@kernel(
    "void(ControllerSettings, DeviceSample, OperationalModelSample, float64, float64,"
    " ControlWrenches)"
)
def answer_measurements(
    settings: ControllerSettings,
    device: DeviceSample,
    model: OperationalModelSample,
    time: float,
    ahead: float,
    out: ControlWrenches,
) -> None:
    """Fill a control period's wrenches.

    Args:
        settings: what the scene and the clutch fix.
        device: the device's sample.
        model: the operational model.
        time: s.
        ahead: s, for which the point's pose is carried on.
        out: to fill.
    """
    clutch_error(settings, device, model, ahead, out.error)
    parts(settings, device, model, time, out)
    for i in range(6):
        out.on_hand[i] = out.impedance[i] + out.joint_constraint[i] + out.four_channel[i]
    limit_wrench(out.on_hand, settings.force_limit, settings.torque_limit)
    limit_wrench(out.on_mechanism, settings.force_limit, settings.torque_limit)
