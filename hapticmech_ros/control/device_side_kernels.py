# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The device's side of the rendering loop in kernels: commands corrected, then held to passivity.

A command answers an earlier sample. With its G, K and B,

    u = u' + G (F_h - F_h') - K ξ - B (v - v') + Σ H_j (F_j - F_j') + a lead

is the controllers' answer to the device's newest sample, and to the hands' wrenches until the next
one (:mod:`~hapticmech_ros.control.account_kernels`, :mod:`~hapticmech_ros.control.other_hands`).
The result is then limited to the energy available, see :mod:`~hapticmech_ros.control.passivity`.
Accounts and answers are records of :mod:`~hapticmech_ros.control.loop_layout`.

It also computes the wrench on the device over a period.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel, local, put
from hapticmech_ros.control.account_kernels import lead, remember
from hapticmech_ros.control.kernels import displacement, limit_wrench
from hapticmech_ros.control.loop_layout import (
    Answer,
    DeviceAccount,
    HandMemory,
    HandsCorrection,
)
from hapticmech_ros.device.safety_kernels import Safety, stay_bounded, stay_within
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import DeviceSample, LocalModel
from hapticmech_ros.numerics.small_matrices import add_scaled


@inner
def queue_answer(account: DeviceAccount, queue: Array, arrived: Array) -> int:
    """Put an answer into the queue (delay + 1, ...); return the row of the one that acts now."""
    delay = queue.shape[0] - 1
    at = int(account.queue_at)
    # The row after the one that is filled is the oldest.
    put(queue[at], arrived)
    account.queue_at = (at + 1) % (delay + 1)
    return int((at + 1) % (delay + 1))


@inner
def act(
    device: DeviceAccount,
    safety: Safety,
    answers: Array,
    sample: DeviceSample,
    hand: HandMemory,
    applied: Array,
    added: Array,
    others: HandsCorrection,
    on_hand: Array,
) -> None:
    """Fill the wrench that acts on the hand from now on.

    Args:
        device: its account.
        safety: its envelope.
        answers: (delay + 2, ...) answers that do not act yet, the row after them, and the last one
            that has arrived.
        sample: of the device.
        hand: its last wrenches.
        applied: (6,) by the actuators until now.
        added: (6,) by the device's driver to the next command.
        others: what corrects it for other hands.
        on_hand: (6,) to fill.
    """
    rows = answers.shape[0] - 1
    now = Answer(answers[queue_answer(device, answers[:rows], answers[rows])])
    remember(hand, device.period, sample.hand_wrench)
    command, given = now.wrenches.on_hand, now.to_mechanism
    if now.given == 0.0:
        on_hand[:], given = 0.0, np.nan
    elif now.modelled == 0.0:
        put(on_hand, command)
    else:
        correct(command, now.model, now.sample, sample, hand, device.period, others, on_hand)
    allow_command(device, safety, on_hand, sample, applied, added, given)


@inner
def account_for_actuators(account: DeviceAccount, sample: DeviceSample, applied: Array) -> None:
    """Account for the period until a sample, over which actuators held ``applied`` (6,), N, N m."""
    if account.pose_known != 0.0:
        way, taken, driven = local(6), 0.0, 0.0
        displacement(account.pose, sample, way)
        for i in range(6):
            # In the middle of the period, and half of it later.
            net = applied[i] - account.added[i] + sample.hand_wrench[i]
            pushed = 0.5 * account.period * net
            account.rate[i] = way[i] / account.period + pushed / account.inertia[i]
            taken += applied[i] * way[i]
            driven += account.added[i] * way[i]
        account.actuators -= taken - driven
    account.pose_known = 1.0
    put(account.pose.position, sample.position)
    put(account.pose.quaternion, sample.quaternion)
    for i in range(6):
        account.applied[i] = applied[i] - account.added[i] if account.kept != 0.0 else 0.0


@inner
def take_energy(account: DeviceAccount, given: float) -> None:
    """Store the received E_m, J, or NaN; the account begins with the first one.

    Energy that a controller without E_m gave before is no debt that the next one's damping must
    recover.
    """
    if np.isnan(given):
        account.received = 0.0
        return
    if account.received == 0.0:
        account.actuators = account.dissipated = 0.0
    account.received, account.mechanism = 1.0, given


@inner
def energy_available(account: DeviceAccount) -> float:
    """Return the energy that the actuators may give now, J; infinite while E_m is not known."""
    if account.received == 0.0 or account.passive == 0.0:
        return float(np.inf)
    given = account.mechanism
    least = min(0.0, given) - account.allowance
    return float(account.actuators - max(least, given - account.slack))


@inner
def predicted_transfer(account: DeviceAccount, command: Array, twist: Array, hand: Array) -> float:
    """Return the predicted energy that a command (6,) gives in the next period, J."""
    total, ahead, moved, inertia = 0.0, account.ahead, account.moved, account.inertia
    for i in range(6):
        way = ahead * twist[i] + moved * (command[i] + hand[i]) / inertia[i]
        total += command[i] * way
    return total


@inner
def least_root(square: float, slope: float, constant: float) -> float:
    """Return the least root above 0 of square λ² + slope λ + constant; infinite if there is none.

    ``constant`` is above 0.
    """
    discriminant = slope * slope - 4.0 * square * constant
    if square <= 0.0 or slope >= 0.0 or discriminant < 0.0:
        return float(np.inf)
    # Without cancellation: slope is below 0.
    return float(2.0 * constant / (-slope + np.sqrt(discriminant)))


@inner
def share_within(
    account: DeviceAccount, command: Array, twist: Array, hand: Array, available: float
) -> float:
    """Return the largest share of a command (6,) that gives no more than is available, J."""
    square, slope, ahead, moved, inertia = 0.0, 0.0, account.ahead, account.moved, account.inertia
    for i in range(6):
        square += command[i] * command[i] / inertia[i]
        way = ahead * twist[i] + moved * hand[i] / inertia[i]
        slope += command[i] * way
    square *= moved
    if square <= 0.0 or square + slope <= available:
        return 1.0
    if available <= 0.0:
        # The share that gives least.
        return float(min(max(-0.5 * slope / square, 0.0), 1.0))
    root = (-slope + np.sqrt(slope * slope + 4.0 * square * available)) / (2.0 * square)
    return float(min(max(root, 0.0), 1.0))


@inner
def hold_within(
    account: DeviceAccount, command: Array, twist: Array, hand: Array, available: float
) -> None:
    """Add the least damping to a command (6,) that limits it to the energy available, J."""
    given, momentum = predicted_transfer(account, command, twist, hand), local(6)
    square, slope, ahead, moved, inertia = 0.0, 0.0, account.ahead, account.moved, account.inertia
    for i in range(6):
        momentum[i] = inertia[i] * twist[i]
        way = ahead * twist[i] + moved * (command[i] + hand[i]) / inertia[i]
        slope += momentum[i] * way + moved * (twist[i] * command[i])
        square += moved * (momentum[i] * twist[i])
    damping = least_root(square, -slope, given - available)
    enough = damping <= account.most_damping
    if not enough:
        best = 0.5 * slope / square if square > 0.0 else 0.0
        damping = min(max(best, 0.0), account.most_damping)
    add_scaled(command, -damping, momentum)
    if not enough:
        share = share_within(account, command, twist, hand, available)
        for i in range(6):
            command[i] *= share


@inner
def enforce(account: DeviceAccount, command: Array, sample: DeviceSample, added: Array) -> bool:
    """Limit a command (6,) to the energy that may be given; return whether that changed it.

    The driver's wrench ``added`` (6,) for weight and friction stays in the device and does not
    count; N and N m, world axes.
    """
    put(account.added, added)
    available = energy_available(account)
    if available == np.inf:
        return False
    acting, hand = local(6), sample.hand_wrench
    for i in range(6):
        acting[i] = account.acts[i] * command[i]
    limit_wrench(acting, account.force_limit, account.torque_limit)
    if account.kept != 0.0:
        for i in range(6):
            acting[i] += account.kept * (account.applied[i] - acting[i])
    seen = sample.twist
    given = predicted_transfer(account, acting, seen, hand)
    if account.filtered != 0.0:
        other = predicted_transfer(account, acting, account.rate, hand)
        if other > given:
            seen = account.rate
        given = max(given, other)
    if given <= available:
        return False
    account.changed += 1.0
    hold_within(account, acting, seen, hand, available)
    account.dissipated += given - predicted_transfer(account, acting, seen, hand)
    # Actuators that lag do it a little later: undoing their lag would shake the device.
    put(command, acting)
    return True


@kernel(
    "void(float64[::1], LocalModel, DeviceSample, DeviceSample, HandMemory, float64,"
    " HandsCorrection, float64[::1])"
)
def correct(
    command: Array,
    model: LocalModel,
    answered: DeviceSample,
    now: DeviceSample,
    hand: HandMemory,
    period: float,
    others: HandsCorrection,
    found: Array,
) -> None:
    """Fill a command for the device as it is now.

    Args:
        command: (6,) of the controller, N and N m, world axes.
        model: how it depends on the device.
        answered: the device's sample that the command answers.
        now: its newest sample.
        hand: the hand's last wrenches.
        period: T, s, over which the command is held.
        others: what corrects it for other hands.
        found: (6,) to fill, N and N m, world axes.
    """
    way = local(6)
    displacement(answered, now, way)
    for i in range(6):
        total = 0.0
        for j in range(6):
            total += model.force[i, j] * (now.hand_wrench[j] - answered.hand_wrench[j])
            total -= model.stiffness[i, j] * way[j]
            total -= model.damping[i, j] * (now.twist[j] - answered.twist[j])
        found[i] = command[i] + total + others.change[i]
    lead(hand, period, model.force, others, found)


@kernel(
    "void(DeviceAccount, Safety, float64[::1], DeviceSample, float64[::1], float64[::1], float64)"
)
def allow_command(
    account: DeviceAccount,
    safety: Safety,
    command: Array,
    sample: DeviceSample,
    applied: Array,
    added: Array,
    given: float,
) -> None:
    """Account for the last period, and limit the command for the next one.

    To the safety envelope, and to passivity. Passivity control comes last but for the bounds of
    force and workspace: it has to predict the energy that is given, and a slew rate after it would
    let old commands give more.

    Args:
        account: of the device, changed.
        safety: the envelope, changed.
        command: (6,) on the hand, by the device, N and N m, world axes; changed.
        sample: of the device now.
        applied: (6,) by the actuators, taken as held over the period; N and N m, world axes.
        added: (6,) by the device's driver, N and N m, world axes.
        given: E_m, J, as received; NaN while no controller sends it.
    """
    account_for_actuators(account, sample, applied)
    take_energy(account, given)
    stay_within(safety, command, sample.position)
    if enforce(account, command, sample, added):
        stay_bounded(safety, command, sample.position)
