# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernel that moves a device on at its deadlines, under the commands that come meanwhile."""

from __future__ import annotations

from hapticmech_ros.compilation import inner, kernel, local, put
from hapticmech_ros.control.account_kernels import remember
from hapticmech_ros.control.device_side_kernels import (
    account_for_actuators,
    allow,
    correct,
    take_energy,
)
from hapticmech_ros.control.loop_layout import (
    DeviceAccount,
    HandMemory,
    HandsCorrection,
    LocalModel,
)
from hapticmech_ros.device.kernels import (
    APPLIED,
    BODY,
    PUBLISHED_SIZE,
    REPORTED,
    SPEED,
    command_device,
    compensate,
    move_device,
)
from hapticmech_ros.device.motion_kernels import is_too_fast
from hapticmech_ros.device.safety_kernels import Safety
from hapticmech_ros.nodes.lane_kernels import (
    AHEAD,
    MONOTONIC,
    NOTHING,
    OTHER,
    OWN,
    READS,
    REALTIME,
    SECOND,
    TIME_IS_UP,
    TO_ACT,
    TO_LOOK_AT,
    TO_READ,
    TO_SAY,
    TO_SEND,
    UNTIL,
    is_set,
    look_is_due,
    note_read,
    peek,
    publish_outside,
    read_command,
    send_to_all,
    take,
    time_of,
    wait_until,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import DEVICE_SAMPLE, DeviceSample
from hapticmech_ros.wire.kernels import (
    QUATERNION_TOLERANCE,
    SAMPLE,
    SAMPLE_QUATERNION,
    UNSOUND,
    sound_stamp,
)

# The next deadline and the period, ns, by the node's time; how long a command stands, and how long
# what says how it depends on the device, ns; since when a command stands, and the one before, and
# which samples they answer, ns; the newest stamp, and when it came; how many steps were done; how
# many periods the hand has held, or -1; since when it is known how commands depend on the device;
# how many samples are remembered; and how many round trips may be noted, and were.
NEXT, PERIOD, TIMEOUT, FRESH, RECEIVED, RECEIVED_BEFORE, ANSWERED, ANSWERED_BEFORE = range(
    OWN, OWN + 8
)
NEWEST, ARRIVED, DONE, HELD, GAIN_NS, REMEMBERS, MOST_TRIPS, TRIPS = range(OWN + 8, OWN + 16)
LINK_SIZE, SAMPLE_SIZE = OWN + 16, DEVICE_SAMPLE.size
# Who answers one sample several times tells the answers apart by nanoseconds.
MICROSECOND = 1000


@inner
def row_of(stamps: Array, count: int, stamp: int) -> int:
    """Return the row of the sample with a stamp (ns), or -1; see :func:`find_sample`."""
    rows = stamps.size
    for back in range(1, min(count, rows) + 1):
        row = (count - back) % rows
        if stamps[row] == stamp // MICROSECOND:
            return int(row)
    return -1


@kernel("int64(int64[::1], int64, int64)")
def find_sample(stamps: Array, count: int, stamp: int) -> int:
    """Return the row of the newest sample of a microsecond, or -1.

    Args:
        stamps: (n,) of the samples, microseconds; one row after the other, again and again.
        count: how many samples there were.
        stamp: ns.
    """
    return int(row_of(stamps, count, stamp))


@inner
def remember_sample(
    link: Array, stamps: Array, samples: Array, hand: Array, stamp: int, sample: Array
) -> None:
    """Remember a sample (19,); see ``local_loop``.

    Args:
        link: see above.
        stamps: (n,) as of :func:`find_sample`.
        samples: (n, 19) the samples.
        hand: (22,) the hand's last wrenches.
        stamp: ns.
        sample: (19,) of the device.
    """
    row = link[REMEMBERS] % stamps.size
    stamps[row] = stamp // MICROSECOND
    put(samples[row], sample)
    remember(HandMemory(hand), link[PERIOD] / 1e9, sample[REPORTED:APPLIED])
    link[REMEMBERS] += 1


@kernel(
    "int64(int64[::1], int64[:, ::1], int64[:, ::1], int64[::1], int64[::1],"
    " int64[::1], int64[::1], int64[:, ::1], int64[::1], float64[::1], float64[::1],"
    " float64[:, ::1],"
    " int64[::1], float64[::1], float64[::1], float64[::1], int64[::1],"
    " float64[::1], float64[::1], float64[::1], float64[::1], float64[::1],"
    " int64[::1], float64[:, ::1], float64[::1], float64[::1], float64[::1], float64, float64,"
    " float64[::1], int64[::1])",
    waits=True,
)
def drive_at_deadlines(
    link: Array,
    inputs: Array,
    outputs: Array,
    words: Array,
    polled: Array,
    frame: Array,
    prefix: Array,
    copies: Array,
    plain: Array,
    values: Array,
    most: Array,
    commands: Array,
    out_frame: Array,
    out: Array,
    out_most: Array,
    fastest: Array,
    targets: Array,
    device: Array,
    state: Array,
    later: Array,
    account: Array,
    safety: Array,
    stamps: Array,
    samples: Array,
    hand: Array,
    model: Array,
    others: Array,
    period: float,
    given: float,
    trips: Array,
    ages: Array,
) -> int:
    """Take commands as they come, and do a step at each deadline.

    Args:
        link: (24,) what Python and kernel tell each other; see above and ``lane_kernels``.
        inputs: (1, 8) likewise, of the commands.
        outputs: (1, 17) likewise, of the samples.
        words: (5,) to work with.
        polled: (n,) struct pollfd of all connections, that of the controller's process first.
        frame: (words,) for the message that has come.
        prefix: (words,) the bytes before a command's stamp.
        copies: (n, words) to fill, with messages that the middleware will bring too.
        plain: (2,) those between its stamp and its wrench.
        values: (6,) a view of the wrench in ``frame``.
        most: (6,) largest magnitude of each of its numbers.
        commands: (2, 6) the command that stands, and the one before.
        out_frame: (words,) for the sample.
        out: (29,) a view of the data in ``out_frame``.
        out_most: (29,) largest magnitude of each number.
        fastest: (2,) m/s and rad/s, that the device can be moved.
        targets: (2 n,) to whom it is sent.
        device: (numbers,) see ``device_layout``.
        state: (107,) of the device, changed.
        later: (107,) to work with.
        account: (numbers,) of the device, a ``DeviceAccount``; changed.
        safety: (numbers,) its envelope, a :class:`~hapticmech_ros.device.safety_kernels.Safety`.
        stamps: (n,) of the samples that are remembered; see :func:`find_sample`.
        samples: (n, 19) these.
        hand: (22,) the hand's last wrenches.
        model: (108,) how commands depend on the device, a ``LocalModel``.
        others: (19,) zeros.
        period: s.
        given: E_m as it was received, J; NaN while nobody sends it.
        trips: (n,) to fill: s, of samples and their answers.
        ages: (n,) to fill: of the commands, ns.

    Returns:
        Why it returns.
    """
    side = DeviceAccount(account)
    while link[READS] < ages.size:
        deadline = link[NEXT] - link[AHEAD]
        now = time_of(MONOTONIC, words)
        if now < deadline:
            if now >= link[UNTIL]:
                break
            found = wait_until(min(deadline, link[UNTIL]), link, words, polled, 1)
            if found == NOTHING:
                continue
            if found == OTHER or not peek(link, inputs[0], words, polled[0], frame, prefix):
                return TO_READ
            time, counted, sent = words[0], words[2], words[3]
            stamp = read_command(link, frame, plain, values, most, time)
            overtaken = stamp < link[NEWEST] or stamp == time
            if stamp == UNSOUND or overtaken or link[TRIPS] == link[MOST_TRIPS]:
                return TO_READ
            take(inputs[0], words, polled[0], frame, copies)
            put(commands[0], values)
            link[RECEIVED], link[ANSWERED], link[NEWEST], link[ARRIVED] = time, stamp, stamp, time
            if row_of(stamps, link[REMEMBERS], stamp) >= 0:
                trips[link[TRIPS]] = (time - stamp) / 1e9
                link[TRIPS] += 1
            note_read(link, inputs[0], ages, time, time - stamp, counted, sent)
            continue
        now_real, time = time_of(REALTIME, words), now + link[AHEAD]
        if now >= deadline + link[PERIOD] or is_set(link, time_of(MONOTONIC, words), now_real):
            return TO_ACT
        known = link[NEXT] - link[PERIOD] - 1
        before = 1 if link[RECEIVED] > known else 0
        received, answered = link[RECEIVED + before], link[ANSWERED + before]
        silent = max(time - link[RECEIVED], time - link[RECEIVED_BEFORE], known - received)
        if silent > link[TIMEOUT]:
            return TO_ACT
        sample, asked, added = DeviceSample(local(SAMPLE_SIZE)), local(6), local(6)
        put(sample.values, state[:SAMPLE_SIZE])
        put(asked, commands[before])
        row = row_of(stamps, link[REMEMBERS], answered)
        if row >= 0 and time - link[GAIN_NS] <= link[FRESH]:
            newest = DeviceSample(samples[(link[REMEMBERS] - 1) % stamps.size])
            correct(
                commands[before],
                LocalModel(model),
                DeviceSample(samples[row]),
                newest,
                HandMemory(hand),
                period,
                HandsCorrection(others),
                asked,
            )
        compensate(device, state[SPEED:REPORTED], added)
        account_for_actuators(side, sample, state[APPLIED:BODY])
        take_energy(side, given)
        allow(side, Safety(safety), asked, sample, added)
        command_device(device, state, asked)
        move_device(device, state, link[HELD], later)
        put(state, later)
        link[HELD] += int(link[HELD] >= 0)
        put(commands[1], commands[0])
        link[RECEIVED_BEFORE], link[ANSWERED_BEFORE] = link[RECEIVED], link[ANSWERED]
        stamp = link[NEXT]
        link[NEXT] += link[PERIOD]
        link[DONE] += 1
        out[0], out[1] = stamp // SECOND, stamp % SECOND
        put(out[SAMPLE : SAMPLE + PUBLISHED_SIZE], state[:PUBLISHED_SIZE])
        sound = sound_stamp(out, out_most, SAMPLE_QUATERNION, QUATERNION_TOLERANCE) != UNSOUND
        if not sound or is_too_fast(state[SPEED:REPORTED], fastest):
            return TO_SAY
        send_to_all(outputs[0], words, out_frame, targets, now_real)
        remember_sample(link, stamps, samples, hand, stamp, state[:SAMPLE_SIZE])
        left = publish_outside(outputs[0], out_frame)
        if look_is_due(link):
            return TO_LOOK_AT
        if left:
            return TO_SEND
    return TIME_IS_UP
