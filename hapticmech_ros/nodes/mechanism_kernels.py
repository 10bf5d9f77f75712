# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernel that moves a mechanism on at its deadlines, under the commands that come meanwhile."""

from __future__ import annotations

from hapticmech_ros.compilation import inner, kernel, put
from hapticmech_ros.compilation.records import Whole
from hapticmech_ros.control.loop_layout import ActingWrenches
from hapticmech_ros.nodes.lane_kernels import (
    GOES_ON,
    MONOTONIC,
    NOTHING,
    OTHER,
    REALTIME,
    SECOND,
    TIME_IS_UP,
    TO_ACT,
    TO_READ,
    TO_SAY,
    DeadlineLink,
    Reading,
    Sending,
    find_command,
    is_late,
    known_since,
    publish,
    stepped,
    take_command,
    time_of,
    wait_for_deadline,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.session.tick_kernels import SessionData, move_mechanism
from hapticmech_ros.wire.kernels import UNSOUND, sound_stamp


class MechanismLink(DeadlineLink):
    """How things stand, for the mechanism.

    Attributes:
        ramp: how long a command that has run out takes to reach zero, ns.
        position, velocity, commanded: where in a state begins what changes.
    """

    ramp = Whole()
    position = Whole()
    velocity = Whole()
    commanded = Whole()


@inner
def standing(link: MechanismLink, commands: Array, known: int, wrench: Array) -> None:
    """Fill the wrench (6,) that stands as of a time; see ``inputs.ExpiringWrench``.

    Args:
        link: how things stand.
        commands: (2, 6) the command that stands, and the one before.
        known: as of when, ns.
        wrench: (6,) to fill.
    """
    before = link.received > known
    put(wrench, commands[1 if before else 0])
    received = link.received_before if before else link.received
    over = known - received - link.timeout
    if link.timeout > 0 and over > 0:
        left = 0.0 if over >= link.ramp else 1.0 - over / link.ramp
        for i in range(6):
            wrench[i] *= left


@kernel(
    "int64(int64[::1], int64[:, ::1], int64[:, ::1], int64[::1], int64[::1], int64[::1],"
    " int64[::1], int64[:, ::1], int64[::1], float64[::1],"
    " float64[::1], float64[:, ::1], int64[::1], float64[::1], float64[::1], int64[::1],"
    " int64[::1], float64[::1], float64[:, ::1], float64[::1], int64[::1],"
    " float64[::1], int64[::1], float64[::1], int64[::1], int64[::1])",
    waits=True,
)
def move_at_deadlines(
    shared: Array,
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
    targets: Array,
    numbers: Array,
    constants: Array,
    packed: Array,
    work: Array,
    whole: Array,
    real: Array,
    contact_numbers: Array,
    contact_values: Array,
    clock: Array,
    ages: Array,
) -> int:
    """Take commands as they come, and do a step at each deadline.

    Args:
        shared: (22,) how things stand, a :class:`MechanismLink`; changed.
        inputs: (1, 9) a ``lane_kernels.Reading``, of the commands; changed.
        outputs: (1, 17) a ``lane_kernels.Sending``, of the states; changed.
        words: (5,) to work with.
        polled: (n,) struct pollfd of all connections but that of the controller's process.
        frame: (words,) for the message that has come.
        prefix: (words,) the bytes before a command's stamp.
        copies: (n, words) to fill, with messages that the middleware will bring too.
        plain: (2,) those between its stamp and its wrench.
        values: (6,) a view of the wrench in ``frame``.
        most: (6,) largest magnitude of each of its numbers.
        commands: (2, 6) the command that stands, and the one before.
        out_frame: (words,) for the state.
        out: (n,) a view of the data in ``out_frame``.
        out_most: (n,) largest magnitude of each number.
        targets: (2 n,) to whom it is sent.
        numbers: (integers,) of the mechanism, as of ``run_ticks``.
        constants: (numbers,) likewise.
        packed: (4, size) likewise.
        work: (work,) likewise.
        whole: (integers,) likewise.
        real: (numbers,) likewise.
        contact_numbers: (integers,) likewise.
        contact_values: (numbers,) likewise.
        clock: (9,) likewise.
        ages: (n,) to fill: of the commands, ns.

    Returns:
        Why it returns.
    """
    link, read, sends = MechanismLink(shared), Reading(inputs[0]), Sending(outputs[0])
    data = SessionData(whole, real)
    nv = data.v.size
    while link.reads < ages.size:
        now = time_of(MONOTONIC, words)
        if now < link.next - link.ahead:
            code = wait_for_deadline(link, words, polled, now)
            if code != GOES_ON:
                return code
            continue
        while link.reads < ages.size:
            found = find_command(link, read, words, frame, prefix, plain, values, most)
            if found == NOTHING:
                break
            if found == OTHER:
                return TO_READ
            take_command(link, read, words, frame, copies, values, commands, found, ages)
        now_real = time_of(REALTIME, words)
        if is_late(link, words, now, now_real):
            return TO_ACT
        acting = ActingWrenches(data.wrenches)
        standing(link, commands, known_since(link), acting.on_mechanism)
        moved = move_mechanism(
            numbers,
            constants,
            data,
            packed,
            work,
            contact_numbers,
            contact_values,
            clock,
        )
        if not moved:
            return TO_ACT
        stamp = stepped(link, commands)
        out[0], out[1] = stamp // SECOND, stamp % SECOND
        put(out[link.position : link.position + nv], data.q)
        put(out[link.velocity : link.velocity + nv], data.v)
        out[link.commanded] = 1.0 if stamp - link.received <= link.timeout else 0.0
        if sound_stamp(out, out_most, -1, 0.0) == UNSOUND:
            return TO_SAY
        code = publish(link, sends, words, out_frame, targets, now_real)
        if code != GOES_ON:
            return code
    return TIME_IS_UP
