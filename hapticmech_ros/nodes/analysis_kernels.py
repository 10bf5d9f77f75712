# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernel that answers each state of the mechanism with an operational model."""

from __future__ import annotations

from hapticmech_ros.compilation import inner, kernel, local_whole, put
from hapticmech_ros.compilation.records import Whole
from hapticmech_ros.mechanism.kernels.manifold_kernels import configure
from hapticmech_ros.mechanism.kernels.model import Model
from hapticmech_ros.nodes.lane_kernels import (
    GOES_ON,
    GRACE_NS,
    MONOTONIC,
    PLAIN,
    TIME_IS_UP,
    TO_READ,
    WORDS,
    Link,
    PublishedTopic,
    SubscribedTopic,
    note_read,
    peek,
    publish,
    take,
    time_of,
    wait_for_message,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.operational.observe_kernels import (
    MODEL_SIZE,
    ConstraintTrigger,
    count_rigid,
    observe_point,
    rates_before,
    remember_state,
)
from hapticmech_ros.wire.kernels import (
    MODEL_QUATERNION,
    QUATERNION_TOLERANCE,
    UNSOUND,
    sound_stamp,
    write_operational_model,
)
from hapticmech_ros.wire.messages import OperationalModelMessage


class AnalyserLink(Link):
    """State shared by Python and the analyser's kernel.

    Attributes:
        closed, position, velocity, contact, grasp, commanded: where in a state's data these begin:
            flags of closures, position, rates, and the point's F_c, place and flag.
        flags: where the flags of all points begin.
        point: number of the point.
        pause: stamps of successive states differ by less than this, ns.
        last: stamp of the last state, ns.
        first: stamp at which the time of the joint constraints' count is zero, ns.
    """

    closed = Whole()
    position = Whole()
    velocity = Whole()
    contact = Whole()
    grasp = Whole()
    commanded = Whole()
    flags = Whole()
    point = Whole()
    pause = Whole()
    last = Whole()
    first = Whole()


@inner
def plain_stamp(
    link: AnalyserLink, values: Array, most: Array, active: Array, grasp: Array, held: Array
) -> int:
    """Return the stamp, ns, of a valid state with closures and hands as before; or UNSOUND.

    Args:
        link: shared state.
        values: (n,) the state's data.
        most: (n,) largest magnitude of each number.
        active: (closures,) 1 for each that is closed.
        grasp: (7,) the point's place.
        held: (points,) 1 for each that is commanded; of the own one any.
    """
    stamp = sound_stamp(values, most, -1, 0.0)
    if stamp == UNSOUND or not 0 <= stamp - link.last < link.pause:
        return UNSOUND
    for i in range(active.size):
        if values[link.closed + i] != active[i]:
            return UNSOUND
    for i in range(grasp.size):
        if values[link.grasp + i] != grasp[i]:
            return UNSOUND
    for i in range(held.size):
        if i != link.point and values[link.flags + i] != held[i]:
            return UNSOUND
    commanded = values[link.commanded]
    return stamp if commanded == 0.0 or commanded == 1.0 else UNSOUND


@kernel(
    "int64(AnalyserLink, SubscribedTopic, PublishedTopic, int64[::1], float64[::1],"
    " float64[::1], float64[::1], int64[::1], float64[::1], float64[::1], float64[::1],"
    " float64[::1], float64[::1], int64[::1], float64, float64, float64[::1], float64[::1],"
    " float64[::1], ConstraintTrigger, int64[::1], int64[::1], float64[:, ::1], int64[::1])",
    waits=True,
)
def answer_states(
    link: AnalyserLink,
    states: SubscribedTopic,
    models: PublishedTopic,
    polled: Array,
    active: Array,
    grasp: Array,
    held: Array,
    numbers: Array,
    constants: Array,
    packed: Array,
    q: Array,
    v: Array,
    metric: Array,
    rows: Array,
    length: float,
    delay: float,
    before: Array,
    ahead: Array,
    observation: Array,
    counter: ConstraintTrigger,
    past: Array,
    stamps: Array,
    rates: Array,
    ages: Array,
) -> int:
    """Answer states as they arrive.

    Args:
        link: shared state; changed.
        states: of the mechanism.
        models: the answers.
        polled: (n,) struct pollfd of all connections, that of the mechanism's process first.
        active: (closures,) flags of closures.
        grasp: (7,) the point's place.
        held: (points,) 1 for each that is commanded.
        numbers: (integers,) constants of the mechanism, as for ``observe_point``.
        constants: (numbers,) the others, its ``values``.
        packed: (size,) as for ``observe_point``.
        q: (nq,) configuration, to fill.
        v: (nv,) rates, to fill.
        metric: (numbers,) the ``constants`` of ``observe_point``.
        rows: (t,) as for ``observe_point``.
        length: of the mechanism, m.
        delay: τ of the loop, s.
        before: (1 + nv,) as for ``observe_point``, to fill.
        ahead: (size,) as for ``observe_point``.
        observation: (numbers,) as for ``observe_point``, to fill.
        counter: of joint constraints.
        past: (5,) as for ``rates_before``; changed.
        stamps: (states,) as for ``rates_before``, ns; changed.
        rates: (states, nv) as for ``rates_before``, rad/s or m/s; changed.
        ages: (n,) to fill: ages of the states answered, ns.

    Returns:
        Why it returns, see ``lane_kernels``.
    """
    words, values, nv, grace = local_whole(WORDS), states.values, v.size, 0
    while link.reads < ages.size:
        if time_of(MONOTONIC, words) >= link.until + grace:
            break
        grace = GRACE_NS
        found = wait_for_message(link.until + grace, link, words, polled)
        if found == GOES_ON:
            continue
        if found != PLAIN:
            return found
        if peek(link, states, words) != PLAIN:
            return TO_READ
        time, real, counted, sent = words[0], words[1], words[2], words[3]
        stamp = plain_stamp(link, values, states.most, active, grasp, held)
        if stamp == UNSOUND or abs(time - stamp) > link.oldest:
            return TO_READ
        configure(Model(numbers, constants), values[link.position : link.position + nv], q)
        put(v, values[link.velocity : link.velocity + nv])
        rates_before(past, stamps, rates, stamp, before)
        code = observe_point(
            numbers,
            constants,
            packed,
            0,
            q,
            v,
            link.point,
            metric,
            rows,
            length,
            delay,
            before,
            ahead,
            observation,
        )
        if code != 0:
            return TO_READ
        model, contact = observation[:MODEL_SIZE], values[link.contact : link.contact + 6]
        message = OperationalModelMessage(models.values)
        write_operational_model(message, stamp, model, contact, values[link.commanded], grasp)
        quaternion = MODEL_QUATERNION
        sound = sound_stamp(models.values, models.most, quaternion, QUATERNION_TOLERANCE)
        if sound == UNSOUND:
            return TO_READ
        # From here on the state counts as answered.
        take(states, words)
        remember_state(past, stamps, rates, stamp, v)
        since = (stamp - link.first) / 1e9
        message.count = count_rigid(counter, observation[: rows.size], since)
        code = publish(link, models, words, real)
        note_read(link, states.reading, ages, time, time - stamp, counted, sent)
        link.last = stamp
        if code != GOES_ON:
            return code
        grace = 0
    return TIME_IS_UP
