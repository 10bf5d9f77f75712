# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What acts on device and mechanism over a period: what is on the way, and both sides' share."""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, put
from hapticmech_ros.control.account_kernels import (
    ANSWERED,
    FORCE_GAIN,
    GIVEN_THEN,
    IS_ANSWER,
    MODELLED,
    PUSH,
    WRENCHES,
    passive_wrench,
    queue_wrench,
)
from hapticmech_ros.control.device_side_kernels import (
    PERIOD,
    QUEUE_AT,
    account_for_actuators,
    allow,
    correct,
    take_energy,
)
from hapticmech_ros.control.hand_lead_kernels import remember
from hapticmech_ros.control.loop_layout import COMMANDED, ON_HAND, ON_MECHANISM


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
        safety: its envelope, a :data:`~hapticmech_ros.device.safety_kernels.SAFETY`.
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
