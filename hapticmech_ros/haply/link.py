# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A WebSocket to a service that answers each message once, without a thread and without waiting.

The protocol is websockets' own, without its input and output; the socket is looked at when the
caller has time. Of messages one at most is unanswered: a service that stands still must not find a
queue of old forces when it goes on.
"""

from __future__ import annotations

import os
import select
import socket
import time
from typing import Any
from urllib.parse import urlsplit

from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.haply.messages import LONGEST_FRAME
from hapticmech_ros.installation import refuse_unmet

# The extra ``haply`` in setup.py says the same.
WEBSOCKETS = "websockets>=13"
# s between attempts to connect, and for one of them.
RETRY_S, CONNECT_S = 0.5, 2.0
_CHUNK = 1 << 16


class LinkError(HapticMechError):
    """A connection that cannot be made, or has ended."""


class Link:
    """One connection at a time, made again when it is lost.

    Args:
        uri: of the service, ``ws://HOST:PORT``.

    Raises:
        InstallationError: websockets is not installed.
        InvalidInputError: no such address.

    Attributes:
        problem: why there is no connection; empty if there is one.
        unanswered: whether a message waits for its answer.
        connections: how many have been made.
    """

    def __init__(self, uri: str) -> None:
        refuse_unmet([WEBSOCKETS])
        self._uri = uri
        self._place = _place(uri)
        self._socket: socket.socket | None = None
        self._protocol = _protocol(uri)
        self._frames: list[str] = []
        self._parts = bytearray()
        self._opened, self._greeted = False, False
        self._again = self._until = 0.0
        self.problem = "not connected yet"
        self.unanswered = False
        self.connections = 0

    @property
    def is_open(self) -> bool:
        """Whether messages can be sent."""
        return self._opened

    def look(self) -> None:
        """Take what has come, and go on connecting if there is no connection; does not wait."""
        try:
            if self._socket is None:
                self._begin()
            else:
                self._go_on(0.0)
        except (OSError, LinkError) as error:
            self._end(str(error))

    def send(self, text: str) -> bool:
        """Send a message, if the last one has been answered; return whether it was sent."""
        if not self._opened or self.unanswered:
            return False
        self._protocol.send_text(text.encode())
        self.unanswered = True
        try:
            self._flush()
        except (OSError, LinkError) as error:
            self._end(str(error))
            return False
        return True

    def answers(self, wait: float) -> list[str]:
        """Return the frames that have come, the newest last.

        Args:
            wait: s, for the answer to the last message, or for a first frame if there was none.
        """
        end = time.monotonic() + wait
        while self._socket is not None and (self.unanswered or not self._frames):
            left = end - time.monotonic()
            try:
                self._go_on(max(left, 0.0))
            except (OSError, LinkError) as error:
                self._end(str(error))
            if left <= 0.0:
                break
        found = list(self._frames)
        self._frames.clear()
        return found

    def close(self, reason: str = "closed") -> None:
        """End the connection now; the next is not tried before a while."""
        self._end(reason)

    def _begin(self) -> None:
        """Try to connect, now and then."""
        now = time.monotonic()
        if now < self._again:
            return
        self._again, self._until = now + RETRY_S, now + CONNECT_S
        host, port = self._place
        known = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        family, kind, number, _, address = known[0]
        found = socket.socket(family, kind, number)
        found.setblocking(False)
        found.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket, self._greeted = found, False
        self._protocol = _protocol(self._uri)
        self._frames.clear()
        self._parts.clear()
        found.connect_ex(address)

    def _go_on(self, wait: float) -> None:
        """Take what has come within ``wait`` s.

        Raises:
            LinkError: the connection has ended.
        """
        if self._socket is None:
            return
        if not self._greeted:
            self._greet()
            return
        readable, _, _ = select.select([self._socket], [], [], wait)
        if not readable:
            if not self._opened and time.monotonic() > self._until:
                raise LinkError("it does not answer")
            return
        data = self._socket.recv(_CHUNK)
        if data:
            self._protocol.receive_data(data)
        else:
            self._protocol.receive_eof()
        self._take()
        self._flush()
        if not data:
            raise LinkError("it has ended the connection")

    def _greet(self) -> None:
        """Ask for a WebSocket once the connection is there."""
        if self._socket is None:
            return
        _, writable, _ = select.select([], [self._socket], [], 0.0)
        if not writable:
            if time.monotonic() > self._until:
                raise LinkError("it cannot be reached")
            return
        code = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if code:
            raise OSError(code, os.strerror(code))
        self._protocol.send_request(self._protocol.connect())
        self._greeted = True
        self._flush()

    def _take(self) -> None:
        """Take what the protocol makes of what has come."""
        from websockets.frames import Frame, Opcode

        for event in self._protocol.events_received():
            if not isinstance(event, Frame):
                if self._protocol.handshake_exc is not None:
                    raise LinkError(f"no such service: {self._protocol.handshake_exc}")
                self._opened, self.unanswered, self.problem = True, False, ""
                self.connections += 1
            elif event.opcode in (Opcode.TEXT, Opcode.BINARY, Opcode.CONT):
                self._parts += event.data
                if len(self._parts) > LONGEST_FRAME:
                    raise LinkError(f"a message of more than {LONGEST_FRAME} bytes")
                if event.fin:
                    # What is no UTF-8 is no JSON either, and refused as that.
                    self._frames.append(self._parts.decode(errors="replace"))
                    self._parts.clear()
                    self.unanswered = False

    def _flush(self) -> None:
        """Send what the protocol has to send.

        Raises:
            LinkError: it was not taken whole.
        """
        for data in self._protocol.data_to_send():
            if self._socket is None:
                return
            if not data:
                self._socket.shutdown(socket.SHUT_WR)
            elif self._socket.send(data) < len(data):
                raise LinkError("it takes no more messages")

    def _end(self, reason: str) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket, self._opened, self.unanswered = None, False, False
        self.problem = f"{self._uri}: {reason}"
        self._again = max(self._again, time.monotonic() + RETRY_S)


def _place(uri: str) -> tuple[str, int]:
    parts = urlsplit(uri)
    rule = "must be ws://HOST:PORT"
    try:
        host, port = parts.hostname, parts.port
    except ValueError:
        raise InvalidInputError("uri", uri, rule) from None
    if parts.scheme != "ws" or not host or port is None:
        raise InvalidInputError("uri", uri, rule)
    return host, port


def _protocol(uri: str) -> Any:
    # Here, as it takes 30 ms, and only this driver needs it.
    from websockets.client import ClientProtocol
    from websockets.uri import parse_uri

    return ClientProtocol(parse_uri(uri), max_size=LONGEST_FRAME)
