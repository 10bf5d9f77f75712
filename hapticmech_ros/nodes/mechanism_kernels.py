# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernel that steps a mechanism at its deadlines, under the commands received meanwhile."""

from __future__ import annotations

from hapticmech_ros.compilation import inner, kernel, local, local_whole, put
from hapticmech_ros.compilation.records import Whole
from hapticmech_ros.contact.layout import Contacts
from hapticmech_ros.mechanism.kernels.closure_kernels import end_of_rows
from hapticmech_ros.mechanism.kernels.factor_kernels import locate
from hapticmech_ros.mechanism.kernels.manifold_kernels import coordinates_of
from hapticmech_ros.mechanism.kernels.model import Data, Model, Work
from hapticmech_ros.mechanism.kernels.motion_kernels import add_point_forces
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
    WORDS,
    CommandPort,
    DeadlineLink,
    PublishedTopic,
    SubscribedTopic,
    find_command,
    known_since,
    made_up,
    missed_deadlines,
    publish,
    sampled,
    stepped,
    take_command,
    time_of,
    wait_for_deadline,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import add_scaled, is_zero
from hapticmech_ros.operational.observe_kernels import consistent_wrench, observe_point
from hapticmech_ros.session.tick_kernels import (
    AT,
    KNOWN,
    SessionData,
    move_mechanism,
)
from hapticmech_ros.wire.kernels import UNSOUND, sound_stamp


class MechanismLink(DeadlineLink):
    """State shared by Python and the mechanism's kernel.

    Attributes:
        ramp: time over which an expired command is ramped to zero, ns.
        position, velocity, contact, commanded: where these fields begin in a state message's data;
            the last two have a part for each operational point.
    """

    ramp = Whole()
    position = Whole()
    velocity = Whole()
    contact = Whole()
    commanded = Whole()


@inner
def standing(
    link: MechanismLink, port: CommandPort, commands: Array, known: int, wrench: Array
) -> bool:
    """Fill the wrench (6,) commanded at a time, with its ramp; see ``inputs.ExpiringWrench``.

    Args:
        link: shared state.
        port: its sender's commands.
        commands: (2, 6) the present command, and the one before, N and N m.
        known: the time, ns; commands that arrived later do not count.
        wrench: (6,) to fill, N and N m.

    Returns:
        Whether a command still acts.
    """
    before = port.received > known
    put(wrench, commands[1 if before else 0])
    received = port.received_before if before else port.received
    over = known - received - link.timeout
    if link.timeout > 0 and over > 0:
        left = 0.0 if over >= link.ramp else 1.0 - over / link.ramp
        for i in range(6):
            wrench[i] *= left
    return bool(link.timeout == 0 or over <= link.ramp)


@inner
def feel_state(
    numbers: Array,
    constants: Array,
    packed: Array,
    data: SessionData,
    metrics: Array,
    contact_numbers: Array,
    contact_values: Array,
    clock: Array,
    acting: Array,
    felt: Array,
) -> bool:
    """Fill F_c (6 points,) at the state reached, N and N m, at each point in turn.

    It is by contacts, and by the wrenches (points, 6) at the other points that act next. Where
    there are any the points are analysed here, for F_c alone. Returns whether they could be.
    """
    terms, model = packed[clock[AT]], Model(numbers, constants)
    parts, touches = Data(model.numbers, terms), contact_numbers.size > 0
    own, force = local(6), local(model.nv)
    felt[:] = 0.0
    for point in range(metrics.shape[0]):
        put(own, acting[point])
        acting[point] = 0.0
        force[:] = 0.0
        add_point_forces(model, parts, acting, force)
        put(acting[point], own)
        if touches:
            add_scaled(force, 1.0, Contacts(contact_numbers, contact_values).joint_force)
        if is_zero(force):
            continue
        code = observe_point(
            numbers,
            constants,
            terms,
            clock[KNOWN],
            data.q,
            data.v,
            point,
            metrics[point],
            data.rows,
            data.times.length,
            0.0,
            data.before,
            packed[2],
            data.observation,
        )
        if code != 0:
            return False
        wrench = felt[6 * point : 6 * point + 6]
        consistent_wrench(model, parts, data.observation, data.rows, force, wrench)
    return True


@inner
def near_latch(numbers: Array, values: Array, packed: Array, reaches: Array, q: Array) -> bool:
    """Return whether a loop that is open is within reach, where it may latch; q is (nq,)."""
    if reaches.size == 0:
        return False
    model, data = Model(numbers, values), Data(numbers, packed)
    locate(model, q, data)
    closures, residual = model.closures, data.residual
    for index in range(reaches.size):
        square = 0.0
        for row in range(closures[index, 3], end_of_rows(closures, index, model.m)):
            square += residual[row] * residual[row]
        if square < reaches[index] * reaches[index]:
            return True
    return False


@kernel(
    "int64(MechanismLink, int64[:, ::1], float64[:, ::1], PublishedTopic, int64[::1],"
    " int64[:, ::1], int64[::1], float64[:, ::1], float64[:, ::1], int64[::1], float64[::1],"
    " float64[:, ::1], float64[::1], SessionData, float64[:, ::1], int64[::1], float64[::1],"
    " int64[::1], float64[::1], float64[::1], float64[::1], int64[::1], int64[::1])",
    waits=True,
)
def move_at_deadlines(
    link: MechanismLink,
    topics: Array,
    bounds: Array,
    state: PublishedTopic,
    polled: Array,
    ports: Array,
    points: Array,
    commands: Array,
    acting: Array,
    numbers: Array,
    constants: Array,
    packed: Array,
    work: Array,
    data: SessionData,
    metrics: Array,
    contact_numbers: Array,
    contact_values: Array,
    latch_numbers: Array,
    latch_values: Array,
    latch_packed: Array,
    reaches: Array,
    clock: Array,
    ages: Array,
) -> int:
    """Do a step at each deadline, after taking the commands received by then.

    Args:
        link: shared state; changed.
        topics: (held, integers) a ``SubscribedTopic`` of the commands to each point that is held.
        bounds: (held, numbers) their other arrays.
        state: its states.
        polled: (n,) struct pollfd of all connections but those of the controllers' processes.
        ports: (held, 5) a ``CommandPort`` of each; changed.
        points: (held,) which operational points they are.
        commands: (2 held, 6) for each the present command, and the one before, N and N m; changed.
        acting: (points, 6) to fill: the wrenches of several controllers that act next, N and N m.
        numbers: (integers,) constants of the mechanism, as for ``run_ticks``.
        constants: (numbers,) the others, its ``values``.
        packed: (4, size) as for ``run_ticks``.
        work: (work,) as for ``run_ticks``.
        data: session data with the mechanism's state; changed.
        metrics: (points, numbers) of each operational point, in a scene with contacts or several
            points that are held, the ``constants`` of ``observe_point``.
        contact_numbers: (integers,) as for ``run_ticks``.
        contact_values: (numbers,) as for ``run_ticks``.
        latch_numbers: (integers,) constants of the mechanism with the loops that are open and may
            latch, as ``numbers``.
        latch_values: (numbers,) the others.
        latch_packed: (size,) to work in.
        reaches: (loops,) within which each may latch, m and rad.
        clock: (9,) as for ``run_ticks``.
        ages: (n,) to fill: ages of the commands when they arrived, ns.

    Returns:
        Why it returns, see ``lane_kernels``.
    """
    words, out, nv, near = local_whole(WORDS), state.values, data.v.size, False
    held, pushed = points.size, Work(numbers, work).wrenches
    while link.reads < ages.size:
        now = time_of(MONOTONIC, words)
        if now < link.next - link.ahead:
            code = wait_for_deadline(link, words, polled, now)
            if code != GOES_ON:
                return code
            continue
        for k in range(held):
            port, topic = CommandPort(ports[k]), SubscribedTopic(topics[k], bounds[k])
            while link.reads < ages.size:
                found = find_command(link, port, topic, words)
                if found == NOTHING:
                    break
                if found == OTHER:
                    return TO_READ
                last = commands[2 * k : 2 * k + 2]
                take_command(link, port, topic, words, last, found, ages)
        now_real = time_of(REALTIME, words)
        missed = missed_deadlines(link, words, now, now_real)
        if missed < 0:
            return TO_ACT
        for i in range(missed + 1):
            pushed[:] = 0.0
            for k in range(held):
                port, last = CommandPort(ports[k]), commands[2 * k : 2 * k + 2]
                standing(link, port, last, known_since(link), pushed[points[k]])
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
            near = near_latch(latch_numbers, latch_values, latch_packed, reaches, data.q)
            if i < missed:
                made_up(link)
                if near:
                    return TO_ACT
        stamp, several = stepped(link), 0
        acting[:] = 0.0
        for k in range(held):
            port, last = CommandPort(ports[k]), commands[2 * k : 2 * k + 2]
            sampled(port, last)
            several += int(standing(link, port, last, stamp, acting[points[k]]))
            obeyed = stamp - port.received <= link.timeout
            out[link.commanded + points[k]] = 1.0 if obeyed else 0.0
        if several < 2:
            acting[:] = 0.0
        if near:
            return TO_SAY
        out[0], out[1] = stamp // SECOND, stamp % SECOND
        coordinates_of(Model(numbers, constants), data.q, out[link.position : link.position + nv])
        put(out[link.velocity : link.velocity + nv], data.v)
        if metrics.size > 0:
            analysed = feel_state(
                numbers,
                constants,
                packed,
                data,
                metrics,
                contact_numbers,
                contact_values,
                clock,
                acting,
                out[link.contact : link.contact + 6 * metrics.shape[0]],
            )
            if not analysed:
                return TO_SAY
        if sound_stamp(out, state.most, -1, 0.0) == UNSOUND:
            return TO_SAY
        code = publish(link, state, words, now_real)
        if code != GOES_ON:
            return code
    return TIME_IS_UP
