# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One direction of a simulated connection in kernels: messages that are late, uneven, and lost.

A message of number n that is sent at t arrives at t + d (1 + j u), with u evenly spread between -1
and 1, or not at all. Whoever receives takes the newest that has arrived; one that a later one has
overtaken is dropped. u and the loss are functions of seed, direction and n: the same connection
gives the same bits, in a session and in a graph.

A channel is two arrays. Whole numbers: a :data:`STATE`, then for each slot the time of arrival, ns,
the message's number, -1 if the slot is free, and its tag. And a message in each row of the other
one; the last row is the message that was received last.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, kernel, put
from hapticmech_ros.layout import Field, Layout

ONE = Field(1)
# Random numbers' stream; messages sent, and lost; number of the newest that was received, and its
# tag.
STATE = Layout(dict.fromkeys(("stream", "sent", "lost", "newest", "tag"), ONE))
STREAM, SENT, LOST, NEWEST, TAG = STATE.starts(*STATE)
SLOTS, SLOT_SIZE = STATE.size, 3
# Two random numbers, of loss and delay, for each message.
DRAWS = 2
NANOSECONDS = 1e9
WORDS = 18446744073709551616.0


@inner
def mixed(number: int | np.uint64) -> np.uint64:
    """Return 64 bits without any pattern: SplitMix64 (Steele, Lea, Flood 2014)."""
    bits = np.uint64(number) + np.uint64(1)
    bits = bits * np.uint64(0x9E3779B97F4A7C15)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))


@inner
def drawn(stream: int, index: int) -> float:
    """Return the random number of an index, in [0, 1]."""
    return float(np.float64(mixed(np.uint64(stream) + np.uint64(index))) / WORDS)


@inner
def send(
    state: Array,
    rows: Array,
    delay: float,
    jitter: float,
    loss: float,
    time_ns: int,
    tag: int,
    message: Array,
) -> bool:
    """Send a message (n,) at a time (ns); return whether there is room for it."""
    number = state[SENT]
    state[SENT] += 1
    if loss > 0.0 and drawn(state[STREAM], DRAWS * number) < loss:
        state[LOST] += 1
        return True
    uneven = 0.0
    if jitter > 0.0:
        uneven = 2.0 * drawn(state[STREAM], DRAWS * number + 1) - 1.0
    late = int(np.rint(delay * (1.0 + jitter * uneven) * NANOSECONDS))
    for slot in range(rows.shape[0] - 1):
        at = SLOTS + SLOT_SIZE * slot
        if state[at + 1] < 0:
            state[at], state[at + 1], state[at + 2] = time_ns + late, number, tag
            put(rows[slot], message)
            return True
    return False


@inner
def receive(state: Array, rows: Array, time_ns: int) -> bool:
    """Put the newest message that has arrived since the last call into the last row, if any."""
    last, found = rows.shape[0] - 1, -1
    for slot in range(last):
        at = SLOTS + SLOT_SIZE * slot
        number = state[at + 1]
        if number < 0 or state[at] > time_ns:
            continue
        state[at + 1] = -1
        if number > state[NEWEST]:
            state[NEWEST], state[TAG], found = number, state[at + 2], slot
    if found < 0:
        return False
    put(rows[last], rows[found])
    return True


@kernel(
    "boolean(int64[::1], float64[:,::1], float64, float64, float64, int64,"
    " int64, Array(float64, 1, 'C', readonly=True))"
)
def send_message(
    state: Array,
    rows: Array,
    delay: float,
    jitter: float,
    loss: float,
    time_ns: int,
    tag: int,
    message: Array,
) -> bool:
    """Send a message; return whether there was space for it. See :func:`send`.

    Args:
        state: (5 + 3 slots,) whole numbers of the channel, changed.
        rows: (slots + 1, n) messages on the way, and the last one that arrived.
        delay: d, s.
        jitter: j, share of the delay.
        loss: share of messages that do not arrive.
        time_ns: now.
        tag: a number that goes with it.
        message: (n,) numbers.
    """
    return send(state, rows, delay, jitter, loss, time_ns, tag, message)


@kernel("boolean(int64[::1], float64[:,::1], int64)")
def receive_message(state: Array, rows: Array, time_ns: int) -> bool:
    """Put the newest message that has arrived into the last row; return whether one has.

    Args:
        state: (5 + 3 slots,) whole numbers of the channel, changed.
        rows: (slots + 1, n) messages on the way, and the last one that arrived.
        time_ns: present time, ns.
    """
    return receive(state, rows, time_ns)
