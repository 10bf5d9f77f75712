# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parts of kernels that read and write messages of the lane, without Python and its lock.

A node's kernel waits for the lane's connections as ``select`` does, and handles plain messages.
What is not plain it leaves where it is, and returns: whatever a message of another topic, of
another publisher, or one that breaks a rule needs, Python does.
"""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import c_function, inner

# Whole numbers by which Python and kernel tell each other how things stand. What Python tells:
# until when to wait, ns of the monotonic clock; the first word of a plain message's header, how
# often its publisher has used the middleware, its length, and where its data begin, bytes; by how
# much the node's time is ahead of the monotonic clock, how far the machine's may be from it, how
# old a stamp may be, and a message on its way, ns; of what is sent the first word of the header,
# how often the middleware was used for it, its length, how many were sent, and after how many more
# somebody looks at one, 0 for never. What the kernel tells: when it had to wait last, ns of the
# monotonic clock; how many messages it has read; of the last one when that was, ns of the node's
# time, how its publisher counts it, and when it was sent; and to whom something could not be sent,
# a bit each.
UNTIL, HEAD, NUMBER, LENGTH, DATA, AHEAD, STEP, OLDEST, BEHIND = range(9)
OUT_HEAD, OUT_NUMBER, OUT_LENGTH, SENT, VIEW = range(9, 14)
IDLE, READS, READ, COUNTED, SENT_NS, UNSENT = range(14, 20)
# From here on a node's kernel has numbers of its own.
OWN = 20
# Why a kernel returns: time is up, or enough is done; there is something for Python to read; what
# was sent last is to be looked at, or was not sent to all; and Python has to act at a deadline, or
# to say what the kernel did not dare to.
TIME_IS_UP, TO_READ, TO_LOOK_AT, NOT_SENT, TO_ACT, TO_SAY = range(6)
# Of a message on the lane, before its bytes; and where in an array of words it begins, so that the
# numbers in it, which follow four bytes of encapsulation, are at whole words.
HEADER_BYTES, BEGINS_AT = 32, 4
MONOTONIC, REALTIME = 1, 0
SECOND = 1_000_000_000
_IN, _ANSWER_AT = 1, 48
# Of a struct pollfd: that it waits for something to read.
WAITS_TO_READ = _IN << 32
_PEEK, _DONT_WAIT, _NO_SIGNAL = 0x2, 0x40, 0x4000
_WAITED_NS = 20_000
NOTHING, PLAIN, OTHER = range(3)

_ppoll = c_function("ppoll", "int32(intp, uint64, intp, intp)")
_recv = c_function("recv", "int64(int32, intp, uint64, int32)")
_send = c_function("send", "int64(int32, intp, uint64, int32)")
_memcmp = c_function("memcmp", "int32(intp, intp, uint64)")
_memcpy = c_function("memcpy", "intp(intp, intp, uint64)")
_clock_gettime = c_function("clock_gettime", "int32(int32, intp)")


@inner
def time_of(clock: int, words: Array) -> int:
    """Return a clock's time, ns; ``words`` (4,) are worked with."""
    _clock_gettime(clock, words.ctypes.data)
    return int(words[0] * SECOND + words[1])


@inner
def wait_until(end: int, link: Array, words: Array, polled: Array) -> int:
    """Wait for connections until a time, ns of the monotonic clock.

    Args:
        end: when.
        link: what Python and kernel tell each other; see above.
        words: (4,) to work with.
        polled: (n,) struct pollfd of all connections, the one of plain messages first.

    Returns:
        NOTHING; PLAIN if the first one has something to read, or OTHER.
    """
    now = time_of(MONOTONIC, words)
    left = max(end - now, 0)
    words[0], words[1] = left // SECOND, left % SECOND
    for i in range(polled.size):
        polled[i] &= (1 << _ANSWER_AT) - 1
    found = _ppoll(polled.ctypes.data, polled.size, words.ctypes.data, 0)
    then = time_of(MONOTONIC, words)
    if found == 0 or then - now > _WAITED_NS:
        link[IDLE] = then
    if found == 0:
        return NOTHING
    return PLAIN if found == 1 and polled[0] >> _ANSWER_AT == _IN else OTHER


@inner
def is_set(link: Array, monotonic: int, real: int) -> bool:
    """Return whether the machine's clock was set, by both clocks at one time, ns."""
    return bool(abs(real - monotonic - link[AHEAD]) > link[STEP])


@inner
def peek(link: Array, words: Array, polled: Array, frame: Array, prefix: Array) -> bool:
    """Copy the message that has come, and leave it there; return whether it is a plain one.

    Then the node's time, the machine's, the message's number and when it was sent are the words.
    It is none if it was long under way, or the machine's clock was set.

    Args:
        link: what Python and kernel tell each other; see above.
        words: (4,) to fill.
        polled: (n,) the first connection is read.
        frame: (words,) for the message, from :data:`BEGINS_AT` on.
        prefix: (words,) the bytes between header and data.
    """
    at, most = frame.ctypes.data + BEGINS_AT, 8 * frame.size - BEGINS_AT
    size = _recv(polled[0] & 0xFFFFFFFF, at, most, _PEEK | _DONT_WAIT)
    if size != link[LENGTH]:
        return False
    _memcpy(words.ctypes.data, at, HEADER_BYTES)
    if words[0] != link[HEAD] or words[1] != link[NUMBER]:
        return False
    if _memcmp(at + HEADER_BYTES, prefix.ctypes.data, link[DATA] - HEADER_BYTES) != 0:
        return False
    monotonic, real = time_of(MONOTONIC, words), time_of(REALTIME, words)
    words[0], words[1] = monotonic + link[AHEAD], real
    return not is_set(link, monotonic, real) and bool(real - words[3] <= link[BEHIND])


@inner
def differs(frame: Array, word: int, expected: Array) -> bool:
    """Return whether a frame has other words than expected, from a number of its words on."""
    found = False
    for i in range(expected.size):
        found = found or frame[word + i] != expected[i]
    return found


@inner
def take(polled: Array, frame: Array) -> None:
    """Take a message away that was peeked at."""
    _recv(polled[0] & 0xFFFFFFFF, frame.ctypes.data, 0, _DONT_WAIT)


@inner
def note_read(link: Array, ages: Array, time: int, age: int, counted: int, sent: int) -> None:
    """Note a message that was read.

    Args:
        link: what Python and kernel tell each other.
        ages: (n,) of messages, ns; to fill.
        time: when, ns of the node's time.
        age: its age, ns.
        counted: how its publisher counts it.
        sent: when it was sent, ns.
    """
    ages[link[READS]] = age
    link[READS] += 1
    link[READ], link[COUNTED], link[SENT_NS] = time, counted, sent


@inner
def send_to_all(link: Array, words: Array, frame: Array, targets: Array, real: int) -> None:
    """Send what a frame holds.

    Args:
        link: what Python and kernel tell each other.
        words: (4,) to work with.
        frame: (words,) the message, from :data:`BEGINS_AT` on.
        targets: (2 n,) connections, each with the topic's number there.
        real: the machine's time, ns.
    """
    at, length = frame.ctypes.data + BEGINS_AT, link[OUT_LENGTH]
    link[SENT] += 1
    words[1], words[2], words[3] = link[OUT_NUMBER], link[SENT], real
    for i in range(targets.size // 2):
        words[0] = link[OUT_HEAD] | targets[2 * i + 1] << 16
        _memcpy(at, words.ctypes.data, HEADER_BYTES)
        if _send(targets[2 * i], at, length, _DONT_WAIT | _NO_SIGNAL) != length:
            link[UNSENT] |= 1 << i


@inner
def look_is_due(link: Array) -> bool:
    """Return whether what was sent last is to be looked at."""
    if link[VIEW] == 0:
        return False
    link[VIEW] -= 1
    return bool(link[VIEW] == 0)
