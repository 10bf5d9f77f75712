"""Processes tell who started them that they are up, as services tell systemd: sd_notify(3)."""

from __future__ import annotations

import os
import socket
import struct
from collections.abc import Mapping

ADDRESS = "NOTIFY_SOCKET"
READY = b"READY=1"
# s, for which a process waits where others have just said so too: ten messages fill a socket.
_PATIENCE_S = 0.5
_LARGEST = 4096
_CREDENTIALS = struct.Struct("3i")


def say_ready(environment: Mapping[str, str] = os.environ) -> None:
    """Say that this process is up to whoever wants to know, if anybody does and listens.

    Args:
        environment: in which ``NOTIFY_SOCKET`` is the address of a Unix datagram socket, of the
            abstract ones with ``@`` in place of the zero byte.
    """
    address = environment.get(ADDRESS, "")
    if address[:1] not in ("/", "@"):
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sender:
        sender.settimeout(_PATIENCE_S)
        try:
            sender.connect("\0" + address[1:] if address[0] == "@" else address)
            sender.send(READY)
        except OSError:
            # Whoever wanted to know has gone, or does not listen.
            return


class Readiness:
    """Hears which processes are up.

    Attributes:
        address: for ``NOTIFY_SOCKET`` of these processes.
    """

    def __init__(self) -> None:
        kind = socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK
        self._socket = socket.socket(socket.AF_UNIX, kind)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        # The system chooses an abstract address, which needs no file.
        self._socket.bind("")
        self.address = "@" + self._socket.getsockname()[1:].decode()
        self._ready: set[int] = set()

    def pids(self) -> frozenset[int]:
        """Return the processes that have said so, by what the system says of the sender."""
        while True:
            try:
                text, ancillary, _, _ = self._socket.recvmsg(
                    _LARGEST, socket.CMSG_SPACE(_CREDENTIALS.size)
                )
            except BlockingIOError:
                return frozenset(self._ready)
            if READY in text.splitlines():
                for level, kind, data in ancillary:
                    if (level, kind) == (socket.SOL_SOCKET, socket.SCM_CREDENTIALS):
                        self._ready.add(_CREDENTIALS.unpack(data[: _CREDENTIALS.size])[0])

    def close(self) -> None:
        """Hear no more."""
        self._socket.close()
