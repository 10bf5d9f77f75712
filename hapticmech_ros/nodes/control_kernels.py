# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernel that answers the device's samples with two wrenches, and takes operational models."""

from __future__ import annotations

from hapticmech_ros.compilation import inner, kernel, put
from hapticmech_ros.compilation.records import Nested, Record, Whole
from hapticmech_ros.control.account_kernels import (
    account_for_motion,
    answer_sample,
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
    GOES_ON,
    GRACE_NS,
    MONOTONIC,
    NOTHING,
    OTHER,
    PLAIN,
    SECOND,
    SHORTEST_PAUSE_NS,
    TIME_IS_UP,
    TO_READ,
    Link,
    Reading,
    Sending,
    arrival,
    note_read,
    pass_over,
    peek,
    publish_outside,
    send_to_all,
    take,
    time_of,
    wait_until,
    went_on,
    write_stamp,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import OperationalModelSample
from hapticmech_ros.wire.kernels import (
    GAIN,
    MODEL_QUATERNION,
    QUATERNION_TOLERANCE,
    SAMPLE_QUATERNION,
    UNSOUND,
    sound_stamp,
)
from hapticmech_ros.wire.messages import (
    DeviceStateMessage,
    LocalFeedbackGain,
    OperationalModelMessage,
)

# Which topics are read, and which are sent.
STATES, MODELS = 0, 1
TO_DEVICE, TO_POINT, AS_GAIN = 0, 1, 2
# The point's pose is carried on by its twist over periods that the analysis has missed, by no more
# than this: beyond it the twist says nothing.
PREDICTION_LIMIT_S = 0.005


class Sender(Record):
    """Who sends a topic: the number of its last message, and the stamp, ns.

    Attributes:
        counted: how the sender counts the message.
        stamp_ns: of the message.
    """

    dtype = int
    counted = Whole()
    stamp_ns = Whole()


class ControllerLink(Link):
    """How things stand, for the controller; times are ns, by the node's time.

    Attributes:
        timeout: how long inputs may be silent.
        epoch: since when times count.
        period: the period.
        last: when the device was received last.
        model_ns, rendered: stamp of the operational model, and of the one answered last.
        newest, arrived: the newest sample's stamp, and when it came.
        gain_from: from which stamp on an answer is to say how it depends on the device.
        gain_every: how much later the one after it, ns; 0: Python says that.
        moved: of the last sample that was held against what a hand can move.
        of_device, of_analyser: what their senders sent last.
        sample_ns: stamp of the sample that was answered last.
        answers: how many were.
    """

    timeout = Whole()
    epoch = Whole()
    period = Whole()
    last = Whole()
    model_ns = Whole()
    rendered = Whole()
    newest = Whole()
    arrived = Whole()
    gain_from = Whole()
    gain_every = Whole()
    moved = Whole()
    of_device = Nested(Sender)
    of_analyser = Nested(Sender)
    sample_ns = Whole()
    answers = Whole()


@inner
def has_paused(sender: Sender, stamp: int, counted: int, period: int) -> bool:
    """Return whether a sender's stamps went on faster than its count, see ``SenderPauses``.

    Args:
        sender: of a message.
        stamp: of the message, ns.
        counted: its number.
        period: ns.
    """
    periods = counted - sender.counted
    late = stamp - sender.stamp_ns - periods * period
    return bool(periods > 0 and late > SHORTEST_PAUSE_NS)


@inner
def note_sender(sender: Sender, stamp: int, counted: int) -> None:
    """Note a sender's message; arguments as of :func:`has_paused`."""
    sender.counted, sender.stamp_ns = counted, stamp


@inner
def plain_model(
    link: ControllerLink, model: OperationalModelMessage, most: Array, grasp: Array, time: int
) -> int:
    """Return the stamp, ns, of an operational model that keeps the rules, as before; or UNSOUND.

    Args:
        link: how things stand.
        model: the message.
        most: (151,) largest magnitudes.
        grasp: (7,) where the operational point is.
        time: now, ns of the node's time.
    """
    stamp = sound_stamp(model.values, most, MODEL_QUATERNION, QUATERNION_TOLERANCE)
    if stamp == UNSOUND or abs(time - stamp) > link.oldest or model.commanded != 1.0:
        return UNSOUND
    for i in range(grasp.size):
        if model.grasp[i] != grasp[i]:
            return UNSOUND
    return UNSOUND if time - link.last > link.timeout else stamp


@inner
def plain_sample(
    link: ControllerLink, state: DeviceStateMessage, most: Array, round_trips: Array, time: int
) -> int:
    """Return the stamp, ns, of a sample that is answered as those before it were; or UNSOUND.

    Args:
        link: how things stand.
        state: the message.
        most: (29,) largest magnitudes.
        round_trips: (2,) s, as of :func:`answer_samples`.
        time: now, ns of the node's time.
    """
    stamp = sound_stamp(state.values, most, SAMPLE_QUATERNION, QUATERNION_TOLERANCE)
    if stamp == UNSOUND or abs(time - stamp) > link.oldest:
        return UNSOUND
    alike = state.round_trip == round_trips[0] or 0.0 <= state.round_trip <= round_trips[1]
    if state.obeys != 1.0 or not alike:
        return UNSOUND
    if stamp < link.newest or stamp == time:
        return UNSOUND
    if stamp >= link.gain_from and link.gain_every == 0:
        return UNSOUND
    silent = max(time - link.last, time - link.model_ns)
    return UNSOUND if silent > link.timeout else stamp


@inner
def keeps(wrench: Array, most: Array) -> bool:
    """Return whether a wrench (6,) is within its bounds (6,), which no NaN is."""
    kept = True
    for i in range(6):
        kept = kept and abs(wrench[i]) <= most[i]
    return kept


@inner
def write_gain(message: LocalFeedbackGain, stamp: int, answer: Answer) -> None:
    """Fill a message with how an answer depends on the sample, of a time in ns, that it answers."""
    message.stamp[0], message.stamp[1] = stamp // SECOND, stamp % SECOND
    put(message.answered, message.stamp)
    message.to_mechanism = answer.to_mechanism
    put(message.values[GAIN : GAIN + answer.model.values.size], answer.model.values)


@kernel(
    "int64(int64[::1], int64[:, ::1], int64[:, ::1], int64[:, ::1], int64[::1], int64[::1],"
    " int64[::1], int64[::1], int64[:, ::1], float64[::1], float64[::1],"
    " int64[::1], int64[::1], int64[:, ::1], float64[::1], float64[::1],"
    " int64[::1], float64[::1], int64[::1], int64[::1], float64[::1], int64[::1],"
    " int64[::1], float64[::1], int64[::1], float64[::1], float64[::1],"
    " float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1],"
    " float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], float64[::1], float64[::1],"
    " float64[:, ::1], float64[::1], int64[::1])",
    waits=True,
)
def answer_samples(
    shared: Array,
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
    gain_frame: Array,
    gain: Array,
    gain_targets: Array,
    gain_most: Array,
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
    round_trips: Array,
    ages: Array,
) -> int:
    """Answer samples as they come.

    Args:
        shared: (26,) how things stand, a :class:`ControllerLink`; changed.
        inputs: (2, 9) a ``lane_kernels.Reading`` each, of the samples and the models; changed.
        passed: (n, 9) likewise, of the device's topics that are passed over.
        outputs: (3, 17) a ``lane_kernels.Sending`` each, of the commands to device and mechanism,
            and of the gains; changed.
        words: (5,) to work with.
        polled: (n,) struct pollfd of all connections but that of the analyser's process, that of
            the device's first.
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
        gain_frame: (words,) for a gain.
        gain: (113,) a view of its data.
        gain_targets: (2 n,) to whom it is sent.
        gain_most: (113,) largest magnitude of each number.
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
        round_trips: (2,) s, of the device's samples and their answers: as it has reported it last,
            changed; and what it may be without a change of anything.
        ages: (n,) to fill: of the messages, ns.

    Returns:
        Why it returns.
    """
    link, states, models = ControllerLink(shared), Reading(inputs[STATES]), Reading(inputs[MODELS])
    for_device, for_point = Sending(outputs[TO_DEVICE]), Sending(outputs[TO_POINT])
    for_gain = Sending(outputs[AS_GAIN])
    side, gains, given = ControllerAccount(account), ControllerSettings(settings), Answer(answer)
    closed, seen = Locality(locality), OperationalModelSample(known)
    grace = 0
    while link.reads < ages.size:
        now = time_of(MONOTONIC, words)
        if now >= link.until + grace:
            break
        grace = GRACE_NS
        # A device that is silent for longer is lost: Python says so with the next model.
        silent = link.last + link.timeout - link.ahead
        if now > silent:
            return TO_READ
        found = wait_until(min(link.until + grace, silent + 1), link, words, polled, 1)
        if found == NOTHING:
            continue
        if found == OTHER:
            return TO_READ
        # What there is to answer with comes first; nobody had to be there for it.
        while link.reads < ages.size:
            found = peek(link, models, words, model_frame, model_prefix)
            if found == NOTHING:
                break
            time, came, counted, sent = words[0], arrival(words), words[2], words[3]
            stamp = plain_model(link, OperationalModelMessage(model), model_most, grasp, time)
            paused = has_paused(link.of_analyser, stamp, counted, link.period)
            if found == OTHER or stamp == UNSOUND or paused:
                return TO_READ
            take(models, words, model_frame, model_copies)
            put(known, OperationalModelMessage(model).operational_model.values)
            link.model_ns = stamp
            note_sender(link.of_analyser, stamp, counted)
            note_read(link, models, ages, time, came - stamp, counted, sent)
        if link.reads == ages.size:
            break
        if peek(link, states, words, state_frame, state_prefix) != PLAIN:
            if pass_over(link, passed, words, states.connection):
                continue
            return TO_READ
        time, real, counted, sent = words[0], words[1], words[2], words[3]
        stamp = plain_sample(link, DeviceStateMessage(state), state_most, round_trips, time)
        if stamp == UNSOUND or has_paused(link.of_device, stamp, counted, link.period):
            return TO_READ
        sample = DeviceStateMessage(state).sample
        put(moved, motion)
        elapsed_s = (stamp - link.moved) / 1e9
        if follow_sample(Motion(moved), sample, elapsed_s) != SOUND:
            return TO_READ
        put(before, account)
        period, time_s = side.period, (time - link.epoch) / 1e9
        late = (stamp - link.model_ns) // link.period * period
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
        if link.rendered > 0:
            elapsed = max(round((link.model_ns - link.rendered) / 1e9 / period), 0) * period
        closed.with_model = 1.0 if stamp >= link.gain_from else 0.0
        account_for_motion(side, seen.twist, elapsed)
        answer_sample(side, gains, faded, flying, sample, seen, time_s, ahead, closed, False, given)
        passive_wrench(side, given, wrenches[0])
        put(to_device, given.wrenches.on_hand)
        put(to_point, wrenches[0])
        sound = keeps(to_device, most) and keeps(to_point, most)
        if given.modelled != 0.0:
            write_gain(LocalFeedbackGain(gain), stamp, given)
            sound = sound and sound_stamp(gain, gain_most, -1, 0.0) != UNSOUND
        if not sound:
            put(account, before)
            return TO_READ
        # From here on it is answered.
        take(states, words, state_frame, state_copies)
        write_stamp(device_frame, stamp)
        send_to_all(for_device, words, device_frame, device_targets, real)
        write_stamp(point_frame, stamp)
        send_to_all(for_point, words, point_frame, point_targets, real)
        left = False
        if given.modelled != 0.0:
            send_to_all(for_gain, words, gain_frame, gain_targets, real)
            left = publish_outside(for_gain, gain_frame)
            link.gain_from = stamp + link.gain_every
        queue_wrench(side, queue, wrenches[0], wrenches[1])
        remember_commanded(past, wrenches[0])
        put(motion, moved)
        note_sender(link.of_device, stamp, counted)
        note_read(link, states, ages, time, time - stamp, counted, sent)
        link.last, link.newest, link.arrived = time, stamp, time
        round_trips[0] = DeviceStateMessage(state).round_trip
        link.moved, link.rendered, link.sample_ns = stamp, link.model_ns, stamp
        link.answers += 1
        left = publish_outside(for_device, device_frame) or left
        left = publish_outside(for_point, point_frame) or left
        code = went_on(link, left)
        if code != GOES_ON:
            return code
        grace = 0
    return TIME_IS_UP
