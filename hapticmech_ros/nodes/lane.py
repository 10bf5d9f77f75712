# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A lane between processes of one host and one user, for messages of the control rate.

A subscriber has a socket in a folder of this user's own; a publisher connects to it, gets the list
of topics that are subscribed to there, and sends those: :mod:`.lane_connections`.
"""

from __future__ import annotations

import os
import secrets
import select
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, Protocol

from hapticmech_ros.nodes.lane_connections import (
    HEADER,
    MESSAGE,
    MOST_BYTES,
    MOST_CODES,
    BrokenRuleError,
    Incoming,
    LaneError,
    Outgoing,
    connected,
    is_ours,
    lane_folder,
    listening,
    remove_socket,
)
from hapticmech_ros.nodes.sources import INSIDE, Batch, BatchListener, Listener, Origin
from hapticmech_ros.times import NANOSECONDS

# Looks for new processes, and at what could not be sent, come so often.
LOOK_NS = NANOSECONDS // 10
# A socket is made ready in less than this, s.
UNREADY_S = 10.0
# Whoever has found messages for so long without waiting for them is behind: of what has piled up,
# it gets the newest. It has waited where it took longer than this to find them.
BEHIND_NS, WAITED_NS = 3_000_000, 20_000


class Arrived(NamedTuple):
    """What has come, its origin, and the listener it is for: a message, or a batch of them."""

    listener: Callable[..., None]
    message: bytes | Batch
    origin: Origin


@dataclass(slots=True)
class _Subscription:
    """A topic that is subscribed to here."""

    topic: str
    code: int
    listeners: list[Listener] = field(default_factory=list)
    batch_listeners: list[Callable[[Batch, Origin], None]] = field(default_factory=list)
    batch: Batch = field(default_factory=list)

    @property
    def count(self) -> int:
        """How many listeners it has."""
        return len(self.listeners) + len(self.batch_listeners)


class Waits(Protocol):
    """Waits for connections in place of ``select``, and does meanwhile what it can."""

    def prepare(self, lane: Lane, waited: list[int], until_ns: int) -> bool:
        """Return whether it can wait now; see ``PlainMessages``."""

    def __call__(self, lane: Lane, waited: list[int]) -> tuple[list[int], int]:
        """Return which have something to read, and when it had to wait; see there."""


class Lane:
    """This process's part in the lane.

    Args:
        folder: where processes meet; this user's alone.

    Attributes:
        refused: connections of other users, and messages that broke the rules.
        copied: topic and message of all that came and the middleware brings too; for whoever
            collects to take.
        wait: waits in place of ``select``, and does something meanwhile; see :class:`Waits`.
        worked: whether it waited the last time.

    Raises:
        LaneError: there can be no sockets.
    """

    def __init__(self, folder: Path) -> None:
        self.refused = 0
        self.copied: list[tuple[str, bytes]] = []
        self.wait: Waits | None = None
        self.worked = False
        self._folder = folder
        self._name = f"{os.getpid()}-{secrets.token_hex(4)}"
        self._subscriptions: dict[str, _Subscription] = {}
        self._codes: dict[int, _Subscription] = {}
        self._filled: list[_Subscription] = []
        self._records = False
        self._next_code = self._next_serial = 1
        # Raised with every change of the subscriptions.
        self._version = 0
        self._outgoing: dict[int, Outgoing] = {}
        self._incoming: dict[int, Incoming] = {}
        self._to: dict[str, list[tuple[Outgoing, int]]] = {}
        self._readers: dict[str, int] = {}
        # Messages of each outlet.
        self._sent: dict[int, int] = {}
        self._known: set[str] = {self._name}
        self._folder_ns = self._looked_ns = self._idle_ns = -1
        self._listening = listening(folder, self._name)
        self._waited = [self._listening.fileno()]
        self._frame = memoryview(bytearray(HEADER.size + MOST_BYTES))

    @classmethod
    def open(cls, environment: Mapping[str, str]) -> Lane:
        """Return the lane of this environment's graphs.

        Raises:
            LaneError: it cannot be had here.
        """
        if not hasattr(socket, "SOCK_SEQPACKET") or not hasattr(socket, "SO_PEERCRED"):
            raise LaneError("this system has no sequenced-packet sockets that know their peers")
        for _ in range(10):
            try:
                return cls(lane_folder(environment))
            except FileNotFoundError:
                # The last process there has just ended, and took the folder with it.
                continue
            except OSError as error:
                raise LaneError(f"no socket for the lane: {error}") from None
        raise LaneError("no socket for the lane: its folder was removed again and again")

    def close(self) -> None:
        """Leave: nothing of this process stays behind."""
        for outgoing in list(self._outgoing.values()):
            self._drop(outgoing)
        for incoming in list(self._incoming.values()):
            self._close_incoming(incoming)
        self._listening.close()
        with suppress(OSError):  # others may still be there
            (self._folder / self._name).unlink()
            self._folder.rmdir()

    @property
    def linked(self) -> bool:
        """Whether another process is, or may be, speaking to this one."""
        return bool(self._incoming)

    @property
    def lost(self) -> int:
        """Messages that a full connection has not taken."""
        return sum(outgoing.lost for outgoing in self._outgoing.values())

    def listen(self, topic: str, listener: Listener) -> None:
        """Hear the latest message of each publisher of a topic.

        Args:
            topic: full name and type.
            listener: called with a message, serialized, and its origin.
        """
        self._subscription(topic).listeners.append(listener)
        self._tell_anew()

    def listen_to_all(self, topic: str, listener: BatchListener) -> None:
        """Hear all messages of a topic; those that have come together are handed over together.

        Args:
            topic: full name and type.
            listener: called with messages, serialized, each with its origin.
        """
        self._subscription(topic).batch_listeners.append(lambda batch, _: listener(batch))
        self._records = True
        self._tell_anew()

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
        """Hear the latest messages of a topic no more."""
        subscription = self._subscriptions[topic]
        subscription.listeners.remove(listener)
        if not subscription.count:
            del self._subscriptions[topic], self._codes[subscription.code]
        self._tell_anew()

    def readers(self, topic: str) -> int:
        """Return how many listeners of other processes a message reaches that take any."""
        return self._readers.get(topic, 0)

    def send(self, topic: str, outlet: int, number: int, message: bytes, both: bool) -> None:
        """Send a message to all who hear its topic; whoever's connection is full misses it.

        Args:
            topic: full name and type.
            outlet: which publisher of this process.
            number: of its messages through the middleware, this one included if ``both``.
            message: serialized.
            both: whether the middleware carries it too.
        """
        self._sent[outlet] = count = self._sent.get(outlet, 0) + 1
        self.send_to(self._to.get(topic, ()), outlet, number, count, message, both)

    def send_to(
        self,
        hearers: Sequence[tuple[Outgoing, int]],
        outlet: int,
        number: int,
        count: int,
        message: bytes,
        both: bool,
    ) -> None:
        """Send a message to some; arguments as of :meth:`send`.

        Args:
            hearers: connections, each with its number of the topic.
            outlet: which publisher of this process.
            number: of its messages through the middleware.
            count: of its messages over the lane.
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

    def sent(self, outlet: int) -> int:
        """Return how many messages of a publisher of this process were sent here."""
        return self._sent.get(outlet, 0)

    def note_sent(self, outlet: int, count: int) -> None:
        """Note that somebody else has sent messages of a publisher, and how many there are now."""
        self._sent[outlet] = count

    def plain_hearers(self, topic: str) -> list[tuple[Outgoing, int]]:
        """Return who hears a topic, with its number there, if all take what they are sent."""
        found = self._to.get(topic, [])
        return [] if any(one.is_full or one.stalled or one.is_behind for one, _ in found) else found

    def speaker(self, topic: str, via: int) -> tuple[int, int] | None:
        """Return the connection by which a publisher's messages come, and their topic's number.

        Args:
            topic: full name and type.
            via: the publisher, see :class:`~hapticmech_ros.nodes.sources.Origin`.
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
        """Return what has come, and look after connections.

        Args:
            timeout_s: how long to wait for anything to come.
            longest_s: how long :attr:`wait` may, if that is longer.
            whole: whether all that has come by now is wanted; else a message of each process, and
                the rest comes with the next call, unless this process is behind.
        """
        found: list[Arrived] = []
        asked = time.monotonic_ns()
        wait, until_ns = self.wait, asked + int(max(timeout_s, longest_s) * NANOSECONDS)
        if wait and timeout_s and wait.prepare(self, self._waited, until_ns):
            self.worked = True
            ready, idle_ns = wait(self, self._waited)
            now = time.monotonic_ns()
        else:
            self.worked = False
            ready, _, _ = select.select(self._waited, (), (), timeout_s)
            now = time.monotonic_ns()
            idle_ns = now if not ready or now - asked > WAITED_NS else 0
        whole |= now - self._idle_ns > BEHIND_NS
        self._idle_ns = max(self._idle_ns, idle_ns)
        if not ready:
            return found
        for number in ready:
            incoming = self._incoming.get(number)
            if incoming is not None:
                self._receive(incoming, found, whole)
            elif (outgoing := self._outgoing.get(number)) is not None:
                self._read_topics(outgoing)
            else:
                self._accept()
        for subscription in self._filled:
            # Of several publishers.
            subscription.batch.sort(key=_sent_ns)
            found += [
                Arrived(one, subscription.batch, INSIDE) for one in subscription.batch_listeners
            ]
            subscription.batch = []
        self._filled.clear()
        return found

    def look(self) -> None:
        """Look for processes that have come, and repeat what could not be sent; now and then."""
        now = time.monotonic_ns()
        if now - self._looked_ns < LOOK_NS:
            return
        self._looked_ns = now
        for incoming in list(self._incoming.values()):
            self._tell(incoming)
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
        # Another change may have the same time.
        settled = abs(time.time_ns() - changed_ns) > LOOK_NS
        self._folder_ns = changed_ns if settled else -1
        self._known &= names
        for name in sorted(names - self._known):
            if name.startswith("."):
                self._clear(name)
            else:
                self._connect(name)

    def _clear(self, name: str) -> None:
        """Remove a socket whose process was killed before others could see it."""
        path = self._folder / name
        try:
            if time.time() - path.stat().st_ctime > UNREADY_S:
                path.unlink()
            else:
                self._folder_ns = -1
        except OSError:
            # It is ready now, or another has removed it.
            pass

    def _connect(self, name: str) -> None:
        path = self._folder / name
        try:
            connection = connected(path)
        except ConnectionRefusedError:
            remove_socket(path)
            return
        if connection is None:
            # Busy, or just gone: another time.
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
            self._tell(incoming)

    def _is_ours(self, connection: socket.socket) -> bool:
        ours = is_ours(connection)
        self.refused += not ours
        return ours

    def _tell_anew(self) -> None:
        self._version += 1
        for incoming in list(self._incoming.values()):
            self._tell(incoming)

    def _tell(self, incoming: Incoming) -> None:
        """Tell a process that speaks which topics are subscribed to here."""
        told = [
            (
                subscription.topic,
                subscription.code,
                subscription.count,
                bool(subscription.batch_listeners),
            )
            for subscription in self._subscriptions.values()
        ]
        try:
            incoming.tell(told, self._version)
        except OSError:
            self._close_incoming(incoming)

    def _read_topics(self, outgoing: Outgoing) -> None:
        """Read what is subscribed to at the other end."""
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
        """Find anew who hears what."""
        self._to, self._readers = {}, {}
        # Last, who wants every message: if it is behind, sending to it takes long.
        for outgoing in sorted(self._outgoing.values(), key=lambda one: one.wants_all):
            for topic, (code, listeners) in outgoing.topics.items():
                self._to.setdefault(topic, []).append((outgoing, code))
                counted = 0 if outgoing.stalled else listeners
                self._readers[topic] = self._readers.get(topic, 0) + counted

    def _receive(self, incoming: Incoming, found: list[Arrived], whole: bool) -> None:
        """Take a message, or all that have come by now: others may come as fast as they are taken.

        Of those of which not every one is wanted the latest is found. To ask for one more and be
        told that there is none costs as much as a message.
        """
        newest: dict[tuple[int, int], int] = {}
        base = incoming.serial << 32
        size, frame = HEADER.size, self._frame
        left = incoming.bytes_waiting() if whole or self._records else 0
        while True:
            try:
                length = incoming.connection.recv_into(frame)
            except BlockingIOError:
                return
            except OSError:
                length = 0
            if not length:
                self._close_incoming(incoming)
                return
            left -= length
            if length > size and frame[0] == MESSAGE:
                _, both, code, outlet, number, count, sent_ns = HEADER.unpack_from(frame)
                # None: of before it was silenced.
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
                return

    def _drop(self, outgoing: Outgoing, for_good: bool = False) -> None:
        """Speak to a process no more, unless it is found again."""
        if self._outgoing.pop(outgoing.connection.fileno(), None) is None:
            return
        outgoing.connection.close()
        if not for_good:
            self._known.discard(outgoing.name)
            self._folder_ns = -1
        self._wait_for_all()
        self._sort()

    def _close_incoming(self, incoming: Incoming) -> None:
        """Listen to a process no more."""
        if self._incoming.pop(incoming.connection.fileno(), None) is None:
            return
        incoming.connection.close()
        self._wait_for_all()

    def _wait_for_all(self) -> None:
        self._waited = [self._listening.fileno(), *self._incoming, *self._outgoing]


def _sent_ns(item: tuple[bytes, Origin]) -> int:
    return item[1].sent_ns
