# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parts of kernels that read and write messages of the lane, without Python and its lock.

A node's kernel waits for the lane's connections as ``select`` does, and handles plain messages.
What is not plain it leaves where it is, and returns: whatever a message of another topic, of
another publisher, or one that breaks a rule needs, Python does.

Kernel that waits for a loop to stand still. It needs neither Python nor its lock.
"""

from __future__ import annotations

from hapticmech_ros.compilation import (
    Part,
    RealTail,
    RecordPart,
    Structure,
    c_function,
    function_at,
    inner,
    kernel,
    put,
)
from hapticmech_ros.compilation.records import Record, Vector, Whole
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


class Link(Record):
    """How things stand, for a node's kernel and for Python; each kernel has fields of its own.

    Attributes:
        until: by Python: when to return, ns of the monotonic clock.
        ahead: by how much the node's time is ahead of the monotonic clock, ns.
        step: how far the machine's time may be from that, ns.
        oldest: how old a stamp may be, ns.
        behind: how long a message may have been on its way, ns.
        until_view: after how many messages what is sent is looked at; 0 for never.
        paused: by the kernel: for how long the process had no processor just now, ns.
        asked: since when Python is wanted, ns of the monotonic clock; 0: it is not.
        reads: how many messages it has read.
    """

    dtype = int
    until = Whole()
    ahead = Whole()
    step = Whole()
    oldest = Whole()
    behind = Whole()
    until_view = Whole()
    paused = Whole()
    asked = Whole()
    reads = Whole()


class DeadlineLink(Link):
    """How things stand, for who acts at deadlines on the commands of another; times are ns.

    Attributes:
        next, period: the next deadline, and the period.
        timeout: how long a command stands; 0 for ever.
        since: from what stamp on commands count.
        received, received_before: since when a command stands, and the one before.
        newest, arrived: the newest stamp, and when it came.
        done: how many steps were done.
        missed: how many of them were late, and made up for in one with the next.
        sampled: by the kernel: stamp of the last step that was published; 0: none was.
    """

    next = Whole()
    period = Whole()
    timeout = Whole()
    since = Whole()
    received = Whole()
    received_before = Whole()
    newest = Whole()
    arrived = Whole()
    done = Whole()
    missed = Whole()
    sampled = Whole()


class Reading(Record):
    """A topic that is read.

    Attributes:
        head: by Python: the first word of a plain message's header.
        connection: over which it comes, a file's number.
        number: how often its publisher has used the middleware.
        length: of a message with its header, bytes.
        data: where its numbers begin, bytes.
        read: by the kernel, of the last message: when it was read, ns of the node's time; 0: none.
        counted: how its publisher counts it.
        sent_ns: when it was sent, ns.
        copied: how many messages the middleware will bring too.
    """

    dtype = int
    head = Whole()
    connection = Whole()
    number = Whole()
    length = Whole()
    data = Whole()
    read = Whole()
    counted = Whole()
    sent_ns = Whole()
    copied = Whole()


class Sending(Record):
    """A topic that is sent.

    Attributes:
        head: by Python: the first word of the header.
        hearers: to how many it is sent over the lane.
        number: how often the middleware was used.
        length: of a message with its header, bytes.
        sent: how many were sent.
        both: 1 if the middleware is to carry them too.
        publishes, publisher: the function of rcl, 0 for by Python, and the publisher.
        unsent: by the kernel: to whom the last one could not be sent, a bit each.
        left: 1 if Python is to publish it.
        message: what rcl takes for it: where its bytes are, and twice how many, come first.
    """

    dtype = int
    head = Whole()
    hearers = Whole()
    number = Whole()
    length = Whole()
    sent = Whole()
    both = Whole()
    publishes = Whole()
    publisher = Whole()
    unsent = Whole()
    left = Whole()
    message = Vector(8)


class SubscribedTopic(Structure):
    """A topic that is read, with room for a message.

    Attributes:
        reading: how it is read.
        prefix: (words,) the bytes that all messages have between header and data.
        between: (words,) of a WrenchStamped those between stamp and wrench.
        frame: (words,) for a message, from :data:`BEGINS_AT` on.
        copies: (n, words) for messages that the middleware will bring too.
        values: (n,) the data in ``frame``.
        most: (n,) largest magnitude of each of its numbers.
    """

    reading = RecordPart(Reading, whole=True)
    prefix, between, frame = Part(1, whole=True), Part(1, whole=True), Part(1, whole=True)
    copies, values, most = Part(2, whole=True), RealTail("frame"), Part(1)


class PublishedTopic(Structure):
    """A topic that is sent, with a message.

    Attributes:
        sending: how it is sent.
        frame: (words,) the message, from :data:`BEGINS_AT` on.
        targets: (2 n,) connections, each with the topic's number there.
        values: (n,) the data in ``frame``.
        most: (n,) largest magnitude of each of its numbers.
    """

    sending = RecordPart(Sending, whole=True)
    frame, targets = Part(1, whole=True), Part(1, whole=True)
    values, most = RealTail("frame"), Part(1)


# Why a kernel returns: time is up, or enough is done; there is something for Python to read; what
# was sent last is to be looked at, or to go to more than the kernel could reach; and Python has to
# act at a deadline, or to say what the kernel did not dare to.
TIME_IS_UP, TO_READ, TO_LOOK_AT, TO_SEND, TO_ACT, TO_SAY = range(6)
# Why it does not return.
GOES_ON = -1
# Of the room that functions work in: times, and the words of a message's header.
WORDS = 5
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
# Who has not listened to the middleware for longer than this, ns, does not hear who would stop it.
DEAF_NS = 100_000_000
# Time that is up in the midst of a wait is up after the next message, or so much later, ns: whoever
# returned at any time would keep the next one waiting.
GRACE_NS = 5_000_000
# Python is given to whoever asks for it after the next step or message, if that comes so soon, ns:
# then there is a whole period for it.
SOON_NS = 2_000_000
# Nobody waits for longer at once: what comes later than that after its end is a pause, ns.
_UNSEEN_NS = 5_000_000
# Shorter pauses are none: a timer is as late, ns.
SHORTEST_PAUSE_NS = 1_000_000
NOTHING, PLAIN, OTHER = 0, 1, -1
# So many missed deadlines are made up for at once.
MOST_MISSED = 7

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
def wait_until(end: int, link: Link, words: Array, polled: Array, plain: int) -> int:
    """Wait for connections until a time, ns of the monotonic clock, or for some milliseconds.

    After a pause of the process there is no time left.

    Args:
        end: when.
        link: how things stand.
        words: (5,) to work with.
        polled: (n,) struct pollfd of all connections that it waits for, those of plain messages
            first.
        plain: how many these are.

    Returns:
        NOTHING; a bit for each of the first ones that has something to read; or OTHER.
    """
    now = time_of(MONOTONIC, words)
    left = min(max(end - now, 0), _UNSEEN_NS)
    words[0], words[1] = left // SECOND, left % SECOND
    for i in range(polled.size):
        polled[i] &= (1 << _ANSWER_AT) - 1
    found = _ppoll(polled.ctypes.data, polled.size, words.ctypes.data, 0)
    then = time_of(MONOTONIC, words)
    if then - now - left > SHORTEST_PAUSE_NS:
        link.paused, link.until = then - now - left, 0
    if found == 0:
        return NOTHING
    ready, bits = 0, 0
    for i in range(plain):
        if polled[i] >> _ANSWER_AT == _IN:
            ready += 1
            bits |= 1 << i
    return bits if ready == found else OTHER


def has_ended(polled: Array) -> bool:
    """Return whether more than a message was found on any of (n,) struct pollfd: its end."""
    return bool((polled >> _ANSWER_AT & ~_IN).any())


@inner
def wait_for_message(end: int, link: Link, words: Array, polled: Array) -> int:
    """Wait for a message of the first connection; arguments as of :func:`wait_until`.

    Returns:
        PLAIN if there may be one; else why the kernel is to return, or GOES_ON.
    """
    if link.asked != 0:
        found = wait_until(link.asked + SOON_NS, link, words, polled[:1], 1)
        return PLAIN if found > 0 else TO_READ
    found = wait_until(end, link, words, polled, 1)
    if found == OTHER:
        link.asked = time_of(MONOTONIC, words)
    return PLAIN if found > 0 else GOES_ON


@inner
def is_set(link: Link, monotonic: int, real: int) -> bool:
    """Return whether the machine's clock was set, by both clocks at one time, ns."""
    return bool(abs(real - monotonic - link.ahead) > link.step)


@inner
def peek(link: Link, topic: SubscribedTopic, words: Array) -> int:
    """Copy the message that has come, and leave it there; return what it is.

    If it is a plain one the words are the node's time, the machine's, the message's number, when it
    was sent, and how often its publisher has used the middleware. It is none if it was long under
    way, or the machine's clock was set.

    Args:
        link: how things stand.
        topic: that is read.
        words: (5,) to fill.

    Returns:
        NOTHING has come; PLAIN, or OTHER.
    """
    read, frame = topic.reading, topic.frame
    at, most = frame.ctypes.data + BEGINS_AT, 8 * frame.size - BEGINS_AT
    size = _recv(read.connection, at, most, _PEEK | _DONT_WAIT)
    if size != read.length:
        return NOTHING if size == -1 else OTHER
    _memcpy(words.ctypes.data, at, HEADER_BYTES)
    both = words[0] >> _BOTH_AT & 1
    words[4] = words[1]
    if words[0] != read.head | both << _BOTH_AT or words[1] != read.number + both:
        return OTHER
    if _memcmp(at + HEADER_BYTES, topic.prefix.ctypes.data, read.data - HEADER_BYTES) != 0:
        return OTHER
    monotonic, real = time_of(MONOTONIC, words), time_of(REALTIME, words)
    words[0], words[1] = monotonic + link.ahead, real
    late = is_set(link, monotonic, real) or real - words[3] > link.behind
    # Copies are noted by Python before there are too many.
    return OTHER if late or read.copied == topic.copies.shape[0] else PLAIN


@inner
def arrival(words: Array) -> int:
    """Return when a message that was peeked at was sent, ns of the node's time.

    It had come by then but for the time of a call: who reads it later was not waiting for it.
    """
    return int(words[0] - max(words[1] - words[3], 0))


@inner
def differs(frame: Array, word: int, expected: Array) -> bool:
    """Return whether a frame has other words than expected, from a number of its words on."""
    found = False
    for i in range(expected.size):
        found = found or frame[word + i] != expected[i]
    return found


@inner
def take(topic: SubscribedTopic, words: Array) -> None:
    """Take a message away that was peeked at.

    Args:
        topic: of the message.
        words: (5,) as :func:`peek` left them.
    """
    read, frame = topic.reading, topic.frame
    _recv(read.connection, frame.ctypes.data, 0, _DONT_WAIT)
    if words[4] != read.number:
        _memcpy(topic.copies[read.copied].ctypes.data, frame.ctypes.data, 8 * frame.size)
        read.number = words[4]
        read.copied += 1


@inner
def pass_over(link: Link, passed: Array, words: Array, connection: int) -> bool:
    """Take away a message that nobody reads now; return whether there was one.

    One that the middleware carries too is left to Python, which knows it by its bytes.

    Args:
        link: how things stand.
        passed: (n, 9) a :class:`Reading` of each topic that is passed over; with a head of 0 it is
            not.
        words: (5,) to work with.
        connection: over which it has come, a file's number.
    """
    at = words.ctypes.data
    if _recv(connection, at, HEADER_BYTES, _PEEK | _DONT_WAIT) != HEADER_BYTES:
        return False
    for i in range(passed.shape[0]):
        topic = Reading(passed[i])
        if words[0] == topic.head and words[1] == topic.number:
            topic.counted, topic.sent_ns = words[2], words[3]
            topic.read = time_of(MONOTONIC, words) + link.ahead
            _recv(connection, at, 0, _DONT_WAIT)
            return True
    return False


@inner
def note_read(
    link: Link, topic: Reading, ages: Array, time: int, age: int, counted: int, sent: int
) -> None:
    """Note a message that was read.

    Args:
        link: how things stand.
        topic: that is read.
        ages: (n,) of messages, ns; to fill.
        time: when, ns of the node's time.
        age: its age, ns.
        counted: how its publisher counts it.
        sent: when it was sent, ns.
    """
    ages[link.reads] = age
    link.reads += 1
    topic.read, topic.counted, topic.sent_ns = time, counted, sent


@inner
def send_to_all(topic: PublishedTopic, words: Array, real: int) -> None:
    """Send a topic's message over the lane.

    Args:
        topic: of the message.
        words: (5,) to work with.
        real: the machine's time, ns.
    """
    sends, targets = topic.sending, topic.targets
    at, length = topic.frame.ctypes.data + BEGINS_AT, sends.length
    sends.sent += 1
    sends.number += sends.both
    words[1], words[2], words[3] = sends.number, sends.sent, real
    for i in range(sends.hearers):
        words[0] = sends.head | sends.both << _BOTH_AT | targets[2 * i + 1] << 16
        _memcpy(at, words.ctypes.data, HEADER_BYTES)
        if _send(targets[2 * i], at, length, _DONT_WAIT | _NO_SIGNAL) != length:
            sends.unsent |= 1 << i


@inner
def read_command(link: Link, topic: SubscribedTopic, time: int) -> int:
    """Return the stamp, ns, of a WrenchStamped that keeps the rules; or UNSOUND.

    Args:
        link: how things stand.
        topic: of the command.
        time: now, ns of the node's time.
    """
    frame = topic.frame
    if differs(frame, _STAMP_AT + 1, topic.between) or not is_within(topic.values, topic.most):
        return UNSOUND
    seconds, nanoseconds = frame[_STAMP_AT] & 0xFFFFFFFF, frame[_STAMP_AT] >> 32 & 0xFFFFFFFF
    stamp = int(seconds * SECOND + nanoseconds)
    sound = seconds <= 0x7FFFFFFF and nanoseconds < SECOND and abs(time - stamp) <= link.oldest
    return stamp if sound else UNSOUND


@inner
def is_within(numbers: Array, most: Array) -> bool:
    """Return whether numbers (n,) are within magnitudes (n,), which no NaN is."""
    within = True
    for i in range(most.size):
        within = within and abs(numbers[i]) <= most[i]
    return within


@inner
def write_stamp(frame: Array, stamp: int) -> None:
    """Stamp a WrenchStamped in a frame, ns."""
    frame[_STAMP_AT] = stamp // SECOND | stamp % SECOND << 32


@inner
def publish_outside(topic: PublishedTopic) -> bool:
    """Have the middleware carry what was sent last; return whether Python has to send it on.

    Args:
        topic: of the message.
    """
    sends = topic.sending
    sends.left = sends.both
    if sends.both != 0 and sends.publishes != 0:
        message = sends.message
        message[0] = topic.frame.ctypes.data + BEGINS_AT + HEADER_BYTES
        message[1] = message[2] = sends.length - HEADER_BYTES
        failed = _publish(sends.publishes, sends.publisher, message.ctypes.data, 0)
        sends.left = int(failed != 0)
    return bool(sends.left != 0 or sends.unsent != 0)


@inner
def publish(link: Link, topic: PublishedTopic, words: Array, real: int) -> int:
    """Send a topic's message by all ways; return why the kernel is to return, or GOES_ON.

    Args:
        link: how things stand.
        topic: of the message.
        words: (5,) to work with.
        real: the machine's time, ns.
    """
    send_to_all(topic, words, real)
    return went_on(link, publish_outside(topic))


@inner
def went_on(link: Link, left: bool) -> int:
    """Return why the kernel is to return after a message, or GOES_ON.

    Args:
        link: how things stand.
        left: whether Python has to send some of it.
    """
    if link.until_view != 0:
        link.until_view -= 1
        if link.until_view == 0:
            return TO_LOOK_AT
    if left:
        return TO_SEND
    return TO_READ if link.asked != 0 else GOES_ON


@inner
def wait_for_deadline(link: DeadlineLink, words: Array, polled: Array, now: int) -> int:
    """Wait for the next deadline; return why the kernel is to return, or GOES_ON.

    Args:
        link: how things stand.
        words: (5,) to work with.
        polled: (n,) struct pollfd of all connections but that of the commands.
        now: ns of the monotonic clock.
    """
    deadline = link.next - link.ahead
    if link.asked != 0:
        wait_until(deadline, link, words, polled[:0], 0)
        return GOES_ON
    if now >= link.until:
        return TIME_IS_UP
    # After a step there is time for Python, and not in the midst of the wait for the next.
    end = deadline if link.done > 0 else min(deadline, link.until)
    if wait_until(end, link, words, polled, 0) == NOTHING:
        return GOES_ON
    link.asked = time_of(MONOTONIC, words)
    return GOES_ON if deadline - link.asked <= SOON_NS else TO_READ


@inner
def find_command(link: DeadlineLink, topic: SubscribedTopic, words: Array) -> int:
    """Return the stamp, ns, of the command that has come; NOTHING has, or OTHER than a plain one.

    It is left there, as by :func:`peek`. One that a newer one has overtaken is no plain one.

    Args:
        link: how things stand.
        topic: of the commands.
        words: (5,) to fill, as :func:`peek`.
    """
    found = peek(link, topic, words)
    if found != PLAIN:
        return found
    stamp = read_command(link, topic, words[0])
    newer = stamp >= link.newest and stamp > link.since and stamp != words[0]
    return stamp if newer and stamp != UNSOUND else OTHER


@inner
def take_command(
    link: DeadlineLink,
    topic: SubscribedTopic,
    words: Array,
    commands: Array,
    stamp: int,
    ages: Array,
) -> bool:
    """Take a command away that was found; return whether the one before stood at the last step.

    That one acts in the step that is due: nobody had to be there for what came meanwhile.

    Args:
        link: how things stand.
        topic: of the commands.
        words: (5,) as :func:`find_command` left them.
        commands: (2, 6) the command that stands, and the one before; changed.
        stamp: of the command, ns.
        ages: (n,) of messages, ns; to fill.
    """
    time, came, counted, sent = words[0], arrival(words), words[2], words[3]
    take(topic, words)
    stood = link.received <= known_since(link) < came
    if stood:
        put(commands[1], commands[0])
        link.received_before = link.received
    put(commands[0], topic.values)
    link.received, link.newest, link.arrived = came, stamp, came
    note_read(link, topic.reading, ages, time, came - stamp, counted, sent)
    return bool(stood)


@inner
def known_since(link: DeadlineLink) -> int:
    """Return until when, ns, a command must have come to act in the step that is due."""
    return int(link.next - link.period - 1)


@inner
def missed_deadlines(link: DeadlineLink, words: Array, now: int, real: int) -> int:
    """Return how many deadlines have passed before the last one.

    Args:
        link: how things stand.
        words: (5,) to work with.
        now: ns of the monotonic clock.
        real: the machine's time, ns.

    Returns:
        As many as can be made up for with the last one; -1: more, or the machine's clock was set.
    """
    missed = int((now - (link.next - link.ahead)) // link.period)
    unfit = missed > MOST_MISSED or is_set(link, time_of(MONOTONIC, words), real)
    return -1 if unfit else missed


@inner
def made_up(link: DeadlineLink) -> None:
    """Note that a step was done whose deadline was missed, and which is not published."""
    link.next += link.period
    link.done += 1
    link.missed += 1


@inner
def stepped(link: DeadlineLink, commands: Array) -> int:
    """Note a step that was done under the commands (2, 6); return its stamp, ns."""
    put(commands[1], commands[0])
    link.received_before = link.received
    stamp = link.next
    link.next += link.period
    link.done += 1
    return int(stamp)
