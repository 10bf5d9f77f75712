# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernel that steps a device at its deadlines, under the commands received meanwhile."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel, local, local_whole, put
from hapticmech_ros.compilation.records import Nested, Whole
from hapticmech_ros.control.account_kernels import remember
from hapticmech_ros.control.device_side_kernels import (
    allow_command,
    correct,
)
from hapticmech_ros.control.loop_layout import DeviceAccount, HandMemory, HandsCorrection
from hapticmech_ros.control.other_hands_kernels import (
    SQUARE,
    HandsData,
    correct_for_hands,
    remember_hand,
)
from hapticmech_ros.device.kernels import (
    DeviceModel,
    PublishedState,
    SimulatedState,
    command_device,
    compensate,
    move_device,
)
from hapticmech_ros.device.motion_kernels import is_too_fast
from hapticmech_ros.device.safety_kernels import Safety
from hapticmech_ros.nodes.lane_kernels import (
    DEAF_NS,
    GOES_ON,
    MONOTONIC,
    NOTHING,
    OTHER,
    PLAIN,
    REALTIME,
    SECOND,
    TIME_IS_UP,
    TO_ACT,
    TO_READ,
    TO_SAY,
    WORDS,
    CommandPort,
    DeadlineLink,
    PublishedTopic,
    SubscribedTopic,
    arrival,
    find_command,
    known_since,
    made_up,
    missed_deadlines,
    peek,
    publish,
    sampled,
    stepped,
    take,
    take_command,
    time_of,
    wait_for_deadline,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import DeviceSample, LocalModel
from hapticmech_ros.numerics.small_matrices import is_zero
from hapticmech_ros.wire.kernels import (
    GAIN,
    QUATERNION_TOLERANCE,
    SAMPLE_QUATERNION,
    UNSOUND,
    sound_stamp,
)
from hapticmech_ros.wire.messages import DeviceStateMessage, LocalFeedbackGain

# Indices of the topics that are read; those of other hands come last.
COMMANDS, GAINS, COUPLINGS, HANDS = 0, 1, 2, 3
# Where in a sample's data the published state begins; and in a gain's data, its second stamp.
PUBLISHED = DeviceStateMessage.layout.start("position")
ANSWERED = LocalFeedbackGain.layout.start("answered")
STAMP_SIZE = 2
SAMPLE_SIZE = DeviceSample.layout.size
# Several answers to one sample have stamps that differ by nanoseconds, less than this.
MICROSECOND = 1000


class DeviceLink(DeadlineLink):
    """State shared by Python and the device's kernel; times are ns, by the node's time.

    Attributes:
        port: commands to the device.
        fresh: how long a gain is valid.
        answered, answered_before: stamp of the sample that each of the two commands answers.
        held: periods since the hand could take hold; -1: no hand holds.
        gain_ns: when the gain in use arrived.
        remembers: number of samples remembered so far, overwritten ones included.
        trips: number of round trips noted.
        gain_newest: stamp of the newest gain.
        gain_arrived: when it arrived.
        gain_after: only gains that answer samples later than this are used.
        sampled: stamp of the last sample.
    """

    port = Nested(CommandPort)
    fresh = Whole()
    answered = Whole()
    answered_before = Whole()
    held = Whole()
    gain_ns = Whole()
    remembers = Whole()
    trips = Whole()
    gain_newest = Whole()
    gain_arrived = Whole()
    gain_after = Whole()
    sampled = Whole()


@inner
def row_of(stamps: Array, count: int, stamp: int) -> int:
    """Return the row of the newest sample with a stamp (ns), or -1; see :func:`find_sample`."""
    rows = stamps.size
    for back in range(1, min(count, rows) + 1):
        row = (count - back) % rows
        if stamps[row] == stamp // MICROSECOND:
            return int(row)
    return -1


@kernel("int64(int64[::1], int64, int64)")
def find_sample(stamps: Array, count: int, stamp: int) -> int:
    """Return the row of the newest sample with a stamp, compared in microseconds; -1: none.

    Args:
        stamps: (n,) of the samples, microseconds; a ring buffer.
        count: number of samples so far, overwritten ones included.
        stamp: ns.
    """
    return int(row_of(stamps, count, stamp))


@inner
def remember_sample(
    link: DeviceLink, stamps: Array, samples: Array, hand: Array, stamp: int, sample: Array
) -> None:
    """Remember a sample (19,); see ``local_loop``.

    Args:
        link: shared state; changed.
        stamps: (n,) as of :func:`find_sample`.
        samples: (n, 19) the samples.
        hand: (22,) the hand's last wrenches.
        stamp: ns.
        sample: (19,) of the device.
    """
    row = link.remembers % stamps.size
    stamps[row] = stamp // MICROSECOND
    put(samples[row], sample)
    remember(HandMemory(hand), (stamp - link.sampled) / 1e9, DeviceSample(sample).hand_wrench)
    link.remembers += 1
    link.sampled = stamp


@inner
def take_gain(
    link: DeviceLink, topic: SubscribedTopic, words: Array, model: Array, energies: Array
) -> bool:
    """Take the next ``local_feedback_gain`` if it is valid, as ``LocalLoop.take`` does.

    Args:
        link: shared state; changed.
        topic: of the gains.
        words: (5,) work space.
        model: (108,) how commands depend on the device, a ``LocalModel``; changed.
        energies: (2,) E_m as received last, and its value that counts as zero, J; changed.

    Returns:
        Whether one was taken.
    """
    read, values, most = topic.reading, topic.values, topic.most
    full = read.copied == topic.copies.shape[0]
    if full or peek(link, topic, words) != PLAIN:
        return False
    time, came, counted, sent = words[0], arrival(words), words[2], words[3]
    after = ANSWERED + STAMP_SIZE
    stamp = sound_stamp(values, most, -1, 0.0)
    answered = sound_stamp(values[ANSWERED:after], most[ANSWERED:after], -1, 0.0)
    if stamp in (UNSOUND, time) or answered == UNSOUND or stamp < link.gain_newest:
        return False
    if max(abs(time - stamp), abs(time - answered)) > link.oldest:
        return False
    take(topic, words)
    link.gain_newest, link.gain_arrived = stamp, came
    energies[0] = LocalFeedbackGain(values).to_mechanism
    if np.isnan(energies[1]):
        energies[1] = energies[0]
    if answered > link.gain_after:
        put(model, values[GAIN : GAIN + model.size])
        link.gain_ns = came
    read.read, read.counted, read.sent_ns = time, counted, sent
    return True


@inner
def take_beside(link: DeviceLink, topic: SubscribedTopic, words: Array, quaternion: int) -> int:
    """Take the next message of a topic that is no command, if it is valid.

    Args:
        link: shared state.
        topic: of the message.
        words: (5,) work space.
        quaternion: as of :func:`~hapticmech_ros.wire.kernels.sound_stamp`.

    Returns:
        Its stamp, ns; NOTHING if there is none, or OTHER.
    """
    found = peek(link, topic, words)
    if found != PLAIN:
        return found
    time, counted, sent, read = words[0], words[2], words[3], topic.reading
    stamp = sound_stamp(topic.values, topic.most, quaternion, QUATERNION_TOLERANCE)
    if stamp == UNSOUND or abs(time - stamp) > link.oldest:
        return OTHER
    take(topic, words)
    read.read, read.counted, read.sent_ns = time, counted, sent
    return int(stamp)


@inner
def take_coupling(
    link: DeviceLink, topic: SubscribedTopic, words: Array, hands: HandsData, places: Array
) -> bool:
    """Take the next ``coupling_gain`` if it is valid, as ``LocalLoop.take_coupling`` does.

    Args:
        link: shared state.
        topic: of these messages.
        words: (5,) work space.
        hands: other hands; changed.
        places: (k,) where the matrix of each begins in the message's data.

    Returns:
        Whether one was taken.
    """
    stamp = take_beside(link, topic, words, -1)
    if stamp in (NOTHING, OTHER):
        return False
    if stamp > link.gain_after:
        hands.notes.coupled = arrival(words)
        for hand in range(places.size):
            gain = topic.values[places[hand] : places[hand] + SQUARE]
            hands.holding[hand] = 0 if is_zero(gain) else 1
            put(hands.gains[hand], gain)
    return True


@inner
def take_samples(
    link: DeviceLink, topic: SubscribedTopic, words: Array, hands: HandsData, hand: int
) -> bool:
    """Take samples of another hand's device; return whether no message is left.

    Args:
        link: shared state.
        topic: of the samples.
        words: (5,) work space.
        hands: other hands; changed.
        hand: whose samples these are.
    """
    for _ in range(hands.stamps.shape[1]):
        stamp = take_beside(link, topic, words, SAMPLE_QUATERNION)
        if stamp in (NOTHING, OTHER):
            return bool(stamp == NOTHING)
        wrench = DeviceStateMessage(topic.values).sample.hand_wrench
        remember_hand(hands, hand, stamp, wrench)
    return False


@kernel(
    "int64(DeviceLink, SubscribedTopic, SubscribedTopic, SubscribedTopic, int64[:, ::1],"
    " float64[:, ::1], PublishedTopic, int64[::1], float64[:, ::1], float64[::1], float64[::1],"
    " float64[::1], float64[::1], DeviceAccount, Safety, int64[::1], float64[:, ::1],"
    " float64[::1], float64[::1], HandsData, int64[::1], float64, float64[::1], float64[::1],"
    " int64[::1], int64[::1])",
    waits=True,
)
def drive_at_deadlines(
    link: DeviceLink,
    command: SubscribedTopic,
    gain: SubscribedTopic,
    coupling: SubscribedTopic,
    topics: Array,
    bounds: Array,
    states: PublishedTopic,
    polled: Array,
    commands: Array,
    fastest: Array,
    device: Array,
    state: Array,
    later: Array,
    side: DeviceAccount,
    safety: Safety,
    stamps: Array,
    samples: Array,
    hand: Array,
    model: Array,
    hands: HandsData,
    places: Array,
    period: float,
    energies: Array,
    trips: Array,
    ages: Array,
    listened: Array,
) -> int:
    """Do a step at each deadline, after taking the commands received by then.

    Args:
        link: shared state; changed.
        command: commands to the device.
        gain: how they depend on the device; over the same connection.
        coupling: how they depend on other hands, ``coupling_gain``; likewise.
        topics: (k, integers) a ``SubscribedTopic`` of the samples of each other hand's device.
        bounds: (k, numbers) their other arrays.
        states: the device's samples.
        polled: (n,) struct pollfd of all connections but those of the processes of the controller
            and the other devices.
        commands: (2, 6) the present command, and the one before, N and N m; changed.
        fastest: (2,) greatest speeds of the device, m/s and rad/s.
        device: (numbers,) a :class:`~hapticmech_ros.device.kernels.DeviceModel`, and the plan of
            its hand.
        state: (107,) a :class:`~hapticmech_ros.device.kernels.SimulatedState`, changed.
        later: (107,) work space for the next one.
        side: the device's account of energy; changed.
        safety: its safety envelope.
        stamps: (n,) of the remembered samples, microseconds; see :func:`find_sample`.
        samples: (n, 19) these samples.
        hand: (22,) the hand's last wrenches.
        model: (108,) how commands depend on the device, a ``LocalModel``; changed.
        hands: other hands, k of them; changed.
        places: (k,) as of :func:`take_coupling`.
        period: s.
        energies: (2,) E_m as received last, J, and its value that counts as zero; NaN until it is
            received; changed.
        trips: (n,) to fill: times from samples to their answers' arrival, s; as long as ``ages``.
        ages: (n,) to fill: ages of the commands when they arrived, ns.
        listened: (1,) when the middleware was last listened to, ns of the monotonic clock.

    Returns:
        Why it returns, see ``lane_kernels``.
    """
    words, out, port = local_whole(WORDS), states.values, link.port
    body, now_there, next_there = DeviceModel(device), SimulatedState(state), SimulatedState(later)
    measured, published = DeviceSample(state).values, PublishedState(state).values
    sample, asked, added = DeviceSample(local(SAMPLE_SIZE)), local(6), local(6)
    others = HandsCorrection()
    while link.reads < ages.size:
        now = time_of(MONOTONIC, words)
        if now < link.next - link.ahead:
            code = wait_for_deadline(link, words, polled, now)
            if code != GOES_ON:
                return code
            continue
        while link.reads < ages.size:
            found = find_command(link, port, command, words)
            if found == NOTHING:
                break
            if found == OTHER:
                if take_gain(link, gain, words, model, energies):
                    continue
                if take_coupling(link, coupling, words, hands, places):
                    continue
                return TO_READ
            if take_command(link, port, command, words, commands, found, ages):
                link.answered_before = link.answered
            link.answered = found
            if row_of(stamps, link.remembers, found) >= 0:
                trips[link.trips] = (port.received - found) / 1e9
                link.trips += 1
        for k in range(places.size):
            topic = SubscribedTopic(topics[k], bounds[k])
            if not take_samples(link, topic, words, hands, k):
                return TO_READ
        now_real, time = time_of(REALTIME, words), now + link.ahead
        missed = missed_deadlines(link, words, now, now_real)
        if missed < 0 or now - listened[0] > DEAF_NS:
            return TO_ACT
        for i in range(missed + 1):
            known = known_since(link)
            before, received, answered = 0, port.received, link.answered
            if port.received > known:
                before, received, answered = 1, port.received_before, link.answered_before
            silent = max(time - port.received, time - port.received_before, known - received)
            if silent > link.timeout:
                return TO_ACT
            put(sample.values, measured)
            put(asked, commands[before])
            row = row_of(stamps, link.remembers, answered)
            if row >= 0 and time - link.gain_ns <= link.fresh:
                newest = DeviceSample(samples[(link.remembers - 1) % stamps.size])
                if time - hands.notes.coupled <= link.fresh:
                    correct_for_hands(hands, answered, link.sampled, others)
                else:
                    others.values[:] = 0.0
                    hands.notes.uncorrected += min(places.size, 1)
                correct(
                    commands[before],
                    LocalModel(model),
                    DeviceSample(samples[row]),
                    newest,
                    HandMemory(hand),
                    period,
                    others,
                    asked,
                )
            compensate(body, now_there.twist, added)
            given = energies[0] - energies[1]
            allow_command(side, safety, asked, sample, now_there.applied, added, given)
            command_device(body, now_there, asked)
            move_device(device, now_there, link.held, next_there)
            put(state, later)
            link.held += int(link.held >= 0)
            if i < missed:
                made_up(link)
        sampled(port, commands)
        stamp = stepped(link)
        link.answered_before = link.answered
        out[0], out[1] = stamp // SECOND, stamp % SECOND
        put(out[PUBLISHED : PUBLISHED + published.size], published)
        sound = sound_stamp(out, states.most, SAMPLE_QUATERNION, QUATERNION_TOLERANCE) != UNSOUND
        if not sound or is_too_fast(now_there.twist, fastest):
            return TO_SAY
        code = publish(link, states, words, now_real)
        remember_sample(link, stamps, samples, hand, stamp, measured)
        if code != GOES_ON:
            return code
    return TIME_IS_UP
