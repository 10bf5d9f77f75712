# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The controllers of Fig. 3 as one kernel, from flat measurements to wrenches.

What a scene and a clutch fix is laid out as
:data:`~hapticmech_ros.control.loop_layout.SETTINGS`, measurements as
:mod:`~hapticmech_ros.layout` says.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, kernel, local, shaped
from hapticmech_ros.control.loop_layout import (
    BRAKE,
    FOUR_CHANNEL,
    IMPEDANCE,
    JOINT_CONSTRAINT,
    ON_HAND,
    ON_MECHANISM,
    POSE_ERROR,
    SETTINGS,
)
from hapticmech_ros.control.pose_kernels import clutch_error
from hapticmech_ros.layout import DEVICE_SAMPLE, OPERATIONAL_MODEL
from hapticmech_ros.mechanism.kernels.small_matrices import dot
from hapticmech_ros.saturation_kernels import limit

INERTIA, STIFFNESS, DAMPING, HELD_STIFFNESS, HELD_DAMPING = SETTINGS.starts(
    "inertia", "stiffness", "damping", "held_stiffness", "held_damping"
)
FEEDFORWARD, JOINT_STIFFNESS, JOINT_DAMPING, JOINT_FORCE_LIMIT, JOINT_TORQUE_LIMIT = (
    SETTINGS.starts(
        *("feedforward", "joint_stiffness", "joint_damping"),
        *("joint_force_limit", "joint_torque_limit"),
    )
)
C1, C2, C3, C4, C5, C6 = SETTINGS.starts("c1", "c2", "c3", "c4", "c5", "c6")
RAMP, CARRIES, FORCE_LIMIT, TORQUE_LIMIT, ENGAGED, CLUTCH = SETTINGS.starts(
    "ramp", "carries", "force_limit", "torque_limit", "engaged_at", "displacement"
)
DEVICE_SIZE, MODEL_SIZE = DEVICE_SAMPLE.size, OPERATIONAL_MODEL.size
RATE, PUSH = DEVICE_SAMPLE.starts("twist", "hand_wrench")
X, P_C, SHARE = OPERATIONAL_MODEL.starts(
    "inverse_inertia", "constraint_projector", "wrench_projector"
)
FREE, PLACE, TWIST, CONTACT = OPERATIONAL_MODEL.starts(
    "free_acceleration", "position", "twist", "contact"
)


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
def let_through(settings: Array, time: float) -> float:
    """Return the share of springs at ``time`` (s): see :meth:`Clutch.ramp`."""
    duration, begun = settings[RAMP], settings[ENGAGED]
    if duration <= 0.0:
        return 1.0
    if settings[CARRIES] == 0.0:
        duration *= 0.5
        begun += duration
    return float(min(max((time - begun) / duration, 0.0), 1.0))


@inner
def brake(settings: Array, time: float, mass: float, damping: float) -> float:
    """Return the share of a damper on a mass at ``time`` (s): see :meth:`Clutch.brake`."""
    if settings[CARRIES] != 0.0:
        return float(let_through(settings, time))
    left = settings[ENGAGED] + 0.5 * settings[RAMP] - time
    if left <= 0.0 or damping * left <= BRAKE * mass:
        return 1.0
    return float(BRAKE * mass / (damping * left))


@inner
def force_let_through(settings: Array, time: float) -> float:
    """Return the share of the force channel: see :meth:`Clutch.force_ramp`."""
    return 1.0 if settings[CARRIES] == 0.0 else let_through(settings, time)


@inner
def hand_on_mechanism(
    settings: Array, device: Array, operational_model: Array, time: float, told: Array
) -> None:
    """Fill what the mechanism is told (6,) of measured forces: s (C3 F_h + C5 F_c)."""
    through = force_let_through(settings, time)
    for i in range(6):
        hand, touch = device[PUSH + i], operational_model[CONTACT + i]
        told[i] = through * settings[i] * (settings[C3] * hand + settings[C5] * touch)


@inner
def parts(
    settings: Array, device: Array, operational_model: Array, time: float, out: Array
) -> None:
    """Fill all but the first row of ``out`` (6, 6), without the device's limits, given e in it."""
    task, inertia = settings[:INERTIA], settings[INERTIA:STIFFNESS]
    stiffness, damping = settings[STIFFNESS:DAMPING], settings[DAMPING:HELD_STIFFNESS]
    held_stiffness = settings[HELD_STIFFNESS:HELD_DAMPING]
    held_damping = settings[HELD_DAMPING:FEEDFORWARD]
    beta, spring = settings[FEEDFORWARD], settings[JOINT_STIFFNESS]
    damper = settings[JOINT_DAMPING]
    force_limit, torque_limit = settings[JOINT_FORCE_LIMIT], settings[JOINT_TORQUE_LIMIT]
    c1, c2, c4, c6 = settings[C1], settings[C2], settings[C4], settings[C6]
    x, p_c = shaped(operational_model[X:], (6, 6)), shaped(operational_model[P_C:], (6, 6))
    share, free = shaped(operational_model[SHARE:], (6, 6)), operational_model[FREE : FREE + 6]
    twist, contact = operational_model[TWIST : TWIST + 6], operational_model[CONTACT : CONTACT + 6]
    ramp, through = let_through(settings, time), force_let_through(settings, time)
    damper *= brake(settings, time, inertia[0], damper)
    hand_on_mechanism(settings, device, operational_model, time, out[ON_MECHANISM])
    room = shaped(local(30), (5, 6))
    push, pull, coupling, drive, held = room[0], room[1], room[2], room[3], room[4]
    error = out[POSE_ERROR]
    for i in range(6):
        error[i] *= task[i]
        rate = task[i] * (device[RATE + i] - twist[i])
        hand = task[i] * device[PUSH + i]
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
        out[ON_MECHANISM, i] += c1 * coupling[i]
        out[IMPEDANCE, i] = task[i] * (through * (motion - push[i]) + joined)
        out[JOINT_CONSTRAINT, i] = -dot(p_c[i], pull)
        in_range = c4 * (held[i] - dot(share[i], held))
        out[FOUR_CHANNEL, i] = through * (c2 * (task[i] * contact[i])) - in_range
    if through > 0.0:
        scale_within(out[JOINT_CONSTRAINT], through * force_limit, through * torque_limit)


@inner
def answer_measurements(
    settings: Array, device: Array, operational_model: Array, time: float, ahead: float, out: Array
) -> None:
    """Fill a control period's wrenches; see :func:`control_wrenches`."""
    place, twist = operational_model[PLACE:TWIST], operational_model[TWIST : TWIST + 6]
    clutch_error(settings[CLUTCH:], device[:7], place, twist, ahead, out[POSE_ERROR])
    parts(settings, device, operational_model, time, out)
    for i in range(6):
        out[ON_HAND, i] = out[IMPEDANCE, i] + out[JOINT_CONSTRAINT, i] + out[FOUR_CHANNEL, i]
    for row in (ON_HAND, ON_MECHANISM):
        limit(out[row, :3], settings[FORCE_LIMIT])
        limit(out[row, 3:], settings[TORQUE_LIMIT])


@kernel(
    "boolean(float64[::1], Array(float64, 1, 'C', readonly=True),"
    " Array(float64, 1, 'C', readonly=True), float64, float64, float64[:,::1])"
)
def control_wrenches(
    settings: Array, device: Array, operational_model: Array, time: float, ahead: float, out: Array
) -> bool:
    """Fill ``out`` (6, 6) with a control period's wrenches: rows as in :class:`ControlOutput`.

    Args:
        settings: (59,) what the scene and the clutch fix; see ``loop_layout``.
        device: (19,) the device's sample, in SI units; see ``layout.DEVICE_SAMPLE``.
        operational_model: (139,) in SI units; see ``layout.OPERATIONAL_MODEL``.
        time: s.
        ahead: s, for which the point's pose is carried on.
        out: (6, 6) to fill, N and N m, world axes.

    Returns:
        Whether the measurements have these sizes; nothing is computed otherwise.
    """
    if device.size != DEVICE_SIZE or operational_model.size != MODEL_SIZE:
        return False
    answer_measurements(settings, device, operational_model, time, ahead, out)
    return True


@kernel("void(float64[::1], float64[::1], float64[::1], float64, float64[::1])")
def forces_on_mechanism(
    settings: Array, device: Array, operational_model: Array, time: float, told: Array
) -> None:
    """Fill what the mechanism is told of measured forces, C3 F_h + C5 F_c.

    Args:
        settings: (59,) what the scene and the clutch fix; see ``loop_layout``.
        device: (19,) the device's sample, in SI units; see ``layout.DEVICE_SAMPLE``.
        operational_model: (139,) in SI units; see ``layout.OPERATIONAL_MODEL``.
        time: s.
        told: (6,) to fill, N and N m, world axes.
    """
    hand_on_mechanism(settings, device, operational_model, time, told)
