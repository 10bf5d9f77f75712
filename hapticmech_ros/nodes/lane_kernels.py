# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parts of kernels that read and write messages of the lane, without Python and its lock.

A node's kernel waits for the lane's connections as ``select`` does, and handles plain messages.
What is not plain it leaves where it is, and returns: whatever a message of another topic, of
another publisher, or one that breaks a rule needs, Python does.

Kernel that waits for a loop to stand still. It needs neither Python nor its lock.
"""

from __future__ import annotations

from hapticmech_ros.compilation import c_function, function_at, inner, kernel
from hapticmech_ros.numerics import Array
from hapticmech_ros.wire.kernels import UNSOUND

# Numbers shared with the loop: how often it went round, and whether it has ended.
ROUNDS, ENDED = 0, 1
LOOK_US = 250_000
_STANDARD_ERROR = 2
# struct pollfd: standard error, whether it takes what is written (POLLOUT), and the answer.
_POLLED, _TAKES = 2 | 4 << 32, 4 << 48
_STATUS = 134

_usleep = c_function("usleep", "int32(uint32)")
_write = c_function("write", "int64(int32, intp, int64)")
_poll = c_function("poll", "int32(intp, uint64, int32)")
_abort = c_function("abort", "void()")
_exit = c_function("_exit", "void(int32)")


@kernel("void(int64[:], int64[:], int64[:], int64)", waits=True)
def abort_when_still(shared: Array, text: Array, polled: Array, looks: int) -> None:
    """Abort the process when its loop has not gone round for so many looks.

    Looks are counted, not time: while the whole process is stopped there are none. Where standard
    error takes nothing, a terminal that is held for instance, the process ends without a word.

    Args:
        shared: (2,), [:data:`ROUNDS`, :data:`ENDED`]; the loop writes them.
        text: (n,), what is written to standard error, eight bytes a number.
        polled: (1,), a struct pollfd to work with.
        looks: how many, :data:`LOOK_US` apart.
    """
    still, last = 0, shared[ROUNDS]
    while shared[ENDED] == 0:
        _usleep(LOOK_US)
        if shared[ROUNDS] != last:
            still, last = 0, shared[ROUNDS]
            continue
        still += 1
        if still >= looks and shared[ENDED] == 0:
            polled[0] = _POLLED
            if _poll(polled.ctypes.data, 1, 0) != 1 or polled[0] & _TAKES == 0:
                _exit(_STATUS)
            _write(_STANDARD_ERROR, text.ctypes.data, 8 * text.size)
            # It may have gone on while that waited.
            if shared[ROUNDS] == last:
                _abort()


# Whole numbers by which Python and kernel tell each other how things stand. What Python tells:
# until when to wait, ns of the monotonic clock; by how much the node's time is ahead of the
# monotonic clock, how far the machine's may be from it, how old a stamp may be, and a message on
# its way, ns; and after how many more messages somebody looks at what is sent, 0 for never. What
# the kernel tells: when it had to wait last, ns of the monotonic clock; and how many messages it
# has read.
UNTIL, AHEAD, STEP, OLDEST, BEHIND, VIEW, IDLE, READS = range(8)
# Those of each topic that is read. What Python tells: the first word of a plain message's header,
# how often its publisher has used the middleware, its length, and where its data begin, bytes. What
# the kernel tells, of the last one that it read: when that was, ns of the node's time, 0 for none;
# how its publisher counts it, and when it was sent; and how many the middleware will bring too.
HEAD, NUMBER, LENGTH, DATA, READ, COUNTED, SENT_NS, COPIED = range(8)
INPUT_SIZE = 8
# Those of each topic that is sent. What Python tells: the first word of the header, how often the
# middleware was used, the message's length, how many were sent, and 1 if the middleware is to carry
# them too; by which function of rcl, 0 for by Python, through which publisher. What the kernel
# tells: to whom the last one could not be sent, a bit each; whether Python is to publish it; and
# from the last number on what rcl takes for the message, its first three words being where its
# bytes are, and twice how many.
OUT_HEAD, OUT_NUMBER, OUT_LENGTH, SENT, BOTH, PUBLISHES, PUBLISHER, UNSENT, LEFT, BYTES = range(10)
OUTPUT_SIZE = 17
# From here on a node's kernel has numbers of its own.
OWN = 8
# Why a kernel returns: time is up, or enough is done; there is something for Python to read; what
# was sent last is to be looked at, or to go to more than the kernel could reach; and Python has to
# act at a deadline, or to say what the kernel did not dare to.
TIME_IS_UP, TO_READ, TO_LOOK_AT, TO_SEND, TO_ACT, TO_SAY = range(6)
# Of a message on the lane, before its bytes; and where in an array of words it begins, so that the
# numbers in it, which follow four bytes of encapsulation, are at whole words.
HEADER_BYTES, BEGINS_AT = 32, 4
MONOTONIC, REALTIME = 1, 0
SECOND = 1_000_000_000
_IN, _ANSWER_AT = 1, 48
# Of a header's first word whether the middleware carries the message too.
_BOTH_AT = 8
# Of a struct pollfd: that it waits for something to read.
WAITS_TO_READ = _IN << 32
# Of a WrenchStamped: the word with its seconds and nanoseconds, behind header and encapsulation.
_STAMP_AT = 5
_PEEK, _DONT_WAIT, _NO_SIGNAL = 0x2, 0x40, 0x4000
_WAITED_NS = 20_000
# Shorter pauses are none: a timer is as late, ns.
SHORTEST_PAUSE_NS = 1_000_000
NOTHING, OTHER = 0, -1

_ppoll = c_function("ppoll", "int32(intp, uint64, intp, intp)")
_recv = c_function("recv", "int64(int32, intp, uint64, int32)")
_send = c_function("send", "int64(int32, intp, uint64, int32)")
_memcmp = c_function("memcmp", "int32(intp, intp, uint64)")
_memcpy = c_function("memcpy", "intp(intp, intp, uint64)")
_clock_gettime = c_function("clock_gettime", "int32(int32, intp)")
_publish = function_at("int32(intp, intp, intp, intp)")


@inner
def time_of(clock: int, words: Array) -> int:
    """Return a clock's time, ns; the first of ``words`` are worked with."""
    _clock_gettime(clock, words.ctypes.data)
    return int(words[0] * SECOND + words[1])


@inner
def wait_until(end: int, link: Array, words: Array, polled: Array, plain: int) -> int:
    """Wait for connections until a time, ns of the monotonic clock.

    Args:
        end: when.
        link: what Python and kernel tell each other; see above.
        words: (5,) to work with.
        polled: (n,) struct pollfd of all connections, those of plain messages first.
        plain: how many these are.

    Returns:
        NOTHING; a bit for each of the first ones that has something to read; or OTHER.
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
    ready, bits = 0, 0
    for i in range(plain):
        if polled[i] >> _ANSWER_AT == _IN:
            ready += 1
            bits |= 1 << i
    return bits if ready == found else OTHER


@inner
def is_set(link: Array, monotonic: int, real: int) -> bool:
    """Return whether the machine's clock was set, by both clocks at one time, ns."""
    return bool(abs(real - monotonic - link[AHEAD]) > link[STEP])


@inner
def peek(
    link: Array, topic: Array, words: Array, connection: int, frame: Array, prefix: Array
) -> bool:
    """Copy the message that has come, and leave it there; return whether it is a plain one.

    Then the node's time, the machine's, the message's number, when it was sent, and how often its
    publisher has used the middleware are the words. It is none if it was long under way, or the
    machine's clock was set.

    Args:
        link: what Python and kernel tell each other; see above.
        topic: likewise, of the topic.
        words: (5,) to fill.
        connection: struct pollfd of what is read.
        frame: (words,) for the message, from :data:`BEGINS_AT` on.
        prefix: (words,) the bytes between header and data.
    """
    at, most = frame.ctypes.data + BEGINS_AT, 8 * frame.size - BEGINS_AT
    size = _recv(connection & 0xFFFFFFFF, at, most, _PEEK | _DONT_WAIT)
    if size != topic[LENGTH]:
        return False
    _memcpy(words.ctypes.data, at, HEADER_BYTES)
    both = words[0] >> _BOTH_AT & 1
    words[4] = words[1]
    if words[0] != topic[HEAD] | both << _BOTH_AT or words[1] != topic[NUMBER] + both:
        return False
    if _memcmp(at + HEADER_BYTES, prefix.ctypes.data, topic[DATA] - HEADER_BYTES) != 0:
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
def take(topic: Array, words: Array, connection: int, frame: Array, copies: Array) -> None:
    """Take a message away that was peeked at.

    Args:
        topic: what Python and kernel tell each other of the topic.
        words: (5,) as :func:`peek` left them.
        connection: struct pollfd of what is read.
        frame: (words,) the message.
        copies: (n, words) of messages that the middleware will bring too, to fill.
    """
    _recv(connection & 0xFFFFFFFF, frame.ctypes.data, 0, _DONT_WAIT)
    if words[4] != topic[NUMBER]:
        _memcpy(copies[topic[COPIED]].ctypes.data, frame.ctypes.data, 8 * frame.size)
        topic[NUMBER] = words[4]
        topic[COPIED] += 1


@inner
def pass_over(link: Array, passed: Array, words: Array, connection: int) -> bool:
    """Take away a message that nobody reads now; return whether there was one.

    One that the middleware carries too is left to Python, which knows it by its bytes.

    Args:
        link: what Python and kernel tell each other.
        passed: (n, 8) likewise, of each topic that is passed over; with a header's first word of 0
            it is not.
        words: (5,) to work with.
        connection: struct pollfd of what is read.
    """
    at = words.ctypes.data
    if _recv(connection & 0xFFFFFFFF, at, HEADER_BYTES, _PEEK | _DONT_WAIT) != HEADER_BYTES:
        return False
    for i in range(passed.shape[0]):
        if words[0] == passed[i, HEAD] and words[1] == passed[i, NUMBER]:
            passed[i, COUNTED], passed[i, SENT_NS] = words[2], words[3]
            passed[i, READ] = time_of(MONOTONIC, words) + link[AHEAD]
            _recv(connection & 0xFFFFFFFF, at, 0, _DONT_WAIT)
            return True
    return False


@inner
def note_read(
    link: Array, topic: Array, ages: Array, time: int, age: int, counted: int, sent: int
) -> None:
    """Note a message that was read.

    Args:
        link: what Python and kernel tell each other.
        topic: likewise, of the topic.
        ages: (n,) of messages, ns; to fill.
        time: when, ns of the node's time.
        age: its age, ns.
        counted: how its publisher counts it.
        sent: when it was sent, ns.
    """
    ages[link[READS]] = age
    link[READS] += 1
    topic[READ], topic[COUNTED], topic[SENT_NS] = time, counted, sent


@inner
def send_to_all(topic: Array, words: Array, frame: Array, targets: Array, real: int) -> None:
    """Send what a frame holds.

    Args:
        topic: what Python and kernel tell each other of the topic.
        words: (5,) to work with.
        frame: (words,) the message, from :data:`BEGINS_AT` on.
        targets: (2 n,) connections, each with the topic's number there.
        real: the machine's time, ns.
    """
    at, length = frame.ctypes.data + BEGINS_AT, topic[OUT_LENGTH]
    topic[SENT] += 1
    topic[OUT_NUMBER] += topic[BOTH]
    words[1], words[2], words[3] = topic[OUT_NUMBER], topic[SENT], real
    for i in range(targets.size // 2):
        words[0] = topic[OUT_HEAD] | topic[BOTH] << _BOTH_AT | targets[2 * i + 1] << 16
        _memcpy(at, words.ctypes.data, HEADER_BYTES)
        if _send(targets[2 * i], at, length, _DONT_WAIT | _NO_SIGNAL) != length:
            topic[UNSENT] |= 1 << i


@inner
def read_command(
    link: Array, frame: Array, plain: Array, values: Array, most: Array, time: int
) -> int:
    """Return the stamp, ns, of a WrenchStamped that keeps the rules; or UNSOUND.

    Args:
        link: what Python and kernel tell each other.
        frame: (words,) the message.
        plain: (2,) the bytes of a plain command between stamp and wrench.
        values: (6,) its wrench.
        most: (6,) largest magnitudes.
        time: now, ns of the node's time.
    """
    if differs(frame, _STAMP_AT + 1, plain):
        return UNSOUND
    for i in range(6):
        if not abs(values[i]) <= most[i]:
            return UNSOUND
    seconds, nanoseconds = frame[_STAMP_AT] & 0xFFFFFFFF, frame[_STAMP_AT] >> 32 & 0xFFFFFFFF
    stamp = int(seconds * SECOND + nanoseconds)
    sound = seconds <= 0x7FFFFFFF and nanoseconds < SECOND and abs(time - stamp) <= link[OLDEST]
    return stamp if sound else UNSOUND


@inner
def write_stamp(frame: Array, stamp: int) -> None:
    """Stamp a WrenchStamped in a frame, ns."""
    frame[_STAMP_AT] = stamp // SECOND | stamp % SECOND << 32


@inner
def publish_outside(topic: Array, frame: Array) -> bool:
    """Have the middleware carry what was sent last; return whether Python has to send it on.

    Args:
        topic: what Python and kernel tell each other of the topic.
        frame: (words,) the message, from :data:`BEGINS_AT` on.
    """
    topic[LEFT] = topic[BOTH]
    if topic[BOTH] != 0 and topic[PUBLISHES] != 0:
        topic[BYTES] = frame.ctypes.data + BEGINS_AT + HEADER_BYTES
        topic[BYTES + 1] = topic[BYTES + 2] = topic[OUT_LENGTH] - HEADER_BYTES
        message = topic[BYTES:].ctypes.data
        topic[LEFT] = _publish(topic[PUBLISHES], topic[PUBLISHER], message, 0) != 0
    return bool(topic[LEFT] != 0 or topic[UNSENT] != 0)


@inner
def look_is_due(link: Array) -> bool:
    """Return whether what was sent last is to be looked at."""
    if link[VIEW] == 0:
        return False
    link[VIEW] -= 1
    return bool(link[VIEW] == 0)
