# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The device's side of the rendering loop in kernels: commands corrected, then held to passivity.

A command answers a sample of some time ago. With G, K and B as it comes with them

    u = u' + G (F_h - F_h') - K ξ - B (v - v') + Σ H_j (F_j - F_j') + a lead

is the controllers' answer to the device as it is now, and to what hands do until the next sample
(:mod:`~hapticmech_ros.control.account_kernels`, :mod:`~hapticmech_ros.control.other_hands`). What
is then given is held to what there is, as :mod:`~hapticmech_ros.control.passivity` says. Arrays are
laid out as :mod:`~hapticmech_ros.control.loop_layout` says.

What acts on device and mechanism over a period: what is on the way, and both sides' share.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel, local, put
from hapticmech_ros.control.account_kernels import (
    ANSWERED,
    FORCE_GAIN,
    GIVEN_THEN,
    IS_ANSWER,
    MODELLED,
    PUSH,
    WRENCHES,
    lead,
    passive_wrench,
    queue_wrench,
    remember,
)
from hapticmech_ros.control.kernels import displacement
from hapticmech_ros.control.loop_layout import COMMANDED, DEVICE_ACCOUNT, ON_HAND, ON_MECHANISM
from hapticmech_ros.device.safety_kernels import Safety, stay_bounded, stay_within
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import DEVICE_SAMPLE, OPERATIONAL_MODEL
from hapticmech_ros.numerics.saturation import limit


@inner
def queue_answer(account: Array, queue: Array, arrived: Array) -> int:
    """Put an answer into the queue (delay + 1, ...); return the row of the one that acts now."""
    delay = queue.shape[0] - 1
    at = int(account[QUEUE_AT])
    # The row after the one that is filled is the oldest.
    put(queue[at], arrived)
    account[QUEUE_AT] = (at + 1) % (delay + 1)
    return int((at + 1) % (delay + 1))


@inner
def act(
    controller: Array,
    given: Array,
    commanded: Array,
    device: Array,
    safety: Array,
    answers: Array,
    sample: Array,
    hand: Array,
    applied: Array,
    added: Array,
    others: Array,
    wrenches: Array,
) -> None:
    """Fill what acts on both sides from now on.

    Args:
        controller: the controller's account.
        given: the last answer that was given, whether it has arrived or not.
        commanded: (delay, 6) the wrenches commanded on the mechanism that do not act yet.
        device: the device's account.
        safety: its envelope, a :class:`~hapticmech_ros.device.safety_kernels.Safety`.
        answers: (delay + 2, ...) answers that do not act yet, the row after them, and the last one
            that has arrived.
        sample: (19,) of the device.
        hand: (22,) the hand's last wrenches; see ``hand_lead_kernels``.
        applied: (6,) by the actuators until now.
        added: (6,) by the device's driver, to the next command.
        others: (19,) what corrects it for other hands; see ``other_hands``.
        wrenches: (3, 6) to fill: on the hand by the device, on the mechanism by the hand, and what
            the mechanism gets.
    """
    rows = answers.shape[0] - 1
    passive_wrench(controller, given, wrenches[COMMANDED])
    queue_wrench(controller, commanded, wrenches[COMMANDED], wrenches[ON_MECHANISM])
    now = answers[queue_answer(device, answers[:rows], answers[rows])]
    account_for_actuators(device, sample, applied)
    remember(hand, device[PERIOD], sample[PUSH : PUSH + 6])
    if now[IS_ANSWER] == 0.0:
        wrenches[ON_HAND] = 0.0
    else:
        take_energy(device, now[GIVEN_THEN])
        command = now[WRENCHES : WRENCHES + 6]
        if now[MODELLED] == 0.0:
            put(wrenches[ON_HAND], command)
        else:
            model, answered = now[FORCE_GAIN:ANSWERED], now[ANSWERED:GIVEN_THEN]
            found = wrenches[ON_HAND]
            correct(command, model, answered, sample, hand, device[PERIOD], others, found)
    allow(device, safety, wrenches[ON_HAND], sample, added)


ACTS, MOST_FORCE, MOST_TORQUE, PERIOD, KEPT, AHEAD, MOVED, MOST_DAMPING, FILTERED = (
    DEVICE_ACCOUNT.starts(
        *("acts", "force_limit", "torque_limit", "period", "kept", "ahead", "moved"),
        *("most_damping", "filtered"),
    )
)
PASSIVE, ALLOWANCE, SLACK, ACTUATORS, MECHANISM, RECEIVED, DISSIPATED, CHANGED = (
    DEVICE_ACCOUNT.starts(
        *(
            "passive",
            "allowance",
            "slack",
            "actuators",
            "mechanism",
            "received",
            "dissipated",
            "changed",
        )
    )
)
PLACED, PLACE, ADDED, RATE, APPLIED, QUEUE_AT = DEVICE_ACCOUNT.starts(
    "pose_known", "pose", "added", "rate", "applied", "queue_at"
)
SPEED = DEVICE_SAMPLE.start("twist")
TWIST = OPERATIONAL_MODEL.start("twist")


@inner
def account_for_actuators(account: Array, sample: Array, applied: Array) -> None:
    """Account for the period until a sample (19,), over which ``applied`` (6,) was held."""
    if account[PLACED] != 0.0:
        way, taken, driven = local(6), 0.0, 0.0
        displacement(account[PLACE:ADDED], sample, way)
        for i in range(6):
            # In the middle of the period, and half of it later.
            pushed = 0.5 * account[PERIOD] * (applied[i] - account[ADDED + i] + sample[PUSH + i])
            account[RATE + i] = way[i] / account[PERIOD] + pushed / account[i]
            taken += applied[i] * way[i]
            driven += account[ADDED + i] * way[i]
        account[ACTUATORS] -= taken - driven
    account[PLACED] = 1.0
    for i in range(7):
        account[PLACE + i] = sample[i]
    for i in range(6):
        acts = applied[i] - account[ADDED + i]
        account[APPLIED + i] = acts if account[KEPT] != 0.0 else 0.0


@inner
def take_energy(account: Array, given: float) -> None:
    """Take E_m, J, as it is received, or NaN; the account begins with the first one."""
    if np.isnan(given):
        account[RECEIVED] = 0.0
        return
    if account[RECEIVED] == 0.0:
        account[ACTUATORS] = account[DISSIPATED] = 0.0
    account[RECEIVED], account[MECHANISM] = 1.0, given


@inner
def energy_available(account: Array) -> float:
    """Return what the actuators may give now, J; infinite while E_m is not known."""
    if account[RECEIVED] == 0.0 or account[PASSIVE] == 0.0:
        return float(np.inf)
    given = account[MECHANISM]
    least = min(0.0, given) - account[ALLOWANCE]
    return float(account[ACTUATORS] - max(least, given - account[SLACK]))


@inner
def predicted_transfer(account: Array, command: Array, twist: Array, hand: Array) -> float:
    """Return what a command (6,) gives in the next period, J, as far as can be predicted."""
    total = 0.0
    for i in range(6):
        way = account[AHEAD] * twist[i] + account[MOVED] * (command[i] + hand[i]) / account[i]
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
    account: Array, command: Array, twist: Array, hand: Array, available: float
) -> float:
    """Return the largest share of a command (6,) that gives no more than is available, J."""
    square, slope = 0.0, 0.0
    for i in range(6):
        square += command[i] * command[i] / account[i]
        way = account[AHEAD] * twist[i] + account[MOVED] * hand[i] / account[i]
        slope += command[i] * way
    square *= account[MOVED]
    if square <= 0.0 or square + slope <= available:
        return 1.0
    if available <= 0.0:
        # The share that gives least.
        return float(min(max(-0.5 * slope / square, 0.0), 1.0))
    root = (-slope + np.sqrt(slope * slope + 4.0 * square * available)) / (2.0 * square)
    return float(min(max(root, 0.0), 1.0))


@inner
def hold_within(
    account: Array, command: Array, twist: Array, hand: Array, available: float
) -> None:
    """Change a command (6,) by as little damping as holds it to what is available, J."""
    given = predicted_transfer(account, command, twist, hand)
    momentum, square, slope = local(6), 0.0, 0.0
    for i in range(6):
        momentum[i] = account[i] * twist[i]
        way = account[AHEAD] * twist[i] + account[MOVED] * (command[i] + hand[i]) / account[i]
        slope += momentum[i] * way + account[MOVED] * (twist[i] * command[i])
        square += account[MOVED] * (momentum[i] * twist[i])
    damping = least_root(square, -slope, given - available)
    if damping <= account[MOST_DAMPING]:
        for i in range(6):
            command[i] -= damping * momentum[i]
        return
    best = 0.5 * slope / square if square > 0.0 else 0.0
    damping = min(max(best, 0.0), account[MOST_DAMPING])
    for i in range(6):
        command[i] -= damping * momentum[i]
    share = share_within(account, command, twist, hand, available)
    for i in range(6):
        command[i] *= share


@inner
def enforce(account: Array, command: Array, sample: Array, added: Array) -> bool:
    """Hold a command (6,) to what may be given; return whether that changed it.

    See :func:`enforce_passivity`.
    """
    put(account[ADDED : ADDED + 6], added)
    available = energy_available(account)
    if available == np.inf:
        return False
    acting, twist, hand = local(6), sample[SPEED:PUSH], sample[PUSH : PUSH + 6]
    for i in range(6):
        acting[i] = account[ACTS + i] * command[i]
    limit(acting[:3], account[MOST_FORCE])
    limit(acting[3:], account[MOST_TORQUE])
    if account[KEPT] != 0.0:
        for i in range(6):
            acting[i] += account[KEPT] * (account[APPLIED + i] - acting[i])
    given, rate = predicted_transfer(account, acting, twist, hand), account[RATE : RATE + 6]
    moves_on = account[FILTERED] != 0.0
    if moves_on:
        other = predicted_transfer(account, acting, rate, hand)
        moves_on = other > given
        given = max(given, other)
    if given <= available:
        return False
    seen = local(6)
    if moves_on:
        put(seen, rate)
    else:
        put(seen, twist)
    account[CHANGED] += 1.0
    hold_within(account, acting, seen, hand, available)
    account[DISSIPATED] += given - predicted_transfer(account, acting, seen, hand)
    # Actuators that lag do it a little later: undoing their lag would shake the device.
    put(command, acting)
    return True


@inner
def allow(account: Array, safety: Array, command: Array, sample: Array, added: Array) -> None:
    """Change a command (6,) into what leaves: within the safety envelope, and passive.

    Passivity control comes last but for the bounds of force and workspace: it has to predict the
    energy that is given, and a slew rate after it would let old commands give more.
    """
    envelope = Safety(safety)
    stay_within(envelope, command, sample[:3])
    if enforce(account, command, sample, added):
        stay_bounded(envelope, command, sample[:3])


@inner
def correct(
    command: Array,
    model: Array,
    answered: Array,
    now: Array,
    hand: Array,
    period: float,
    others: Array,
    found: Array,
) -> None:
    """Fill a command (6,) for the device as it is now; see :func:`correct_command`."""
    way = local(6)
    displacement(answered, now, way)
    for i in range(6):
        total = 0.0
        for j in range(6):
            at = 6 * i + j
            total += model[at] * (now[PUSH + j] - answered[PUSH + j])
            total -= model[36 + at] * way[j]
            total -= model[72 + at] * (now[SPEED + j] - answered[SPEED + j])
        found[i] = command[i] + total + others[i]
    lead(hand, period, model[:36], others[6:], found)


@kernel("void(float64[::1], float64[::1], float64[::1])")
def record_sample(account: Array, sample: Array, applied: Array) -> None:
    """Account for the period until a sample (19,), over which actuators held ``applied`` (6,).

    Args:
        account: (account,) of the device, changed; see ``loop_layout``.
        sample: (19,) of the device now, in SI units; see ``layout.DEVICE_SAMPLE``.
        applied: (6,) by the actuators, taken as held over the period; N and N m, world axes.
    """
    account_for_actuators(account, sample, applied)


@kernel(
    "void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1],"
    " float64)"
)
def allow_command(
    account: Array,
    safety: Array,
    command: Array,
    sample: Array,
    applied: Array,
    added: Array,
    given: float,
) -> None:
    """Account for the last period, and change a command into what leaves in the next one.

    Args:
        account: (account,) of the device, changed; see ``loop_layout``.
        safety: (numbers,) the envelope, a ``device.safety_kernels.Safety``; changed.
        command: (6,) on the hand, by the device, N and N m, world axes; changed.
        sample: (19,) of the device now, in SI units; see ``layout.DEVICE_SAMPLE``.
        applied: (6,) by the actuators, taken as held over the period; N and N m, world axes.
        added: (6,) by the device's driver, N and N m, world axes.
        given: E_m, J, as it was received; NaN while nobody sends it.
    """
    account_for_actuators(account, sample, applied)
    take_energy(account, given)
    allow(account, safety, command, sample, added)


@kernel("float64(float64[::1])")
def available_energy(account: Array) -> float:
    """Return what the actuators may give now, J.

    Args:
        account: (account,) of the device; see ``loop_layout``.
    """
    return energy_available(account)


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1])")
def enforce_passivity(account: Array, command: Array, sample: Array, added: Array) -> None:
    """Change a command where it would give more than there is.

    Args:
        account: (account,) of the device, changed; see ``loop_layout``.
        command: (6,) on the hand, by the device, N and N m, world axes; changed.
        sample: (19,) of the device now, in SI units; see ``layout.DEVICE_SAMPLE``.
        added: (6,) by the device's driver, for its weight and friction, N and N m, world axes: what
            it gives stays in the device, and does not count.
    """
    enforce(account, command, sample, added)


@kernel(
    "void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64,"
    " float64[::1], float64[::1])"
)
def correct_command(
    command: Array,
    model: Array,
    answered: Array,
    now: Array,
    hand: Array,
    period: float,
    others: Array,
    found: Array,
) -> None:
    """Fill a command for the device as it is now.

    Args:
        command: (6,) of the controller, N and N m, world axes.
        model: (108,) G, K and B row by row, SI units: wrench per F_h, ξ and v.
        answered: (19,) the device's sample that the command answers, in SI units.
        now: (19,) its newest sample, likewise.
        hand: (22,) the hand's last wrenches; see ``hand_lead_kernels``.
        period: T, s, over which the command is held.
        others: (19,) what corrects it for other hands; see ``other_hands``.
        found: (6,) to fill, N and N m, world axes.
    """
    correct(command, model, answered, now, hand, period, others, found)
