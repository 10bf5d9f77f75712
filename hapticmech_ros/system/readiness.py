# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Processes notify their parent that they are up, and of their state: sd_notify(3), as services do.

A node's state is its ``STATUS``, which ``systemctl status`` shows, and, with figures, an ``X_``
variable of this package, which systemd ignores.
"""

from __future__ import annotations

import json
import os
import socket
import struct
import threading
from collections.abc import Mapping
from dataclasses import asdict, dataclass

ADDRESS = "NOTIFY_SOCKET"
READY = b"READY=1"
# Set for nodes whose parent shows their last report: they do not print it.
SHOWN = "HAPTICMECH_ROS_REPORTS_SHOWN"
_REPORT = b"X_HAPTICMECH_REPORT="
# s, for which a process waits while the socket is full, after ten messages.
_PATIENCE_S = 0.5
_LARGEST = 1 << 16
# Most messages read at once: more may come as fast as they are read.
_AT_ONCE = 256
_CREDENTIALS = struct.Struct("3i")


@dataclass(frozen=True, slots=True)
class Report:
    """A node's state.

    Attributes:
        node: its full name.
        well: whether it works.
        sentence: on its state.
        figures: of diagnostics.
        last: whether it ends now.
    """

    node: str
    well: bool
    sentence: str
    figures: dict[str, str]
    last: bool = False


def report_ready(environment: Mapping[str, str] = os.environ) -> None:
    """Notify the parent, if it listens, that this process is up.

    While the socket is full, a thread of its own waits: a parent that reads seldom would delay a
    node's start.

    Args:
        environment: in which ``NOTIFY_SOCKET`` is the address of a Unix datagram socket, of the
            abstract ones with ``@`` in place of the zero byte.
    """
    if not _send(READY, environment, 0.0):
        threading.Thread(target=_send, args=(READY, environment, _PATIENCE_S)).start()


def send_report(report: Report, environment: Mapping[str, str] = os.environ) -> None:
    """Send a node's state to the parent, if it listens, without waiting.

    Args:
        report: of the node.
        environment: as of :func:`report_ready`.
    """
    status = f"STATUS={report.node}: {report.sentence}".encode()
    content = json.dumps(asdict(report), ensure_ascii=False).encode()
    _send(status + b"\n" + _REPORT + content, environment, 0.0)


def _send(text: bytes, environment: Mapping[str, str], patience_s: float) -> bool:
    """Send a message; return whether another try is of no use."""
    address = environment.get(ADDRESS, "")
    if address[:1] not in ("/", "@"):
        return True
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sender:
        sender.settimeout(patience_s)
        try:
            sender.connect("\0" + address[1:] if address[0] == "@" else address)
            sender.send(text)
        except BlockingIOError:
            return False
        except OSError:
            # The parent has ended, or does not listen.
            pass
        return True


class Readiness:
    """Receives which processes are up, and the states of their nodes.

    Attributes:
        address: for ``NOTIFY_SOCKET`` of these processes.
        reports: the last one of each node, by its name.
        endings: the last one of each node that reported its end.
    """

    def __init__(self) -> None:
        kind = socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK
        self._socket = socket.socket(socket.AF_UNIX, kind)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        # The system chooses an abstract address, which needs no file.
        self._socket.bind("")
        self.address = "@" + self._socket.getsockname()[1:].decode()
        self._ready: set[int] = set()
        self.reports: dict[str, Report] = {}
        self.endings: dict[str, Report] = {}

    def pids(self) -> frozenset[int]:
        """Return the processes that are up, by the senders' credentials from the system."""
        for _ in range(_AT_ONCE):
            try:
                text, ancillary, _, _ = self._socket.recvmsg(
                    _LARGEST, socket.CMSG_SPACE(_CREDENTIALS.size)
                )
            except BlockingIOError:
                break
            for line in text.split(b"\n"):
                if line == READY:
                    for level, kind, data in ancillary:
                        if (level, kind) == (socket.SOL_SOCKET, socket.SCM_CREDENTIALS):
                            self._ready.add(_CREDENTIALS.unpack(data[: _CREDENTIALS.size])[0])
                elif line.startswith(_REPORT):
                    self._take(line.removeprefix(_REPORT))
        return frozenset(self._ready)

    def _take(self, content: bytes) -> None:
        try:
            report = Report(**json.loads(content))
        except (TypeError, ValueError):
            return  # not from a process of this package
        known = self.endings if report.last else self.reports
        known[report.node] = report

    @property
    def is_open(self) -> bool:
        """Whether it receives."""
        return self._socket.fileno() >= 0

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
