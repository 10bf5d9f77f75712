# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A lane between nodes of one host and one user, for messages of the control rate.

A subscriber has a socket in a folder that only this user can access. A publisher connects to it,
receives the list of topics subscribed to there, and sends their messages.

Connections are sockets of type AF_UNIX, SOCK_SEQPACKET: messages stay whole and in order, a full
socket refuses instead of blocking, and Linux closes a connection when the process at its other end
ends, for whatever reason. Linux also provides the peers' user ids.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import secrets
import select
import socket
import stat
import struct
import sys
import tempfile
import termios
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, Protocol

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.nodes.sources import NO_ORIGIN, Batch, BatchListener, Listener, Origin
from hapticmech_ros.nodes.turn import Turn
from hapticmech_ros.numerics.times import NANOSECONDS

# Environment variables of the middleware's discovery; the network namespace counts as well.
SETTINGS = (
    *("RMW_IMPLEMENTATION", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_STATIC_PEERS"),
    *("ROS_LOCALHOST_ONLY", "ROS_DISCOVERY_SERVER", "ROS_SUPER_CLIENT"),
    *("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE", "CYCLONEDDS_URI"),
)
DOMAIN = "ROS_DOMAIN_ID"
SECURED = "ROS_SECURITY_ENABLE"


class LaneError(HapticMechError):
    """The lane cannot be opened; messages go through the middleware."""


def lane_folder(environment: Mapping[str, str]) -> Path:
    """Return the folder of the sockets for this environment, and make it if it does not exist.

    It is in ``XDG_RUNTIME_DIR`` if that is accessible to this user only, or else in the folder for
    temporary files.

    Raises:
        LaneError: the folder cannot be made, other users can access it, or DDS security is on,
            whose permissions only the middleware enforces.
    """
    if environment.get(SECURED, "").lower() == "true":
        raise LaneError(f"{SECURED} is true: only the middleware enforces permissions")
    user = os.geteuid()
    runtime = environment.get("XDG_RUNTIME_DIR", "")
    above = Path(runtime if _is_private(runtime) else tempfile.gettempdir())
    return _private(_private(above / f"hapticmech_ros-{user}") / _name(environment))


def _name(environment: Mapping[str, str]) -> str:
    """Return a folder's name, the same for all processes with equal settings of discovery.

    It is short enough for a socket's path.
    """
    settings = [f"{name}={environment.get(name, '')}" for name in SETTINGS]
    found = Path("/proc/self/ns/net")
    network = str(found.readlink()) if found.exists() else ""
    settings_hash = hashlib.sha256("\n".join([network, *settings]).encode()).hexdigest()
    domain = environment.get(DOMAIN, "").strip() or "0"
    return f"{hashlib.sha256(domain.encode()).hexdigest()[:6]}{settings_hash[:10]}"


def _private(folder: Path) -> Path:
    """Make a folder unless it exists, and return it.

    Raises:
        LaneError: it cannot be made, or other users can access it.
        FileNotFoundError: it was removed in between.
    """
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise LaneError(f"{folder}: {error.strerror}") from None
    if not folder.exists():
        raise FileNotFoundError(folder)
    if not _is_private(str(folder)):
        raise LaneError(f"{folder}: must be a folder of mode 0700 of this user")
    return folder


def _is_private(folder: str) -> bool:
    """Return whether a path is a folder, not a link, of this user and accessible to no other."""
    try:
        found = os.lstat(folder)
    except OSError:
        return False
    others = stat.S_IMODE(found.st_mode) & 0o077
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid() and not others


# Largest message on the lane, bytes; larger ones go through the middleware.
MOST_BYTES = 1 << 16
# Longest list of a process's subscribed topics, bytes.
MOST_TOLD = 1 << 17
# Largest backlog of a subscriber that wants every message, in messages: some ten seconds of a
# node's topics at 1 kHz. A recorder may get little processor time for as long on a busy machine.
MOST_BEHIND = 30_000
# Most messages of a backlog sent at once, so as not to delay the sender's own work.
MOST_AT_ONCE = 16
# A process that has taken nothing for this long, ns, is stalled; the middleware may soon drop it
# from its subscribers. Longer than a process waits for a processor where the control loop takes
# nearly all of them: using the middleware then, which costs more, would take the rest. Shorter than
# the leases of participants (10 s with Cyclone DDS, 20 s with Fast DDS).
STALLED_NS = 5 * NANOSECONDS
# Send buffer of a connection to a subscriber that wants every message, bytes; Linux may grant less.
KEPT_BYTES = 1 << 22
# What a message takes of a socket's buffer besides its bytes.
OVERHEAD_BYTES = 768
# Limit of file descriptors that select accepts.
MOST_SOCKETS = 1024
# Kind; whether the middleware carries the message too; the receiver's number of the topic; the
# sender's outlet; number of the outlet's last message through the middleware; number of this one
# among the outlet's on the lane; when it was sent, ns of the machine's clock.
HEADER = struct.Struct("<BBHIQQq")
MESSAGE, TOPICS = 1, 2
# A receiver numbers its topics below this.
MOST_CODES = 1 << 16
_VERSION = 3
_BACKLOG = 64
_CREDENTIALS = struct.Struct("3i")
_NO_BYTES = bytes(struct.calcsize("i"))
# Most lists of topics of a peer read at once; the rest are read with the next call.
_MOST_LISTS = 16


class BrokenRuleError(Exception):
    """The other end breaks this module's protocol."""


class Outgoing:
    """A connection to a subscribing process.

    If it is full, a message is dropped, or kept for a process that wants all messages.

    Args:
        name: of the process's socket.
        connection: to the process.

    Attributes:
        topics: subscribed to there: the process's number of each, and how many listeners it has.
        lost: number of messages not sent because the connection was full.
        stalled: whether the process has taken nothing for :data:`STALLED_NS`.
    """

    def __init__(self, name: str, connection: socket.socket) -> None:
        self.name = name
        self.connection = connection
        self.topics: dict[str, tuple[int, int]] = {}
        self.lost = 0
        self.stalled = False
        self._behind: deque[bytes] | None = None
        # Views are sent by another thread.
        self._lock = threading.Lock()
        # Since when the connection is full, ns; 0: it is not.
        self._full_ns = 0

    def send(self, frame: bytes) -> bool:
        """Send or keep a frame; return False if the connection is closed."""
        with self._lock:
            behind = self._behind
            if behind:
                self._keep(behind, frame)
                return self._flush(behind)
            try:
                self.connection.send(frame)
            except BlockingIOError:
                self._full_ns = self._full_ns or time.monotonic_ns()
                if behind is None:
                    self.lost += 1
                else:
                    self._keep(behind, frame)
            except OSError:
                return False
            else:
                self._full_ns = 0
            return True

    @property
    def wants_all(self) -> bool:
        """Whether the process wants every message, and not only the latest ones."""
        return self._behind is not None

    @property
    def is_behind(self) -> bool:
        """Whether messages are kept for the process."""
        return bool(self._behind)

    @property
    def is_full(self) -> bool:
        """Whether the connection refuses messages at present."""
        return self._full_ns > 0

    def stalls_or_goes_on(self) -> bool:
        """Update :attr:`stalled`; return whether it has changed."""
        before, full = self.stalled, self._full_ns
        self.stalled = full > 0 and time.monotonic_ns() - full > STALLED_NS
        return self.stalled != before

    def flush(self) -> bool:
        """Send up to MOST_AT_ONCE kept messages; return False if the connection is closed."""
        with self._lock:
            return not self._behind or self._flush(self._behind)

    def _flush(self, behind: deque[bytes]) -> bool:
        try:
            for _ in range(min(len(behind), MOST_AT_ONCE)):
                self.connection.send(behind[0])
                behind.popleft()
                self._full_ns = 0
        except BlockingIOError:
            self._full_ns = self._full_ns or time.monotonic_ns()
        except OSError:
            return False
        return True

    def read_topics(self) -> None:
        """Read the topics that the other end subscribes to; the last of several lists counts.

        Raises:
            BlockingIOError: all lists are read; without this error there may be more.
            OSError: the connection is closed.
            BrokenRuleError: a list is not valid.
        """
        for _ in range(_MOST_LISTS):
            frame = self.connection.recv(HEADER.size + MOST_TOLD)
            if not frame:
                raise ConnectionResetError
            try:
                announced = json.loads(frame[HEADER.size :])
                if announced["version"] != _VERSION:
                    raise BrokenRuleError
                topics = {
                    str(name): (int(code), int(n)) for name, code, n, _ in announced["topics"]
                }
                every = any(bool(all_) for *_, all_ in announced["topics"])
            except (KeyError, TypeError, ValueError, ArithmeticError, RecursionError):
                raise BrokenRuleError from None
            if not all(0 <= code < MOST_CODES and n > 0 for code, n in topics.values()):
                raise BrokenRuleError
            self.topics = topics
            if every and self._behind is None:
                self._behind = deque(maxlen=MOST_BEHIND)
                self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, KEPT_BYTES)

    def _keep(self, behind: deque[bytes], frame: bytes) -> None:
        self.lost += len(behind) == behind.maxlen
        behind.append(frame)


class Incoming:
    """A connection from a publishing process.

    Args:
        connection: to the process.
        serial: number of the connection in this process.

    Attributes:
        announced: version of the list of this process's topics last sent to it.
    """

    def __init__(self, connection: socket.socket, serial: int) -> None:
        self.connection = connection
        self.serial = serial
        self.announced = -1

    def bytes_waiting(self) -> int:
        """Return how many bytes can be read from the connection."""
        there = fcntl.ioctl(self.connection, termios.FIONREAD, _NO_BYTES)
        return int.from_bytes(there, sys.byteorder)

    def announce(self, topics: Sequence[tuple[str, int, int, bool]], version: int) -> None:
        """Send this process's subscribed topics; with a full socket, do nothing.

        Args:
            topics: name and type, number, how many listeners, whether any wants all messages.
            version: of this list.

        Raises:
            OSError: the connection is closed.
        """
        text = json.dumps({"version": _VERSION, "topics": topics}).encode()
        if len(text) > MOST_TOLD:
            text = json.dumps({"version": _VERSION, "topics": []}).encode()
        try:
            self.connection.send(HEADER.pack(TOPICS, 0, 0, 0, 0, 0, 0) + text)
        except BlockingIOError:
            return
        self.announced = version


def listening(folder: Path, name: str) -> socket.socket:
    """Return a listening socket in a folder.

    Raises:
        OSError: it cannot be made, or the folder does not exist.
    """
    made = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    unready = folder / f".{name}"
    try:
        made.setblocking(False)
        made.bind(str(unready))
        made.listen(_BACKLOG)
        # Renamed once it accepts connections: a visible socket that does not is a dead process's.
        unready.rename(folder / name)
        if made.fileno() >= MOST_SOCKETS:
            raise OSError("too many open files to wait for one more")
    except OSError:
        made.close()
        unready.unlink(missing_ok=True)
        raise
    return made


def connected(path: Path) -> socket.socket | None:
    """Return a connection to the process whose socket is at a path; None: try again later.

    Raises:
        ConnectionRefusedError: that process has ended.
    """
    try:
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    except OSError:
        # Too many open files.
        return None
    connection.setblocking(False)
    try:
        connection.connect(str(path))
    except OSError as error:
        connection.close()
        if isinstance(error, ConnectionRefusedError):
            raise
        return None
    return connection


def remove_socket(path: Path) -> None:
    """Remove the socket of an ended process; a path that is no socket is left."""
    try:
        if stat.S_ISSOCK(path.lstat().st_mode):
            path.unlink()
    except OSError:
        # It does not exist any more, or cannot be removed.
        pass


def is_ours(connection: socket.socket) -> bool:
    """Return whether the other end is this user's and select accepts the socket; else close it."""
    credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    _, user, _ = _CREDENTIALS.unpack(credentials)
    if user == os.geteuid() and connection.fileno() < MOST_SOCKETS:
        return True
    connection.close()
    return False


# Period of the search for new processes, and of sending kept messages again, ns.
LOOK_NS = NANOSECONDS // 10
# A process sets up its socket in less than this, s.
UNREADY_S = 10.0
# A process that reads a message later than this after it was sent, ns, is behind: it then reads all
# messages that have arrived, and delivers the newest.
BEHIND_NS = 3_000_000


class Arrived(NamedTuple):
    """A received message or batch, its origin, and the listener to call."""

    listener: Callable[..., None]
    message: bytes | Batch
    origin: Origin


@dataclass(slots=True)
class _Subscription:
    """A topic that this process subscribes to."""

    topic: str
    code: int
    listeners: list[Listener] = field(default_factory=list)
    batch_listeners: list[Callable[[Batch, Origin], None]] = field(default_factory=list)
    batch: Batch = field(default_factory=list)

    @property
    def count(self) -> int:
        """Number of listeners."""
        return len(self.listeners) + len(self.batch_listeners)


class Waits(Protocol):
    """Waits for connections in place of ``select``, and handles messages meanwhile."""

    def prepare(self, lane: Lane, waited: list[int], until_ns: int) -> bool:
        """Return whether this object can wait now; see ``PlainMessages``."""

    def __call__(self, lane: Lane) -> Sequence[int]:
        """Return the file descriptors that may be readable; see ``PlainMessages``."""

    @property
    def has_news(self) -> bool:
        """Whether that work should end, to begin anew; see ``PlainMessages``."""

    @property
    def stepped(self) -> bool:
        """Whether that work was steps at deadlines, the next included; see ``PlainMessages``."""

    def took(self, topic: str, message: bytes) -> bool | None:
        """Return whether a message was read during that work; see ``PlainMessages``."""

    @property
    def settled(self) -> bool:
        """Whether the node's state includes the results of that work."""

    def settle(self) -> None:
        """Update the node's state with these results; see ``PlainMessages``."""


class Lane:
    """A node's connections to the other nodes on the lane.

    Args:
        folder: of the sockets; accessible to this user only.

    Attributes:
        refused: number of connections and messages that broke the rules.
        sent: number of messages sent by each outlet, by a kernel included.
        copied: topic and message of each received one that the middleware delivers too; the caller
            of :meth:`collect` takes them.
        wait: waits in place of ``select``; see :class:`Waits`. None: ``select`` waits.
        worked: whether :attr:`wait` was used in the last :meth:`collect`.
        fullest: bytes, with overhead, that the last :meth:`collect` found in the fullest socket.
        turn: of the node's threads.

    Raises:
        OSError: the socket cannot be made.
    """

    def __init__(self, folder: Path) -> None:
        self.refused = 0
        self.copied: list[tuple[str, bytes]] = []
        self.wait: Waits | None = None
        self.worked = False
        self.fullest = 0
        self.turn = Turn()
        self._folder = folder
        self._name = f"{os.getpid()}-{secrets.token_hex(4)}"
        self._subscriptions: dict[str, _Subscription] = {}
        self._codes: dict[int, _Subscription] = {}
        self._filled: list[_Subscription] = []
        self._records = False
        self._next_code = self._next_serial = 1
        # Incremented with every change of the subscriptions.
        self._version = 0
        self._outgoing: dict[int, Outgoing] = {}
        self._incoming: dict[int, Incoming] = {}
        self._to: dict[str, list[tuple[Outgoing, int]]] = {}
        self._readers: dict[str, int] = {}
        self.sent: Counter[int] = Counter()
        self._known: set[str] = {self._name}
        self._folder_ns = self._looked_ns = -1
        # Connections that have ended, to be closed by the loop's thread.
        self._ended: list[socket.socket] = []
        self._listening = listening(folder, self._name)
        self._wait_for_all()
        self._frame = memoryview(bytearray(HEADER.size + MOST_BYTES))

    @classmethod
    def open(cls, environment: Mapping[str, str]) -> Lane:
        """Return a lane in the folder for this environment.

        Raises:
            LaneError: it cannot be opened.
        """
        if not hasattr(socket, "SOCK_SEQPACKET") or not hasattr(socket, "SO_PEERCRED"):
            raise LaneError("this system has no sequenced-packet sockets that know their peers")
        for _ in range(10):
            try:
                return cls(lane_folder(environment))
            except FileNotFoundError:
                # The last process there has just ended, and removed the folder.
                continue
            except OSError as error:
                raise LaneError(f"no socket for the lane: {error}") from None
        raise LaneError("no socket for the lane: its folder was removed again and again")

    def close(self) -> None:
        """Close all connections, and remove the socket, and the folder if it is empty."""
        for outgoing in list(self._outgoing.values()):
            self._drop(outgoing)
        for incoming in list(self._incoming.values()):
            self._close_incoming(incoming)
        self._close_ended()
        self._listening.close()
        self.turn.close()
        with suppress(OSError):  # other processes' sockets may be there
            (self._folder / self._name).unlink()
            self._folder.rmdir()

    @property
    def linked(self) -> bool:
        """Whether another process is connected as a publisher."""
        return bool(self._incoming)

    @property
    def lost(self) -> int:
        """Number of messages not sent because a connection was full."""
        return sum(outgoing.lost for outgoing in self._outgoing.values())

    def listen(self, topic: str, listener: Listener) -> None:
        """Subscribe to the latest message of each publisher of a topic.

        Args:
            topic: full name and type.
            listener: called with a message, serialized, and its origin.
        """
        self._subscription(topic).listeners.append(listener)
        self._announce_anew()

    def listen_to_all(self, topic: str, listener: BatchListener) -> None:
        """Subscribe to all messages of a topic; those received together are delivered together.

        Args:
            topic: full name and type.
            listener: called with messages, serialized, each with its origin.
        """
        self._subscription(topic).batch_listeners.append(lambda batch, _: listener(batch))
        self._records = True
        self._announce_anew()

    def _subscription(self, topic: str) -> _Subscription:
        subscription = self._subscriptions.get(topic)
        if subscription is None:
            while self._next_code in self._codes:
                self._next_code = (self._next_code + 1) % MOST_CODES
            subscription = self._subscriptions[topic] = _Subscription(topic, self._next_code)
            self._codes[self._next_code] = subscription
            self._next_code = (self._next_code + 1) % MOST_CODES
        return subscription

    def silence(self, topic: str, listener: Listener) -> None:
        """Unsubscribe from the latest messages of a topic."""
        subscription = self._subscriptions[topic]
        subscription.listeners.remove(listener)
        if not subscription.count:
            del self._subscriptions[topic], self._codes[subscription.code]
        self._announce_anew()

    def readers(self, topic: str) -> int:
        """Return a topic's number of listeners at other nodes, stalled ones excluded."""
        return self._readers.get(topic, 0)

    def send(self, topic: str, outlet: int, number: int, message: bytes, both: bool) -> None:
        """Send a message to all subscribers of its topic; see :class:`Outgoing` for full ones.

        Args:
            topic: full name and type.
            outlet: number of the publisher.
            number: of its messages through the middleware, this one included if ``both``.
            message: serialized.
            both: whether the middleware carries it too.
        """
        self.sent[outlet] += 1
        hearers = self._to.get(topic, ())
        self.send_to(hearers, outlet, number, self.sent[outlet], message, both)

    def send_to(
        self,
        hearers: Sequence[tuple[Outgoing, int]],
        outlet: int,
        number: int,
        count: int,
        message: bytes,
        both: bool,
    ) -> None:
        """Send a message to some subscribers; see :meth:`send`.

        Args:
            hearers: connections, each with the receiver's number of the topic.
            outlet: number of the publisher.
            number: of its messages through the middleware, this one included if ``both``.
            count: of its messages over the lane, this one included.
            message: serialized.
            both: whether the middleware carries it too.
        """
        gone, turned, sent_ns = [], False, time.time_ns()
        for outgoing, code in hearers:
            frame = HEADER.pack(MESSAGE, both, code, outlet, number, count, sent_ns) + message
            if not outgoing.send(frame):
                gone.append(outgoing)
            elif outgoing.is_full or outgoing.stalled:
                turned |= outgoing.stalls_or_goes_on()
        for outgoing in gone:
            self._drop(outgoing)
        if turned:
            self._sort()

    def plain_hearers(self, topic: str) -> list[tuple[Outgoing, int]]:
        """Return a topic's subscribers, each with its number of the topic.

        Empty if any of them is full, stalled or behind.
        """
        found = self._to.get(topic, [])
        return [] if any(one.is_full or one.stalled or one.is_behind for one, _ in found) else found

    def speaker(self, topic: str, via: int) -> tuple[int, int] | None:
        """Return the file descriptor of a publisher's connection, and the topic's number here.

        None if it is not connected, or if the topic does not have exactly one listener.

        Args:
            topic: full name and type.
            via: the publisher; see :class:`~hapticmech_ros.nodes.sources.Origin`.
        """
        subscription = self._subscriptions.get(topic)
        for number, incoming in self._incoming.items():
            if subscription is not None and incoming.serial == via >> 32:
                alone = len(subscription.listeners) == 1 and not subscription.batch_listeners
                return (number, subscription.code) if alone else None
        return None

    def collect(
        self, timeout_s: float = 0.0, whole: bool = False, longest_s: float = 0.0
    ) -> list[Arrived]:
        """Return received messages, and maintain connections.

        Args:
            timeout_s: longest wait for a first message, s.
            longest_s: longest wait by :attr:`wait`, s, if longer than ``timeout_s``.
            whole: whether to read all messages that have arrived; else one from each process, and
                the rest with later calls, unless this process is behind or records.
        """
        found: list[Arrived] = []
        self.fullest = 0
        if self.turn.is_of_loop:
            self._close_ended()
        wait, longest_s = self.wait, max(timeout_s, longest_s)
        until_ns = time.monotonic_ns() + int(longest_s * NANOSECONDS)
        self.worked = bool(wait and timeout_s and wait.prepare(self, self._waited, until_ns))
        if wait is None or not self.worked:
            ready = self._select(timeout_s)
        else:
            ready = select.select(wait(self), (), (), 0.0)[0]
        if not ready:
            return found
        for number in ready:
            incoming = self._incoming.get(number)
            if incoming is not None:
                self._receive(incoming, found, whole)
            elif (outgoing := self._outgoing.get(number)) is not None:
                self._read_topics(outgoing)
            elif number == self.turn.bell:
                self.turn.hear()
            else:
                self._accept()
        # From several processes, if a kernel left them unread.
        found.sort(key=_arrived_ns)
        for subscription in self._filled:
            # From several publishers.
            subscription.batch.sort(key=_sent_ns)
            found += [
                Arrived(one, subscription.batch, NO_ORIGIN) for one in subscription.batch_listeners
            ]
            subscription.batch = []
        self._filled.clear()
        return found

    def _select(self, timeout_s: float) -> list[int]:
        """Wait up to a time, s, and return the file descriptors that can be read."""
        if not timeout_s:
            return select.select(self._waited, (), (), 0.0)[0]
        with self.turn.given():
            return select.select(self._waited, (), (), timeout_s)[0]

    @property
    def has_news(self) -> bool:
        """Whether :meth:`look` would find something to do; any thread may check."""
        if time.monotonic_ns() - self._looked_ns < LOOK_NS:
            return False
        if any(one.announced != self._version for one in list(self._incoming.values())):
            return True
        if any(one.is_behind for one in list(self._outgoing.values())):
            return True
        with suppress(OSError):
            return self._folder.stat().st_mtime_ns != self._folder_ns
        return False

    def look(self) -> None:
        """Search for new processes, and send what was refused, at most once per LOOK_NS."""
        now = time.monotonic_ns()
        if now - self._looked_ns < LOOK_NS:
            return
        self._looked_ns = now
        for incoming in list(self._incoming.values()):
            self._announce(incoming)
        for outgoing in list(self._outgoing.values()):
            if not outgoing.flush():
                self._drop(outgoing)
        try:
            changed_ns = self._folder.stat().st_mtime_ns
            if changed_ns == self._folder_ns:
                return
            names = {path.name for path in self._folder.iterdir()}
        except OSError:
            return
        # A later change may have the same time stamp: look again.
        settled = abs(time.time_ns() - changed_ns) > LOOK_NS
        self._folder_ns = changed_ns if settled else -1
        self._known &= names
        for name in sorted(names - self._known):
            if name.startswith("."):
                self._clear(name)
            else:
                self._connect(name)

    def _clear(self, name: str) -> None:
        """Remove a hidden socket older than UNREADY_S: its process died before renaming it."""
        path = self._folder / name
        try:
            if time.time() - path.stat().st_ctime > UNREADY_S:
                path.unlink()
            else:
                self._folder_ns = -1
        except OSError:
            # Its process has renamed it, or another has removed it.
            pass

    def _connect(self, name: str) -> None:
        path = self._folder / name
        try:
            connection = connected(path)
        except ConnectionRefusedError:
            remove_socket(path)
            return
        if connection is None:
            # Busy, or just removed: try again later.
            self._folder_ns = -1
            return
        self._known.add(name)
        if self._is_ours(connection):
            self._outgoing[connection.fileno()] = Outgoing(name, connection)
            self._wait_for_all()

    def _accept(self) -> None:
        try:
            connection, _ = self._listening.accept()
        except OSError:
            return
        connection.setblocking(False)
        if self._is_ours(connection):
            incoming = Incoming(connection, self._next_serial)
            self._incoming[connection.fileno()] = incoming
            self._next_serial += 1
            self._wait_for_all()
            self._announce(incoming)

    def _is_ours(self, connection: socket.socket) -> bool:
        ours = is_ours(connection)
        self.refused += not ours
        return ours

    def _announce_anew(self) -> None:
        self._version += 1
        for incoming in list(self._incoming.values()):
            self._announce(incoming)

    def _announce(self, incoming: Incoming) -> None:
        """Send a publishing process the list of topics subscribed to here, unless it has it."""
        if incoming.announced == self._version:
            return
        announced = [
            (
                subscription.topic,
                subscription.code,
                subscription.count,
                bool(subscription.batch_listeners),
            )
            for subscription in self._subscriptions.values()
        ]
        try:
            incoming.announce(announced, self._version)
        except OSError:
            self._close_incoming(incoming)

    def _read_topics(self, outgoing: Outgoing) -> None:
        """Read the other end's subscribed topics."""
        try:
            outgoing.read_topics()
            self._sort()
        except BlockingIOError:
            self._sort()
        except OSError:
            self._drop(outgoing)
        except BrokenRuleError:
            self.refused += 1
            self._drop(outgoing, for_good=True)

    def _sort(self) -> None:
        """Recompute the subscribers of each topic."""
        self._to, self._readers = {}, {}
        # Subscribers that want every message come last: sending to one that is behind takes long.
        for outgoing in sorted(self._outgoing.values(), key=lambda one: one.wants_all):
            for topic, (code, listeners) in outgoing.topics.items():
                self._to.setdefault(topic, []).append((outgoing, code))
                counted = 0 if outgoing.stalled else listeners
                self._readers[topic] = self._readers.get(topic, 0) + counted

    def _receive(self, incoming: Incoming, found: list[Arrived], whole: bool) -> None:
        """Read one message, or all that have arrived by now, but none that arrive meanwhile.

        A listener to the latest message gets one per publisher. Counting the bytes saves a last
        read that finds nothing, which would cost as much as a message.
        """
        newest: dict[tuple[int, int], int] = {}
        base = incoming.serial << 32
        size, frame = HEADER.size, self._frame
        counted = whole or self._records
        left = filled = incoming.bytes_waiting() if counted else 0
        while True:
            try:
                length = incoming.connection.recv_into(frame)
            except BlockingIOError:
                break
            except OSError:
                length = 0
            if not length:
                self._close_incoming(incoming)
                return
            left -= length
            filled += OVERHEAD_BYTES
            if length > size and frame[0] == MESSAGE:
                _, both, code, outlet, number, count, sent_ns = HEADER.unpack_from(frame)
                if left <= 0 and not counted and time.time_ns() - sent_ns > BEHIND_NS:
                    left, counted = incoming.bytes_waiting(), True
                # None: sent before the topic was unsubscribed.
                subscription = self._codes.get(code)
            else:
                self.refused += 1
                subscription = None
            if subscription is not None:
                origin = Origin(base | outlet, number, count, sent_ns)
                message = bytes(frame[size:length])
                if both:
                    self.copied.append((subscription.topic, message))
                for listener in subscription.listeners:
                    key = id(listener), outlet
                    at = newest.setdefault(key, len(found))
                    found[at : at + 1] = (Arrived(listener, message, origin),)
                if subscription.batch_listeners:
                    if not subscription.batch:
                        self._filled.append(subscription)
                    subscription.batch.append((message, origin))
            if left <= 0:
                break
        self.fullest = max(self.fullest, filled)

    def _drop(self, outgoing: Outgoing, for_good: bool = False) -> None:
        """Close the connection to a subscriber; unless ``for_good``, :meth:`look` may reconnect."""
        # A kernel running in another thread would send to a closed file descriptor.
        with self.turn.taken():
            if self._outgoing.pop(outgoing.connection.fileno(), None) is None:
                return
            self._close(outgoing.connection)
            if not for_good:
                self._known.discard(outgoing.name)
                self._folder_ns = -1
            self._wait_for_all()
            self._sort()

    def _close_incoming(self, incoming: Incoming) -> None:
        """Close the connection from a publisher."""
        if self._incoming.pop(incoming.connection.fileno(), None) is None:
            return
        self._close(incoming.connection)
        self._wait_for_all()

    def _close(self, connection: socket.socket) -> None:
        """Have the loop's thread close a connection, since that thread may be waiting for it."""
        self._ended.append(connection)
        if self.turn.is_of_loop:
            self._close_ended()

    def _close_ended(self) -> None:
        while self._ended:
            self._ended.pop().close()

    def _wait_for_all(self) -> None:
        bell, connections = self.turn.bell, (*self._incoming, *self._outgoing)
        self._waited = [self._listening.fileno(), bell, *connections]


def _sent_ns(item: tuple[bytes, Origin]) -> int:
    return item[1].sent_ns


def _arrived_ns(item: Arrived) -> int:
    return item.origin.sent_ns
