# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The process in the middle of an emulated network: holds, drops and reorders IP packets.

    python -m benchmarks.reliability.forwarder DEVICE_END REST_END

Both are network interfaces of the namespace that it runs in. It reads settings, one JSON object a
line, from standard input, and answers each with what it has counted so far; it ends with its input.
"""

from __future__ import annotations

import ctypes
import gc
import heapq
import json
import os
import random
import select
import socket
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field

from benchmarks.reliability.emulated_network import Path
from hapticmech_ros.nodes.realtime import ask_for_real_time

ETH_P_IP = 0x0800
LARGEST_FRAME = 65_536
# Frames of one side that are taken before the other side gets its turn.
AT_ONCE = 64
BUFFER_BYTES = 8 << 20
COUNTED = ("came", "lost", "held_back")
_PR_SET_TIMERSLACK = 29


@dataclass(slots=True)
class Direction:
    """One way through the forwarder.

    Attributes:
        source, target: packet sockets.
        path: what happens to packets.
        counts: packets that came, were lost, and were held back so that others overtake them.
    """

    source: socket.socket
    target: socket.socket
    path: Path = field(default_factory=Path)
    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(COUNTED, 0))

    def late(self, draw: random.Random) -> float | None:
        """Return how late (s) the next packet is; None if it is lost."""
        path = self.path
        self.counts["came"] += 1
        if path.out or (path.loss and draw.random() < path.loss):
            self.counts["lost"] += 1
            return None
        late = path.delay
        if path.jitter:
            late *= 1.0 + path.jitter * draw.uniform(-1.0, 1.0)
        if path.reordered and draw.random() < path.reordered:
            self.counts["held_back"] += 1
            late += path.held
        return late


def opened(interface: str) -> socket.socket:
    """Return a packet socket that hears what arrives at an interface, and sends from there."""
    made = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETH_P_IP))
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
    made.bind((interface, ETH_P_IP))
    made.setblocking(False)
    return made


def forward(ends: tuple[str, str], seed: int = 1) -> None:
    """Forward until standard input ends."""
    # Timers of 1 µs: by default Linux gathers wake-ups over 50 µs.
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1)
    gc.disable()
    device, rest = (opened(end) for end in ends)
    draw = random.Random(seed)
    ways = {"to_rest": Direction(device, rest), "to_device": Direction(rest, device)}
    by_source = {way.source: way for way in ways.values()}
    waiting: list[tuple[float, int, socket.socket, bytes]] = []
    received = [sys.stdin.fileno(), device, rest]
    number, text = 0, b""
    while True:
        now = time.monotonic()
        while waiting and waiting[0][0] <= now:
            _, _, target, frame = heapq.heappop(waiting)
            # As on any network: what does not fit is lost.
            with suppress(OSError):
                target.send(frame)
        timeout = max(waiting[0][0] - now, 0.0) if waiting else None
        for source in select.select(received, (), (), timeout)[0]:
            if not isinstance(source, socket.socket):
                if not (more := os.read(source, 1 << 16)):
                    return
                *lines, text = (text + more).split(b"\n")
                for line in lines:
                    for name, values in json.loads(line).items():
                        ways[name].path = Path(**values)
                    counts = {name: way.counts for name, way in ways.items()}
                    print(json.dumps({"set_s": time.time(), "counts": counts}), flush=True)
                continue
            way = by_source[source]
            for _ in range(AT_ONCE):
                try:
                    frame = source.recv(LARGEST_FRAME)
                except BlockingIOError:
                    break
                if (late := way.late(draw)) is not None:
                    number += 1
                    heapq.heappush(waiting, (time.monotonic() + late, number, way.target, frame))


if __name__ == "__main__":
    # Above what docs/nodes.md proposes for nodes: it stands for hardware, which comes before them.
    ask_for_real_time(60)
    forward((sys.argv[1], sys.argv[2]))
