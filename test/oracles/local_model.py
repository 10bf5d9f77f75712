# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a command would be for the device as it is now: loops closed in the device itself.

    u = u' + G (F_h - F_h') - K ξ - B (v - v') + G W (F̄_h - F_h),      K = k P_c,   B = b P_c

is the controllers' answer to the device as it is now, found from their answer u' to a sample some
time ago, ξ the displacement since then. G closes the force channel, K and B the joint-constraint
controller: along constrained directions the operational point stays where it is, so that nothing
but the device's own motion is missing in an answer that is late. Both are exact for any delay, as
long as X has not changed in it and no limit is met. F̄_h is the mean of F_h until the next sample,
as far as it can be carried on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control import Clutch, ControlArchitecture, OperationalModel
from hapticmech_ros.control.loop_stability import force_gain
from hapticmech_ros.layout import DEVICE_SAMPLE

TWIST, FORCE = DEVICE_SAMPLE.slice("twist"), DEVICE_SAMPLE.slice("hand_wrench")


_NOTHING = np.zeros((6, 6))
_NOTHING.flags.writeable = False


class LocalModel(NamedTuple):
    """How a command depends on the device, (6, 6) each, world axes.

    Attributes:
        force: G, N and N m of the device per N and N m of the hand.
        stiffness: K, N/m, N, N, N m/rad.
        damping: B, N s/m, N s, N s, N m s/rad.
    """

    force: Array
    stiffness: Array
    damping: Array

    @property
    def numbers(self) -> Array:
        """All of it (108,), row by row."""
        return np.concatenate(self).ravel()


NO_MODEL = LocalModel(_NOTHING, _NOTHING, _NOTHING)


def local_model(
    control: ControlArchitecture, time: float, clutch: Clutch, model: OperationalModel
) -> LocalModel:
    """Return how a control's answer depends on the device, as let through at ``time`` (s)."""
    joint, force = control.gains.joint_constraint, control.gains.force_channel
    ramp = clutch.ramp(time)
    within = np.outer(control.task, control.task)
    gain = spring = damper = NO_MODEL.force
    if force.local:
        x, share = model.inverse_inertia, model.wrench_projector
        feedback = force.device_feedback
        balanced = force_gain(control.device_inertia, x, share, 1.0, feedback)
        rest = ramp * (1.0 - joint.feedforward) * share
        gain = within * (clutch.force_ramp(time) * balanced + rest)
    if joint.local:
        projector = within * model.constraint_projector
        slowed = clutch.brake(time, joint.damping / control.device_inertia[0, 0])
        spring, damper = ramp * joint.stiffness * projector, slowed * joint.damping * projector
    return LocalModel(gain, spring, damper)


def corrected(
    command: Array,
    model: LocalModel,
    answered: Array,
    now: Array,
    hand: Sequence[Array] = (),
) -> Array:
    """Return a command (6,) for the device as it is now.

    Args:
        command: (6,) of the controller.
        model: how it depends on the device.
        answered: (19,) the device's sample that the command answers.
        now: (19,) its newest sample.
        hand: (6,) F_h of the samples before, newest first, a period apart.
    """
    if model is NO_MODEL:
        return command
    push = model.force @ (now[FORCE] - answered[FORCE])
    spring = model.stiffness @ displacement(answered, now)
    damper = model.damping @ (now[TWIST] - answered[TWIST])
    return np.asarray(command + push - spring - damper + led(model.force, [now[FORCE], *hand]))


def led(gain: Array, hand: Sequence[Array]) -> Array:
    """Return G (F' + (1 - 8/5 R²) (1 + 2 R²)⁻¹ F''), R = 1 + G, (6,): F̄ - F by its last samples.

    Args:
        gain: (6, 6) G.
        hand: (6,) F_h, newest first, a period apart.
    """
    if len(hand) < 2:
        return np.zeros(6)
    found = gain @ (0.5 * (hand[0] - hand[1]))
    if len(hand) > 2:
        square = (np.eye(6) + gain) @ (np.eye(6) + gain)
        bend = 5.0 / 12.0 * (hand[0] - 2.0 * hand[1] + hand[2])
        weight = (np.eye(6) - 1.6 * square) @ np.linalg.inv(np.eye(6) + 2.0 * square)
        found = found + gain @ weight @ bend
    return np.asarray(found)


def displacement(start: Array, end: Array) -> Array:
    """Return the way (6,) from one pose to another: m, and rotation vector in rad, world axes.

    Args:
        start: (7,) or more, position and unit quaternion x, y, z, w first.
        end: the same, later.
    """
    x, y, z, a, b, c, w = start[:7].tolist()
    x1, y1, z1, a1, b1, c1, w1 = end[:7].tolist()
    # Of end start⁻¹; equal ones differ by nothing, to the bit.
    i = a1 * w - w1 * a - (b1 * c - c1 * b)
    j = b1 * w - w1 * b - (c1 * a - a1 * c)
    k = c1 * w - w1 * c - (a1 * b - b1 * a)
    cosine = w1 * w + a1 * a + b1 * b + c1 * c
    sine = math.sqrt(i * i + j * j + k * k)
    if sine == 0.0:
        return np.array((x1 - x, y1 - y, z1 - z, 0.0, 0.0, 0.0))
    # q and -q are one rotation.
    scale = math.copysign(2.0 * math.atan2(sine, abs(cosine)) / sine, cosine)
    return np.array((x1 - x, y1 - y, z1 - z, scale * i, scale * j, scale * k))
