# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernel that answers the device's samples with two wrenches, and takes operational models."""

from __future__ import annotations

from hapticmech_ros.compilation import inner, kernel, put
from hapticmech_ros.control.account_kernels import (
    account_for_hand,
    account_for_motion,
    conclude,
    give_answer,
    passive_wrench,
    queue_wrench,
    remember_commanded,
)
from hapticmech_ros.control.loop_layout import (
    Answer,
    ControllerAccount,
    ControllerSettings,
    Locality,
)
from hapticmech_ros.device.motion_kernels import SOUND, Motion, follow_sample
from hapticmech_ros.nodes.lane_kernels import (
    MONOTONIC,
    NOTHING,
    OLDEST,
    OTHER,
    OWN,
    READS,
    SHORTEST_PAUSE_NS,
    TIME_IS_UP,
    TO_READ,
    TO_SEND,
    UNTIL,
    VIEW,
    note_read,
    pass_over,
    peek,
    publish_outside,
    send_to_all,
    take,
    time_of,
    wait_until,
    write_stamp,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import DeviceSample, OperationalModelSample
from hapticmech_ros.wire.kernels import (
    COMMANDED,
    GRASP,
    GRASP_SIZE,
    MODEL,
    MODEL_QUATERNION,
    OBEYS,
    QUATERNION_TOLERANCE,
    ROUND_TRIP,
    SAMPLE,
    SAMPLE_QUATERNION,
    UNSOUND,
    sound_stamp,
)

# How long inputs may be silent, and since when times count, ns; the period, ns; when the device was
# heard last, ns; stamp of the operational model, and of the one that was answered last, ns; the
# newest sample's stamp, and when it came; from which stamp on a sample's answer is to say how it
# depends on the device, and of the last one that was held against what a hand can move, ns.
TIMEOUT, EPOCH, PERIOD_NS, LAST, MODEL_NS, RENDERED, NEWEST, ARRIVED, GAIN_FROM, MOVED = range(
    OWN, OWN + 10
)
# Of device and analyser the number of the last message, and its stamp, ns.
OF_DEVICE, OF_ANALYSER = OWN + 10, OWN + 12
# Stamp of the sample that was answered last, ns; and how many were.
SAMPLE_NS, ANSWERS = OWN + 14, OWN + 15
LINK_SIZE = OWN + 16
# Which topics are read, and which are sent.
STATES, MODELS = 0, 1
TO_DEVICE, TO_POINT = 0, 1
# The point's pose is carried on by its twist over periods that the analysis has missed, by no more
# than this: beyond it the twist says nothing.
PREDICTION_LIMIT_S = 0.005


@inner
def has_paused(link: Array, sender: int, stamp: int, counted: int) -> bool:
    """Return whether a sender's stamps went on faster than its count, see ``SenderPauses``.

    Args:
        link: see above.
        sender: OF_DEVICE or OF_ANALYSER.
        stamp: of its message, ns.
        counted: the message's number.
    """
    periods = counted - link[sender]
    late = stamp - link[sender + 1] - periods * link[PERIOD_NS]
    return bool(periods > 0 and late > SHORTEST_PAUSE_NS)


@inner
def note_sender(link: Array, sender: int, stamp: int, counted: int) -> None:
    """Note a sender's message; arguments as of :func:`has_paused`."""
    link[sender], link[sender + 1] = counted, stamp


@inner
def plain_model(link: Array, values: Array, most: Array, grasp: Array, time: int) -> int:
    """Return the stamp, ns, of an operational model that keeps the rules, as before; or UNSOUND.

    Args:
        link: see above.
        values: (151,) the model.
        most: (151,) largest magnitudes.
        grasp: (7,) where the operational point is.
        time: now, ns of the node's time.
    """
    stamp = sound_stamp(values, most, MODEL_QUATERNION, QUATERNION_TOLERANCE)
    if stamp == UNSOUND or abs(time - stamp) > link[OLDEST] or values[COMMANDED] != 1.0:
        return UNSOUND
    for i in range(GRASP_SIZE):
        if values[GRASP + i] != grasp[i]:
            return UNSOUND
    return UNSOUND if time - link[LAST] > link[TIMEOUT] else stamp


@inner
def plain_sample(link: Array, values: Array, most: Array, round_trip: float, time: int) -> int:
    """Return the stamp, ns, of a sample that is answered as those before it were; or UNSOUND.

    Args:
        link: see above.
        values: (29,) the sample.
        most: (29,) largest magnitudes.
        round_trip: s, as the device has reported it.
        time: now, ns of the node's time.
    """
    stamp = sound_stamp(values, most, SAMPLE_QUATERNION, QUATERNION_TOLERANCE)
    if stamp == UNSOUND or abs(time - stamp) > link[OLDEST]:
        return UNSOUND
    if values[OBEYS] != 1.0 or values[ROUND_TRIP] != round_trip:
        return UNSOUND
    if stamp < link[NEWEST] or stamp == time or stamp >= link[GAIN_FROM] or link[VIEW] == 1:
        return UNSOUND
    silent = max(time - link[LAST], time - link[MODEL_NS])
    return UNSOUND if silent > link[TIMEOUT] else stamp


@inner
def keeps(wrench: Array, most: Array) -> bool:
    """Return whether a wrench (6,) is within its bounds (6,), which no NaN is."""
    kept = True
    for i in range(6):
        kept = kept and abs(wrench[i]) <= most[i]
    return kept


@kernel(
    "int64(int64[::1], int64[:, ::1], int64[:, ::1], int64[:, ::1], int64[::1], int64[::1],"
    " int64[::1], int64[::1], int64[:, ::1], float64[::1], float64[::1],"
    " int64[::1], int64[::1], int64[:, ::1], float64[::1], float64[::1],"
    " int64[::1], float64[::1], int64[::1], int64[::1], float64[::1], int64[::1], float64[::1],"
    " float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1],"
    " float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], float64[::1], float64[::1],"
    " float64[:, ::1], float64, int64[::1])",
    waits=True,
)
def answer_samples(
    link: Array,
    inputs: Array,
    passed: Array,
    outputs: Array,
    words: Array,
    polled: Array,
    state_frame: Array,
    state_prefix: Array,
    state_copies: Array,
    state: Array,
    state_most: Array,
    model_frame: Array,
    model_prefix: Array,
    model_copies: Array,
    model: Array,
    model_most: Array,
    device_frame: Array,
    to_device: Array,
    device_targets: Array,
    point_frame: Array,
    to_point: Array,
    point_targets: Array,
    most: Array,
    known: Array,
    grasp: Array,
    account: Array,
    before: Array,
    settings: Array,
    faded: Array,
    queue: Array,
    past: Array,
    locality: Array,
    answer: Array,
    motion: Array,
    moved: Array,
    wrenches: Array,
    round_trip: float,
    ages: Array,
) -> int:
    """Answer samples as they come.

    Args:
        link: (24,) what Python and kernel tell each other; see above and ``lane_kernels``.
        inputs: (2, 8) likewise, of the samples and the models.
        passed: (n, 8) likewise, of the device's topics that are passed over.
        outputs: (2, 17) likewise, of the commands to device and mechanism.
        words: (5,) to work with.
        polled: (n,) struct pollfd of all connections, those of the device's and of the analyser's
            process first.
        state_frame: (words,) for the sample that has come.
        state_prefix: (words,) the bytes before its data.
        state_copies: (n, words) to fill, with those that the middleware will bring too.
        state: (29,) a view of the data in ``state_frame``.
        state_most: (29,) largest magnitude of each number.
        model_frame: (words,) for the model that has come.
        model_prefix: (words,) the bytes before its data.
        model_copies: (n, words) as ``state_copies``.
        model: (151,) a view of the data in ``model_frame``.
        model_most: (151,) largest magnitude of each number.
        device_frame: (words,) for the command to the device.
        to_device: (6,) a view of its wrench, N and N m, world axes at the point held.
        device_targets: (2 n,) to whom it is sent.
        point_frame: (words,) for the command to the mechanism.
        to_point: (6,) a view of its wrench, N and N m, world axes at the operational point.
        point_targets: (2 n,) to whom it is sent.
        most: (6,) largest magnitudes of a wrench.
        known: (139,) the operational model as it was heard last; changed.
        grasp: (7,) where it has the point.
        account: (numbers,) of the controller, a ``ControllerAccount``; changed.
        before: (numbers,) to work with.
        settings: (59,) of the controllers, a ``ControllerSettings``.
        faded: (6,) zeros.
        queue: (d, 6) commands to the mechanism that do not act yet, changed.
        past: (n, 6) those until now, changed.
        locality: (3,) what the device closes, a ``Locality``.
        answer: (numbers,) an ``Answer`` to fill.
        motion: (numbers,) of the device, a ``device.motion_kernels.Motion``; changed.
        moved: (numbers,) to work with.
        wrenches: (2, 6) to work with.
        round_trip: s, as the device has reported it.
        ages: (n,) to fill: of the messages, ns.

    Returns:
        Why it returns.
    """
    side, gains, given = ControllerAccount(account), ControllerSettings(settings), Answer(answer)
    closed, seen = Locality(locality), OperationalModelSample(known)
    while link[READS] < ages.size:
        if time_of(MONOTONIC, words) >= link[UNTIL]:
            break
        found = wait_until(link[UNTIL], link, words, polled, 2)
        if found == NOTHING:
            continue
        if found == OTHER:
            return TO_READ
        # What there is to answer with comes first.
        if found & 1 << MODELS:
            if not peek(link, inputs[MODELS], words, polled[MODELS], model_frame, model_prefix):
                return TO_READ
            time, counted, sent = words[0], words[2], words[3]
            stamp = plain_model(link, model, model_most, grasp, time)
            if stamp == UNSOUND or has_paused(link, OF_ANALYSER, stamp, counted):
                return TO_READ
            take(inputs[MODELS], words, polled[MODELS], model_frame, model_copies)
            put(known, model[MODEL : MODEL + known.size])
            link[MODEL_NS] = stamp
            note_sender(link, OF_ANALYSER, stamp, counted)
            note_read(link, inputs[MODELS], ages, time, time - stamp, counted, sent)
            continue
        if not peek(link, inputs[STATES], words, polled[STATES], state_frame, state_prefix):
            if pass_over(link, passed, words, polled[STATES]):
                continue
            return TO_READ
        time, real, counted, sent = words[0], words[1], words[2], words[3]
        stamp = plain_sample(link, state, state_most, round_trip, time)
        if stamp == UNSOUND or has_paused(link, OF_DEVICE, stamp, counted):
            return TO_READ
        sample = DeviceSample(state[SAMPLE:])
        put(moved, motion)
        elapsed_s = (stamp - link[MOVED]) / 1e9
        if follow_sample(Motion(moved), sample, elapsed_s) != SOUND:
            return TO_READ
        put(before, account)
        period, time_s = side.period, (time - link[EPOCH]) / 1e9
        late = (stamp - link[MODEL_NS]) // link[PERIOD_NS] * period
        ahead = min(max(late, -PREDICTION_LIMIT_S), PREDICTION_LIMIT_S)
        flying = queue
        if ahead != 0.0 and closed.force_channel != 0.0:
            # A state that is late by n periods lacks n commands more than others do.
            number = queue.shape[0] + round(ahead / period)
            if number > past.shape[0]:
                return TO_READ
            ahead = min(number, 0) * period
            flying = past[: max(number, 0)]
        elapsed = 0.0
        if link[RENDERED] > 0:
            elapsed = max(round((link[MODEL_NS] - link[RENDERED]) / 1e9 / period), 0) * period
        account_for_motion(side, seen.twist, elapsed)
        account_for_hand(side, sample)
        give_answer(side, gains, faded, flying, sample, seen, time_s, ahead, closed, given)
        conclude(side, gains, sample, seen, time_s, closed, given)
        passive_wrench(side, given, wrenches[0])
        put(to_device, given.wrenches.on_hand)
        put(to_point, wrenches[0])
        if not (keeps(to_device, most) and keeps(to_point, most)):
            put(account, before)
            return TO_READ
        # From here on it is answered.
        take(inputs[STATES], words, polled[STATES], state_frame, state_copies)
        write_stamp(device_frame, stamp)
        send_to_all(outputs[TO_DEVICE], words, device_frame, device_targets, real)
        write_stamp(point_frame, stamp)
        send_to_all(outputs[TO_POINT], words, point_frame, point_targets, real)
        queue_wrench(side, queue, wrenches[0], wrenches[1])
        remember_commanded(past, wrenches[0])
        put(motion, moved)
        note_sender(link, OF_DEVICE, stamp, counted)
        note_read(link, inputs[STATES], ages, time, time - stamp, counted, sent)
        link[LAST], link[NEWEST], link[ARRIVED] = time, stamp, time
        link[MOVED], link[RENDERED], link[SAMPLE_NS] = stamp, link[MODEL_NS], stamp
        link[ANSWERS] += 1
        link[VIEW] -= int(link[VIEW] > 0)
        left = publish_outside(outputs[TO_DEVICE], device_frame)
        if publish_outside(outputs[TO_POINT], point_frame) or left:
            return TO_SEND
    return TIME_IS_UP
