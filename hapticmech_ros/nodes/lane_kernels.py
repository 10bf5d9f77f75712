# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parts of kernels that read and write messages of the lane, without Python and its lock.

A node's kernel polls the lane's connections and handles plain messages. Any other message, for
example of another topic or publisher, or one that breaks a rule, stays in its socket: the kernel
returns, and Python handles it.

The watchdog's kernel, :func:`abort_when_still`, needs neither Python nor its lock.
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
from hapticmech_ros.compilation.records import Nested, Record, Vector, Whole
from hapticmech_ros.numerics import Array
from hapticmech_ros.wire.kernels import UNSOUND

# Indices of numbers shared with the loop: its count of iterations, and whether it has ended.
ROUNDS, ENDED = 0, 1
LOOK_US = 250_000
# Most pauses of a process that a kernel notes before it returns.
MOST_PAUSES = 8
_STANDARD_ERROR = 2
# A struct pollfd that waits until standard error can be written (POLLOUT); and the answer's bit.
_POLLED, _TAKES = 2 | 4 << 32, 4 << 48
_STATUS = 134

_usleep = c_function("usleep", "int32(uint32)")
_write = c_function("write", "int64(int32, intp, int64)")
_poll = c_function("poll", "int32(intp, uint64, int32)")
_abort = c_function("abort", "void()")
_exit = c_function("_exit", "void(int32)")


@kernel("void(int64[:], int64[:], int64[:], int64)", waits=True)
def abort_when_still(shared: Array, text: Array, polled: Array, looks: int) -> None:
    """Abort the process if its loop made no iteration over a number of successive checks.

    Checks are counted, not time: a process that is stopped as a whole makes none. If standard error
    cannot be written, as on a terminal that is held, the process exits without a message.

    Args:
        shared: (2,), [:data:`ROUNDS`, :data:`ENDED`]; the loop writes them.
        text: (n,), message to standard error, eight bytes a number.
        polled: (1,), a struct pollfd, as work space.
        looks: number of checks, :data:`LOOK_US` µs apart.
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
            # The loop may have gone on during the write.
            if shared[ROUNDS] == last:
                _abort()


class NotedPauses(Record):
    """Pauses that a kernel has noted, those of its process or of a sender; times are ns.

    Attributes:
        count: their number.
        entries: of each when it ended, and its length.
    """

    dtype = int
    count = Whole()
    entries = Vector(2 * MOST_PAUSES)

    def each(self) -> list[list[int]]:
        """Return when each ended, and its length."""
        found: list[list[int]] = self.entries[: 2 * self.count].reshape(-1, 2).tolist()
        return found


class Link(Record):
    """State shared by a node's kernel and Python; each kernel adds fields of its own.

    Attributes:
        until: set by Python: when to return, ns of the monotonic clock; 0, by a kernel: at once.
        ahead: the node's time minus the monotonic clock, ns.
        step: largest difference of the machine's clock from the node's time, ns.
        oldest: largest difference of a stamp from the node's time, ns.
        behind: longest time since a message was sent, ns.
        until_view: number of messages until a view is due; 0: never.
        pauses: set by the kernel: when the process had no processor, by the monotonic clock.
        asked: since when a connection needs Python, ns of the monotonic clock; 0: none does.
        reads: number of messages read, without gains and messages passed over.
    """

    dtype = int
    until = Whole()
    ahead = Whole()
    step = Whole()
    oldest = Whole()
    behind = Whole()
    until_view = Whole()
    pauses = Nested(NotedPauses)
    asked = Whole()
    reads = Whole()


class CommandPort(Record):
    """Commands of one sender; times are ns.

    Attributes:
        since: only commands with a later stamp count.
        received, received_before: when the present command arrived, and the one before.
        newest, arrived: the newest command's stamp, and when it arrived.
    """

    dtype = int
    since = Whole()
    received = Whole()
    received_before = Whole()
    newest = Whole()
    arrived = Whole()


class DeadlineLink(Link):
    """State of a kernel that does a step at each deadline, under commands; times are ns.

    Attributes:
        next, period: the next deadline, and the period.
        timeout: how long a command is valid; for the mechanism, 0: for ever.
        done: number of steps done.
        missed: number of them that made up for a missed deadline, unpublished.
    """

    next = Whole()
    period = Whole()
    timeout = Whole()
    done = Whole()
    missed = Whole()


class Reading(Record):
    """A topic that is read.

    Attributes:
        head: set by Python: first word of a plain message's header; 0: the kernel reads none.
        connection: its file descriptor.
        number: how many messages its publisher has sent through the middleware.
        length: of a message with its header, bytes.
        data: length of the header and of the bytes after it that all messages share, bytes.
        read: set by the kernel: when the last message was read, ns of the node's time; 0: none.
        counted: its number among its publisher's messages over the lane.
        sent_ns: when it was sent, ns of the machine's clock.
        copied: how many of the messages read the middleware delivers too.
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
        head: set by Python: first word of the header, without the subscriber's topic number.
        hearers: number of processes on the lane that it is sent to.
        number: how many messages were sent through the middleware.
        length: of a message with its header, bytes.
        sent: how many messages were sent over the lane.
        both: 1 if the middleware is to carry them too.
        publishes, publisher: addresses of rcl's function, 0: Python publishes; of the publisher.
        unsent: set by the kernel: a bit for each process that it could not send to.
        left: 1 if Python is to publish the last message.
        message: for rcl; address of the bytes, their number and the buffer's size come first.
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
        prefix: (words,) the bytes after the header that all messages share.
        between: (words,) for a WrenchStamped, the bytes between stamp and wrench.
        frame: (words,) buffer of a message, which begins at byte :data:`BEGINS_AT`.
        copies: (n, words) messages that the middleware delivers too.
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
        frame: (words,) buffer of the message, which begins at byte :data:`BEGINS_AT`.
        targets: (2 n,) file descriptors, each followed by the subscriber's number of the topic.
        values: (n,) the data in ``frame``.
        most: (n,) largest magnitude of each of its numbers.
    """

    sending = RecordPart(Sending, whole=True)
    frame, targets = Part(1, whole=True), Part(1, whole=True)
    values, most = RealTail("frame"), Part(1)


# Why a kernel returns: time is up, or as many messages were read as fit into its arrays; Python has
# to read; a view is due; Python has to send the last message on; Python has to do the step that is
# due; or Python has to publish a step, whose message failed a check.
TIME_IS_UP, TO_READ, TO_LOOK_AT, TO_SEND, TO_ACT, TO_SAY = range(6)
# The kernel does not return.
GOES_ON = -1
# Size of the functions' work space, for times and the words of a message's header.
WORDS = 5
# Length of the header on the lane, and the byte where a message begins in an array of words, so
# that its numbers, which follow four bytes of encapsulation, are at whole words.
HEADER_BYTES, BEGINS_AT = 32, 4
MONOTONIC, REALTIME = 1, 0
SECOND = 1_000_000_000
_IN, _ANSWER_AT = 1, 48
# Bit of a header's first word: the middleware carries the message too.
_BOTH_AT = 8
# In a struct pollfd: wait for POLLIN.
WAITS_TO_READ = _IN << 32
# Word of a WrenchStamped's frame with its seconds and nanoseconds, after header and encapsulation.
_STAMP_AT = 5
_PEEK, _DONT_WAIT, _NO_SIGNAL = 0x2, 0x40, 0x4000
# A process that has not listened to the middleware for longer than this, ns, may miss a stop.
DEAF_NS = 100_000_000
# If time is up during a wait, the kernel returns after the next message, or so much later, ns: a
# return just before a message would delay its answer.
GRACE_NS = 5_000_000
# A connection that needs Python waits for the next step or message if that takes no longer, ns:
# then Python has a whole period.
SOON_NS = 2_000_000
# Longest single wait, ns, so that a wait that ends late shows that the process paused.
_UNSEEN_NS = 5_000_000
# A wait that ends no later than this is no pause: timers may be so late, ns.
SHORTEST_PAUSE_NS = 1_000_000
# After a longer one Python looks after the node at once: a return takes as long as a short pause.
LONG_PAUSE_NS = 5_000_000
NOTHING, PLAIN, OTHER = 0, 1, -1
# Most missed deadlines that are made up for at once.
MOST_MISSED = 31

_ppoll = c_function("ppoll", "int32(intp, uint64, intp, intp)")
_recv = c_function("recv", "int64(int32, intp, uint64, int32)")
_send = c_function("send", "int64(int32, intp, uint64, int32)")
_memcmp = c_function("memcmp", "int32(intp, intp, uint64)")
_memcpy = c_function("memcpy", "intp(intp, intp, uint64)")
_clock_gettime = c_function("clock_gettime", "int32(int32, intp)")
_publish = function_at("int32(intp, intp, intp, intp)")


@inner
def time_of(clock: int, words: Array) -> int:
    """Return a clock's time, ns; overwrites the first two of ``words``."""
    _clock_gettime(clock, words.ctypes.data)
    return int(words[0] * SECOND + words[1])


@inner
def note_pause(link: Link, pauses: NotedPauses, end: int, length: int) -> None:
    """Note a pause; after a long one, or many, let the kernel return early.

    Args:
        link: shared state; changed.
        pauses: those noted so far; changed.
        end: when it ended, ns.
        length: ns.
    """
    at, entries = 2 * pauses.count, pauses.entries
    if at < entries.size:
        entries[at], entries[at + 1] = end, length
        pauses.count += 1
    if length > LONG_PAUSE_NS or at + 2 >= entries.size:
        link.until = 0


@inner
def wait_until(end: int, link: Link, words: Array, polled: Array, plain: int) -> int:
    """Wait for connections until a time, for 5 ms at most; return which can be read.

    If the process paused meanwhile, note it; after a long pause, set ``link.until`` to 0.

    Args:
        end: the time, ns of the monotonic clock.
        link: shared state.
        words: (5,) work space.
        polled: (n,) struct pollfd of the connections, those of plain messages first.
        plain: how many these are.

    Returns:
        NOTHING; a bit for each of the first ones that can be read; or OTHER if there is more.
    """
    now = time_of(MONOTONIC, words)
    left = min(max(end - now, 0), _UNSEEN_NS)
    words[0], words[1] = left // SECOND, left % SECOND
    for i in range(polled.size):
        polled[i] &= (1 << _ANSWER_AT) - 1
    found = _ppoll(polled.ctypes.data, polled.size, words.ctypes.data, 0)
    then = time_of(MONOTONIC, words)
    if then - now - left > SHORTEST_PAUSE_NS:
        note_pause(link, link.pauses, then, then - now - left)
    if found == 0:
        return NOTHING
    ready, bits = 0, 0
    for i in range(plain):
        if polled[i] >> _ANSWER_AT == _IN:
            ready += 1
            bits |= 1 << i
    return bits if ready == found else OTHER


def has_ended(polled: Array) -> bool:
    """Return whether any connection had more than a message when it was waited for: its end.

    Args:
        polled: (n,) struct pollfd.
    """
    return bool((polled >> _ANSWER_AT & ~_IN).any())


@inner
def wait_for_message(end: int, link: Link, words: Array, polled: Array) -> int:
    """Wait for a message on the first connection; arguments as of :func:`wait_until`.

    Returns:
        PLAIN if it can be read; else TO_READ if another one already needed Python, or GOES_ON.
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
    """Return whether the machine's clock was set, from both clocks read together, ns."""
    return bool(abs(real - monotonic - link.ahead) > link.step)


@inner
def peek(link: Link, topic: SubscribedTopic, words: Array) -> int:
    """Copy the next message into the topic's frame, but leave it in its socket; return its kind.

    For a plain one, ``words`` are the node's time, the machine's, the message's number on the lane,
    when it was sent, and the number of its publisher's messages through the middleware. It is
    OTHER also if it was sent too long ago, the clock was set, or ``copies`` are full.

    Args:
        link: shared state.
        topic: that is read.
        words: (5,) to fill; times in ns.

    Returns:
        NOTHING if there is no message; PLAIN; or OTHER.
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
    # Python notes the copies before there are too many.
    return OTHER if late or read.copied == topic.copies.shape[0] else PLAIN


@inner
def arrival(words: Array) -> int:
    """Return when a peeked message was sent, ns of the node's time.

    This is its arrival time too, to within one system call; the kernel may read it later.
    """
    return int(words[0] - max(words[1] - words[3], 0))


@inner
def differs(frame: Array, word: int, expected: Array) -> bool:
    """Return whether a frame's words from index ``word`` on differ from the expected (n,)."""
    found = False
    for i in range(expected.size):
        found = found or frame[word + i] != expected[i]
    return found


@inner
def take(topic: SubscribedTopic, words: Array) -> None:
    """Remove a peeked message from its socket; keep a copy if the middleware delivers it too.

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
    """Remove a message of a topic that is passed over; return whether there was one.

    If the middleware delivers it too, Python has to read it, to detect the copy by its bytes.

    Args:
        link: shared state.
        passed: (n, 9) a :class:`Reading` of each such topic; one with head 0 is not passed over.
        words: (5,) work space.
        connection: its file descriptor.
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
        link: shared state.
        topic: that is read.
        ages: (n,) of messages, ns; to fill.
        time: when it was read, ns of the node's time.
        age: its age, ns.
        counted: its number among its publisher's messages over the lane.
        sent: when it was sent, ns of the machine's clock.
    """
    ages[link.reads] = age
    link.reads += 1
    topic.read, topic.counted, topic.sent_ns = time, counted, sent


@inner
def send_to_all(topic: PublishedTopic, words: Array, real: int) -> None:
    """Send a topic's message over the lane.

    Args:
        topic: of the message.
        words: (5,) work space.
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
    """Return the stamp, ns, of a valid WrenchStamped; UNSOUND if it breaks a rule.

    Args:
        link: shared state.
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
    """Return whether magnitudes of numbers (n,) are at most ``most`` (n,); NaN is not."""
    within = True
    for i in range(most.size):
        within = within and abs(numbers[i]) <= most[i]
    return within


@inner
def write_stamp(frame: Array, stamp: int) -> None:
    """Write the stamp, ns, of a WrenchStamped into its frame."""
    frame[_STAMP_AT] = stamp // SECOND | stamp % SECOND << 32


@inner
def publish_outside(topic: PublishedTopic) -> bool:
    """Publish the last message through rcl if needed; return whether Python has to send it on.

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
    """Send a message by lane and middleware; return why the kernel is to return, or GOES_ON.

    Args:
        link: shared state.
        topic: of the message.
        words: (5,) work space.
        real: the machine's time, ns.
    """
    send_to_all(topic, words, real)
    return went_on(link, publish_outside(topic))


@inner
def went_on(link: Link, left: bool) -> int:
    """Return why the kernel is to return after sending a message, or GOES_ON.

    Args:
        link: shared state.
        left: whether Python has to send it on.
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
        link: shared state.
        words: (5,) work space.
        polled: (n,) struct pollfd of all connections but that of the commands.
        now: ns of the monotonic clock.
    """
    deadline = link.next - link.ahead
    if link.asked != 0:
        wait_until(deadline, link, words, polled[:0], 0)
        return GOES_ON
    if now >= link.until:
        return TIME_IS_UP
    # Once a step was done, time is up only after a step, not during the wait for the next one.
    end = deadline if link.done > 0 else min(deadline, link.until)
    if wait_until(end, link, words, polled, 0) == NOTHING:
        return GOES_ON
    link.asked = time_of(MONOTONIC, words)
    return GOES_ON if deadline - link.asked <= SOON_NS else TO_READ


@inner
def find_command(
    link: DeadlineLink, port: CommandPort, topic: SubscribedTopic, words: Array
) -> int:
    """Return the stamp, ns, of the next command, left in its socket; or NOTHING or OTHER.

    It is OTHER if it is not plain, breaks a rule, is older than the newest one, not newer than
    ``port.since``, or stamped with the present time.

    Args:
        link: shared state.
        port: its sender's commands.
        topic: of the commands.
        words: (5,) to fill, as :func:`peek`.
    """
    found = peek(link, topic, words)
    if found != PLAIN:
        return found
    stamp = read_command(link, topic, words[0])
    newer = stamp >= port.newest and stamp > port.since and stamp != words[0]
    return stamp if newer and stamp != UNSOUND else OTHER


@inner
def take_command(
    link: DeadlineLink,
    port: CommandPort,
    topic: SubscribedTopic,
    words: Array,
    commands: Array,
    stamp: int,
    ages: Array,
) -> bool:
    """Take a found command; return whether the one before is kept for the step that is due.

    It is kept if it arrived before that step's period began, and the new one afterwards.

    Args:
        link: shared state.
        port: its sender's commands; changed.
        topic: of the commands.
        words: (5,) as :func:`find_command` left them.
        commands: (2, 6) the present command, and the one before, N and N m; changed.
        stamp: of the command, ns.
        ages: (n,) of messages, ns; to fill.
    """
    time, came, counted, sent = words[0], arrival(words), words[2], words[3]
    take(topic, words)
    stood = port.received <= known_since(link) < came
    if stood:
        put(commands[1], commands[0])
        port.received_before = port.received
    put(commands[0], topic.values)
    port.received, port.newest, port.arrived = came, stamp, came
    note_read(link, topic.reading, ages, time, came - stamp, counted, sent)
    return bool(stood)


@inner
def known_since(link: DeadlineLink) -> int:
    """Return the latest arrival time, ns, of a command that acts in the step that is due."""
    return int(link.next - link.period - 1)


@inner
def missed_deadlines(link: DeadlineLink, words: Array, now: int, real: int) -> int:
    """Return how many deadlines were missed before the latest one that has passed.

    Args:
        link: shared state.
        words: (5,) work space.
        now: ns of the monotonic clock.
        real: the machine's time, ns.

    Returns:
        Their number; -1 if it exceeds :data:`MOST_MISSED` or a command's timeout, or the machine's
        clock was set.
    """
    missed = int((now - (link.next - link.ahead)) // link.period)
    lapsed = link.timeout > 0 and missed * link.period > link.timeout
    unfit = missed > MOST_MISSED or lapsed or is_set(link, time_of(MONOTONIC, words), real)
    return -1 if unfit else missed


@inner
def made_up(link: DeadlineLink) -> None:
    """Note a step that made up for a missed deadline, and is not published."""
    link.next += link.period
    link.done += 1
    link.missed += 1


@inner
def sampled(port: CommandPort, commands: Array) -> None:
    """Copy the present command to the one before (2, 6), as a step is published."""
    put(commands[1], commands[0])
    port.received_before = port.received


@inner
def stepped(link: DeadlineLink) -> int:
    """Note a step; return its stamp, ns."""
    stamp = link.next
    link.next += link.period
    link.done += 1
    return int(stamp)
