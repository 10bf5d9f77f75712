# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Carriers of messages between two processes of one host: each has two ends, one for each process.

An end is made in its process, after the fork: what a library keeps for a process is not shared.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import platform
import select
import socket
import struct
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

# Longest message, bytes, and longest wait for one, s.
MOST_BYTES, PATIENCE_S = 1 << 16, 2.0
_FUTEX = {"x86_64": 202, "aarch64": 98}
_FUTEX_WAIT, _FUTEX_WAKE = 0, 1
_WORD = struct.Struct("I")


class End(Protocol):
    """One process's end of a carrier."""

    def send(self, message: bytes) -> None:
        """Send a message to the other end."""

    def receive(self) -> bytes:
        """Return the next message; empty if none comes in :data:`PATIENCE_S`."""


class Carrier(Protocol):
    """Joins two processes; made before the fork."""

    def end(self, first: bool) -> End:
        """Return the end of the first process, or of the second."""


class Sockets:
    """Two sockets, which wait in ``select`` as the nodes do."""

    def __init__(self, pair: tuple[socket.socket, socket.socket]) -> None:
        self._pair = pair

    def end(self, first: bool) -> End:
        """Return the end of the first process, or of the second."""
        own, other = self._pair if first else self._pair[::-1]
        other.close()
        own.setblocking(False)
        return SocketEnd(own)


class SocketEnd:
    """A connected socket."""

    def __init__(self, own: socket.socket) -> None:
        self._own = own

    def send(self, message: bytes) -> None:
        """Send a message to the other end."""
        self._own.send(message)

    def receive(self) -> bytes:
        """Return the next message; empty if none comes in :data:`PATIENCE_S`, or none any more."""
        ready, _, _ = select.select((self._own,), (), (), PATIENCE_S)
        return self._own.recv(MOST_BYTES) if ready else b""


def unix_socket(kind: socket.SocketKind) -> Callable[[], Carrier]:
    """Return what makes a carrier of connected Unix sockets of a kind."""
    return lambda: Sockets(socket.socketpair(socket.AF_UNIX, kind))


def udp() -> Carrier:
    """Return a carrier of UDP sockets on the loopback interface."""
    pair = tuple(socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    for one in pair:
        one.bind(("127.0.0.1", 0))
    pair[0].connect(pair[1].getsockname())
    pair[1].connect(pair[0].getsockname())
    return Sockets((pair[0], pair[1]))


class SharedMemory:
    """A slot of shared memory in each direction: a count, a length, and the latest message.

    Args:
        waits: how an end learns that a count has changed.
    """

    def __init__(self, waits: Callable[[], tuple[Signal, Signal]]) -> None:
        self._slots = tuple(mmap.mmap(-1, 2 * _WORD.size + MOST_BYTES) for _ in range(2))
        self._signals = tuple(waits() for _ in range(2))

    def end(self, first: bool) -> End:
        """Return the end of the first process, or of the second."""
        out = 0 if first else 1
        return SlotEnd(
            self._slots[out], self._slots[1 - out], self._signals[out][0], self._signals[1 - out][1]
        )


class Signal(Protocol):
    """One side of what wakes up a process."""

    def give(self, slot: mmap.mmap) -> None:
        """Wake up whoever waits for a slot."""

    def wait(self, slot: mmap.mmap, seen: int) -> bool:
        """Wait until a slot's count is another than the one that was seen; return whether it is."""


class SlotEnd:
    """An end that writes one slot and reads the other."""

    def __init__(self, out: mmap.mmap, into: mmap.mmap, tells: Signal, receives: Signal) -> None:
        self._out, self._into, self._tells, self._receives = out, into, tells, receives
        self._sent = self._seen = 0

    def send(self, message: bytes) -> None:
        """Send a message to the other end."""
        self._out[2 * _WORD.size : 2 * _WORD.size + len(message)] = message
        self._sent += 1
        # The count last: whoever sees it may read.
        _WORD.pack_into(self._out, _WORD.size, len(message))
        _WORD.pack_into(self._out, 0, self._sent)
        self._tells.give(self._out)

    def receive(self) -> bytes:
        """Return the next message; empty if none comes in :data:`PATIENCE_S`."""
        if not self._receives.wait(self._into, self._seen):
            return b""
        (self._seen,) = _WORD.unpack_from(self._into, 0)
        (length,) = _WORD.unpack_from(self._into, _WORD.size)
        return self._into[2 * _WORD.size : 2 * _WORD.size + length]


class Futex:
    """The system's wait for a word of memory."""

    def __init__(self) -> None:
        self._call = ctypes.CDLL(None, use_errno=True).syscall
        self._number = _FUTEX[platform.machine()]

    def give(self, slot: mmap.mmap) -> None:
        """Wake up whoever waits for a slot."""
        self._call(self._number, _address(slot), _FUTEX_WAKE, 1, None, None, 0)

    def wait(self, slot: mmap.mmap, seen: int) -> bool:
        """Wait until a slot's count is another than the one that was seen; return whether it is."""
        deadline = time.monotonic() + PATIENCE_S
        # It may end before anything has changed, by a signal for example.
        while _WORD.unpack_from(slot, 0)[0] == seen:
            left = deadline - time.monotonic()
            if left <= 0.0:
                return False
            timeout = struct.pack("qq", int(left), int(left % 1.0 * 1e9))
            self._call(self._number, _address(slot), _FUTEX_WAIT, seen, timeout, None, 0)
        return True


class EventDescriptor:
    """An eventfd, which ``select`` can wait for beside other things."""

    def __init__(self) -> None:
        self._number = os.eventfd(0, os.EFD_NONBLOCK)

    def give(self, slot: mmap.mmap) -> None:
        """Wake up whoever waits for a slot."""
        del slot
        os.eventfd_write(self._number, 1)

    def wait(self, slot: mmap.mmap, seen: int) -> bool:
        """Wait until a slot's count is another than the one that was seen; return whether it is."""
        del slot, seen
        ready, _, _ = select.select((self._number,), (), (), PATIENCE_S)
        if ready:
            os.eventfd_read(self._number)
        return bool(ready)


def _address(slot: mmap.mmap) -> ctypes.c_void_p:
    return ctypes.c_void_p(ctypes.addressof(ctypes.c_char.from_buffer(slot)))


def futexes() -> Carrier:
    """Return a carrier of shared memory and futexes."""
    return SharedMemory(lambda: (Futex(), Futex()))


def event_descriptors() -> Carrier:
    """Return a carrier of shared memory and eventfds, which both processes inherit."""

    def pair() -> tuple[Signal, Signal]:
        one = EventDescriptor()
        return one, one

    return SharedMemory(pair)


class Iceoryx:
    """Services of iceoryx2: a sample of bytes in shared memory, and an event that says so."""

    def __init__(self) -> None:
        # As a command of its own would find it: nothing is made before the fork.
        with tempfile.NamedTemporaryFile(prefix="carriers_") as unique:
            self._name = Path(unique.name).name

    def end(self, first: bool) -> End:
        """Return the end of the first process, or of the second."""
        return IceoryxEnd(self._name, first)


class IceoryxEnd:
    """A publisher and a notifier, a subscriber and a listener."""

    def __init__(self, name: str, first: bool) -> None:
        import iceoryx2 as iox

        iox.set_log_level(iox.LogLevel.Error)
        self._node = iox.NodeBuilder.new().create(iox.ServiceType.Ipc)
        names = [f"{name}/{way}" for way in (("there", "back") if first else ("back", "there"))]
        self._services = [self._service(iox, one) for one in names]
        (out, told), (into, received) = self._services
        self._publisher = out.publisher_builder().initial_max_slice_len(MOST_BYTES).create()
        self._notifier = told.notifier_builder().create()
        self._subscriber = into.subscriber_builder().create()
        self._listener = received.listener_builder().create()
        self._patience = iox.Duration.from_millis(round(1e3 * PATIENCE_S))

    def _service(self, iox: Any, name: str) -> tuple[Any, Any]:
        def builder() -> Any:
            return self._node.service_builder(iox.ServiceName.new(name))

        data = builder().publish_subscribe(iox.Slice[ctypes.c_uint8]).open_or_create()
        return data, builder().event().open_or_create()

    def send(self, message: bytes) -> None:
        """Send a message to the other end."""
        sample = self._publisher.loan_slice_uninit(len(message))
        ctypes.memmove(sample.payload_ptr, message, len(message))
        sample.assume_init().send()
        self._notifier.notify()

    def receive(self) -> bytes:
        """Return the next message; empty if none comes in :data:`PATIENCE_S`."""
        while True:
            sample = self._subscriber.receive()
            if sample is not None:
                message = bytes(sample.payload().as_memory_view())
                sample.delete()
                return message
            if not self._listener.timed_wait(self._patience):
                return b""


CARRIERS: dict[str, Callable[[], Carrier]] = {
    "Unix socket, SEQPACKET": unix_socket(socket.SOCK_SEQPACKET),
    "Unix socket, DGRAM": unix_socket(socket.SOCK_DGRAM),
    "UDP, loopback": udp,
    "shared memory, futex": futexes,
    "shared memory, eventfd": event_descriptors,
    "iceoryx2": Iceoryx,
}
