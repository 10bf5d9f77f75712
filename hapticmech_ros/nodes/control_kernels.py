# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernel that answers the device's samples with two wrenches, and takes operational models."""

from __future__ import annotations

from hapticmech_ros.compilation import inner, kernel, local, local_whole, put
from hapticmech_ros.compilation.records import Nested, Record, Whole
from hapticmech_ros.control.account_kernels import command_mechanism, control_sample
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
    WORDS,
    Link,
    NotedPauses,
    PublishedTopic,
    SubscribedTopic,
    arrival,
    is_within,
    note_pause,
    note_read,
    pass_over,
    peek,
    publish_outside,
    send_to_all,
    take,
    time_of,
    wait_for_message,
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

# Indices of the topics that are read, and of those that are sent.
STATES, MODELS = 0, 1
TO_DEVICE, TO_POINT, AS_GAIN = 0, 1, 2


class Sender(Record):
    """A topic's sender, by its last message.

    Attributes:
        counted: the message's number among the sender's messages.
        stamp_ns: its stamp, ns.
        pauses: set by the kernel: its pauses, by its stamps.
    """

    dtype = int
    counted = Whole()
    stamp_ns = Whole()
    pauses = Nested(NotedPauses)


class ControllerLink(Link):
    """State shared by Python and the controller's kernel; times are ns, by the node's time.

    Attributes:
        timeout: longest silence of an input.
        epoch: when the controllers' time is zero.
        period: the period.
        last: when the device's last sample was read.
        model_ns, rendered: stamp of the operational model, and of the one answered with last.
        newest, arrived: the newest sample's stamp, and when it was read.
        gain_from: stamp of a sample from which on an answer includes a gain.
        gain_every: least difference of such stamps; 0: Python sends gains.
        moved: stamp of the last sample whose motion was checked against a hand's limits.
        of_device, of_analyser: last messages of these senders.
        sample_ns: stamp of the sample that was answered last.
        answers: number of samples answered.
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
def note_sender(link: ControllerLink, sender: Sender, stamp: int, counted: int) -> None:
    """Note a sender's message and any pause before it.

    After a pause, stamps have advanced by more periods than messages; see ``SenderPauses``.

    Args:
        link: shared state; changed.
        sender: of the message; changed.
        stamp: of the message, ns.
        counted: its number.
    """
    periods = counted - sender.counted
    late = stamp - sender.stamp_ns - periods * link.period
    if periods > 0 and late > SHORTEST_PAUSE_NS:
        note_pause(link, sender.pauses, stamp, late)
    sender.counted, sender.stamp_ns = counted, stamp


@inner
def plain_model(
    link: ControllerLink, model: OperationalModelMessage, most: Array, grasp: Array, time: int
) -> int:
    """Return the stamp, ns, of a valid model of a commanded point in its place; or UNSOUND.

    It is UNSOUND also if the device is silent.

    Args:
        link: shared state.
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
    """Return the stamp, ns, of a valid sample that is answered like those before; or UNSOUND.

    Args:
        link: shared state.
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
def write_gain(message: LocalFeedbackGain, stamp: int, answer: Answer) -> None:
    """Fill a message with an answer's gain; both its stamps are the answered sample's, ns."""
    message.stamp[0], message.stamp[1] = stamp // SECOND, stamp % SECOND
    put(message.answered, message.stamp)
    message.to_mechanism = answer.to_mechanism
    put(message.values[GAIN : GAIN + answer.model.values.size], answer.model.values)


@kernel(
    "int64(ControllerLink, SubscribedTopic, SubscribedTopic, int64[:, ::1], PublishedTopic,"
    " PublishedTopic, PublishedTopic, int64[::1], OperationalModelSample, float64[::1],"
    " ControllerAccount, ControllerSettings, float64[::1], float64[:, ::1], float64[:, ::1],"
    " Locality, Answer, Motion, float64[::1], int64[::1])",
    waits=True,
)
def answer_samples(
    link: ControllerLink,
    states: SubscribedTopic,
    models: SubscribedTopic,
    passed: Array,
    to_device: PublishedTopic,
    to_point: PublishedTopic,
    as_gain: PublishedTopic,
    polled: Array,
    known: OperationalModelSample,
    grasp: Array,
    side: ControllerAccount,
    settings: ControllerSettings,
    faded: Array,
    queue: Array,
    past: Array,
    closed: Locality,
    given: Answer,
    motion: Motion,
    round_trips: Array,
    ages: Array,
) -> int:
    """Answer samples as they arrive.

    Args:
        link: shared state; changed.
        states: samples of the device.
        models: operational models.
        passed: (n, 9) a ``lane_kernels.Reading`` of each topic of the device to pass over.
        to_device: commands to the device.
        to_point: commands to the mechanism.
        as_gain: gains: how the commands to the device depend on the sample.
        polled: (n,) struct pollfd of all connections but that of the analyser's process, that of
            the device's first.
        known: the operational model received last; changed.
        grasp: (7,) where the operational point is, as in that model.
        side: account of the controller; changed.
        settings: of the controllers.
        faded: (6,) zeros.
        queue: (d, 6) commands to the mechanism that do not act yet, N and N m; changed.
        past: (n, 6) commands to the mechanism until now, newest first, N and N m; changed.
        closed: loops that the device closes by itself; changed.
        given: the answer, to fill.
        motion: of the device; changed.
        round_trips: (2,) round trips, s, of the device's samples and their answers: the last one
            reported, changed; and up to which another one changes nothing.
        ages: (n,) to fill: ages of the messages, ns.

    Returns:
        Why it returns, see ``lane_kernels``.
    """
    words, moved, before = local_whole(WORDS), Motion(), ControllerAccount()
    commanded, acting = local(6), local(6)
    state, model = DeviceStateMessage(states.values), OperationalModelMessage(models.values)
    for_device, for_point, gain = to_device.values, to_point.values, as_gain.values
    grace = 0
    while link.reads < ages.size:
        now = time_of(MONOTONIC, words)
        if now >= link.until + grace:
            break
        grace = GRACE_NS
        # A device that is silent for longer is lost: Python reports that with the next model.
        silent = link.last + link.timeout - link.ahead
        if now > silent:
            return TO_READ
        found = wait_for_message(min(link.until + grace, silent + 1), link, words, polled)
        if found == GOES_ON:
            continue
        if found != PLAIN:
            return found
        # Operational models are read before the sample; they do not wake the kernel.
        while link.reads < ages.size:
            found = peek(link, models, words)
            if found == NOTHING:
                break
            time, came, counted, sent = words[0], arrival(words), words[2], words[3]
            stamp = plain_model(link, model, models.most, grasp, time)
            if found == OTHER or stamp == UNSOUND:
                return TO_READ
            take(models, words)
            put(known.values, model.operational_model.values)
            link.model_ns = stamp
            note_sender(link, link.of_analyser, stamp, counted)
            note_read(link, models.reading, ages, time, came - stamp, counted, sent)
        if link.reads == ages.size:
            break
        if peek(link, states, words) != PLAIN:
            if pass_over(link, passed, words, states.reading.connection):
                continue
            return TO_READ
        time, real, counted, sent = words[0], words[1], words[2], words[3]
        stamp = plain_sample(link, state, states.most, round_trips, time)
        if stamp == UNSOUND:
            return TO_READ
        sample = state.sample
        put(moved.values, motion.values)
        elapsed_s = (stamp - link.moved) / 1e9
        if follow_sample(moved, sample, elapsed_s) != SOUND:
            return TO_READ
        put(before.values, side.values)
        time_s = (time - link.epoch) / 1e9
        apart = stamp - link.model_ns
        elapsed = link.model_ns - link.rendered if link.rendered > 0 else 0
        closed.with_model = 1.0 if stamp >= link.gain_from else 0.0
        control_sample(
            side,
            settings,
            faded,
            queue,
            past,
            sample,
            known,
            time_s,
            apart,
            elapsed,
            closed,
            True,
            False,
            given,
            commanded,
        )
        put(for_device, given.wrenches.on_hand)
        put(for_point, commanded)
        sound = is_within(for_device, to_device.most) and is_within(for_point, to_point.most)
        if given.modelled != 0.0:
            write_gain(LocalFeedbackGain(gain), stamp, given)
            sound = sound and sound_stamp(gain, as_gain.most, -1, 0.0) != UNSOUND
        if not sound:
            put(side.values, before.values)
            return TO_READ
        # From here on the sample counts as answered.
        take(states, words)
        write_stamp(to_device.frame, stamp)
        send_to_all(to_device, words, real)
        write_stamp(to_point.frame, stamp)
        send_to_all(to_point, words, real)
        left = False
        if given.modelled != 0.0:
            send_to_all(as_gain, words, real)
            left = publish_outside(as_gain)
            link.gain_from = stamp + link.gain_every
        command_mechanism(side, queue, past, commanded, acting)
        put(motion.values, moved.values)
        note_sender(link, link.of_device, stamp, counted)
        note_read(link, states.reading, ages, time, time - stamp, counted, sent)
        link.last, link.newest, link.arrived = time, stamp, time
        round_trips[0] = state.round_trip
        link.moved, link.rendered, link.sample_ns = stamp, link.model_ns, stamp
        link.answers += 1
        left = publish_outside(to_device) or left
        left = publish_outside(to_point) or left
        code = went_on(link, left)
        if code != GOES_ON:
            return code
        grace = 0
    return TIME_IS_UP
