# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Connections of the lane: sockets, and what is written into them.

Sockets of the kind AF_UNIX, SOCK_SEQPACKET: messages stay whole and in order, a full one refuses
instead of blocking, and the kernel ends a connection with the process at its other end, whatever
killed it. User ids are those that the kernel tells of the peer.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import socket
import stat
import struct
import sys
import tempfile
import termios
import time
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.times import NANOSECONDS

# What decides whom the middleware finds, besides the network that the process is in.
SETTINGS = (
    *("RMW_IMPLEMENTATION", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_STATIC_PEERS"),
    *("ROS_LOCALHOST_ONLY", "ROS_DISCOVERY_SERVER", "ROS_SUPER_CLIENT"),
    *("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE", "CYCLONEDDS_URI"),
)
DOMAIN = "ROS_DOMAIN_ID"
SECURED = "ROS_SECURITY_ENABLE"


class LaneError(HapticMechError):
    """The lane between processes cannot be had; messages go through the middleware."""


def lane_folder(environment: Mapping[str, str]) -> Path:
    """Return the folder of this environment's graphs, and make it if it is not there.

    It is in ``XDG_RUNTIME_DIR``, or else in the folder for temporary files.

    Raises:
        LaneError: it cannot be made, others could write into it, or permissions of DDS security
            are to be kept, which only the middleware knows.
    """
    if environment.get(SECURED, "").lower() == "true":
        raise LaneError(f"{SECURED} is true: only the middleware keeps to its permissions")
    user = os.geteuid()
    runtime = environment.get("XDG_RUNTIME_DIR", "")
    above = Path(runtime if _is_private(runtime) else tempfile.gettempdir())
    return _private(_private(above / f"hapticmech_ros-{user}") / _name(environment))


def _name(environment: Mapping[str, str]) -> str:
    """Return a name short enough for a socket's path, the same for those who can meet."""
    settings = [f"{name}={environment.get(name, '')}" for name in SETTINGS]
    found = Path("/proc/self/ns/net")
    network = str(found.readlink()) if found.exists() else ""
    told = hashlib.sha256("\n".join([network, *settings]).encode()).hexdigest()
    domain = environment.get(DOMAIN, "").strip() or "0"
    return f"{hashlib.sha256(domain.encode()).hexdigest()[:6]}{told[:10]}"


def _private(folder: Path) -> Path:
    """Make a folder unless it is there, and return it.

    Raises:
        LaneError: it cannot be made, or is not this user's alone.
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
    """Return whether a folder, which is no link, is this user's and nobody else's."""
    try:
        found = os.lstat(folder)
    except OSError:
        return False
    others = stat.S_IMODE(found.st_mode) & 0o077
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid() and not others


# Larger messages go through the middleware.
MOST_BYTES = 1 << 16
# Of all topics that a process hears, as it tells them.
MOST_TOLD = 1 << 17
# What a listener that wants every message may fall behind by, in messages: some ten seconds of a
# node's topics at 1 kHz. A recorder on a busy machine gets little of the processors for as long.
MOST_BEHIND = 30_000
# So many of those are sent at once, so that a sender's own work is not held up.
MOST_AT_ONCE = 16
# Whoever has taken nothing for so long stands still, and the middleware may soon count it no more:
# others may then be the only ones who listen. Longer than a process goes without a processor where
# those of the control rate take nearly all, since then the middleware, which costs more, would take
# the rest; shorter than the leases of participants (10 s with Cyclone DDS, 20 s with Fast DDS).
STALLED_NS = 5 * NANOSECONDS
# How much a connection holds for such a listener, bytes; the system may grant less.
KEPT_BYTES = 1 << 22
# Of sockets that a process waits for with select.
MOST_SOCKETS = 1024
# Kind, whether the middleware carries the message too, topic as numbered by whoever hears it,
# which of the sending process's outlets, number of its last message through the middleware, and
# of this one among those over the lane; when it was sent, ns of the machine's clock.
HEADER = struct.Struct("<BBHIQQq")
MESSAGE, TOPICS = 1, 2
# By which a process that hears numbers its topics.
MOST_CODES = 1 << 16
_VERSION = 3
_BACKLOG = 64
_CREDENTIALS = struct.Struct("3i")
_NO_BYTES = bytes(struct.calcsize("i"))
# Lists of topics that a peer may send at once; the rest waits for the next look at it.
_MOST_LISTS = 16


class BrokenRuleError(Exception):
    """The other end does not keep to this module."""


class Outgoing:
    """A connection to a process that listens.

    Args:
        name: of its socket.
        connection: to it.

    Attributes:
        topics: that it hears: the number by which it knows each, and how many listen there.
        lost: messages that it missed because it was full.
        stalled: whether it has taken nothing for :data:`STALLED_NS`.
    """

    def __init__(self, name: str, connection: socket.socket) -> None:
        self.name = name
        self.connection = connection
        self.topics: dict[str, tuple[int, int]] = {}
        self.lost = 0
        self.stalled = False
        self._behind: deque[bytes] | None = None
        # Since when it refuses messages; 0: it takes them.
        self._full_ns = 0

    def send(self, frame: bytes) -> bool:
        """Send or keep a frame; return whether the connection is still there."""
        behind = self._behind
        if behind:
            self._keep(behind, frame)
            return self.flush()
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
        """Whether it wants every message, and not only the latest ones."""
        return self._behind is not None

    @property
    def is_behind(self) -> bool:
        """Whether anything is kept for it."""
        return bool(self._behind)

    @property
    def is_full(self) -> bool:
        """Whether it refuses messages at present."""
        return self._full_ns > 0

    def stalls_or_goes_on(self) -> bool:
        """Look whether it stalls; return whether that has changed."""
        before, full = self.stalled, self._full_ns
        self.stalled = full > 0 and time.monotonic_ns() - full > STALLED_NS
        return self.stalled != before

    def flush(self) -> bool:
        """Send of what is kept as much as it takes; return whether the connection is there."""
        behind = self._behind
        if not behind:
            return True
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
        """Read what is heard at the other end now; of several lists the last one holds.

        Raises:
            BlockingIOError: all is read. Without it there may be more.
            OSError: the connection is gone.
            BrokenRuleError: what it tells cannot be read.
        """
        for _ in range(_MOST_LISTS):
            frame = self.connection.recv(HEADER.size + MOST_TOLD)
            if not frame:
                raise ConnectionResetError
            try:
                told = json.loads(frame[HEADER.size :])
                if told["version"] != _VERSION:
                    raise BrokenRuleError
                topics = {str(name): (int(code), int(n)) for name, code, n, _ in told["topics"]}
                every = any(bool(all_) for *_, all_ in told["topics"])
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
    """A connection from a process that speaks.

    Args:
        connection: to it.
        serial: number of the connection in this process.

    Attributes:
        told: which version of what is heard here it knows.
    """

    def __init__(self, connection: socket.socket, serial: int) -> None:
        self.connection = connection
        self.serial = serial
        self.told = -1

    def bytes_waiting(self) -> int:
        """Return how many bytes of messages have come and were not received yet."""
        there = fcntl.ioctl(self.connection, termios.FIONREAD, _NO_BYTES)
        return int.from_bytes(there, sys.byteorder)

    def tell(self, topics: Sequence[tuple[str, int, int, bool]], version: int) -> None:
        """Tell it what is heard here, unless it knows: another time if its socket is full.

        Args:
            topics: name and type, number, how many listen, whether any of them wants all messages.
            version: of this list.

        Raises:
            OSError: the connection is gone.
        """
        if self.told == version:
            return
        text = json.dumps({"version": _VERSION, "topics": topics}).encode()
        if len(text) > MOST_TOLD:
            text = json.dumps({"version": _VERSION, "topics": []}).encode()
        try:
            self.connection.send(HEADER.pack(TOPICS, 0, 0, 0, 0, 0, 0) + text)
        except BlockingIOError:
            return
        self.told = version


def listening(folder: Path, name: str) -> socket.socket:
    """Return a socket in a folder that others connect to.

    Raises:
        OSError: it cannot be had, or the folder is not there.
    """
    made = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    unready = folder / f".{name}"
    try:
        made.setblocking(False)
        made.bind(str(unready))
        made.listen(_BACKLOG)
        # Seen only now that it answers: a socket that does not is a dead process's.
        unready.rename(folder / name)
        if made.fileno() >= MOST_SOCKETS:
            raise OSError("too many open files to wait for one more")
    except OSError:
        made.close()
        unready.unlink(missing_ok=True)
        raise
    return made


def connected(path: Path) -> socket.socket | None:
    """Return a connection to whoever listens there; None: another time.

    Raises:
        ConnectionRefusedError: nobody is there any more.
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
    """Remove a socket that nobody answers at; anything else stays."""
    try:
        if stat.S_ISSOCK(path.lstat().st_mode):
            path.unlink()
    except OSError:
        # It is not there any more, or not to be removed.
        pass


def is_ours(connection: socket.socket) -> bool:
    """Return whether this user has the other end, and close a connection that is not kept."""
    told = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    _, user, _ = _CREDENTIALS.unpack(told)
    if user == os.geteuid() and connection.fileno() < MOST_SOCKETS:
        return True
    connection.close()
    return False
