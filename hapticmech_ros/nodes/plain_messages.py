# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a node's kernel does while its process waits: plain messages, without Python.

A message is plain if it comes over the lane from the one publisher that has sent them so far, and
keeps all rules; what is sent goes to the lane's listeners alone. Whatever is not so, the kernel
leaves to Python, which does all that it would do without a kernel: see :mod:`.lane_kernels`.
"""

from __future__ import annotations

import select
import time
from typing import Any

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.nodes import lane_kernels as kernels
from hapticmech_ros.nodes.exchange import Outlet
from hapticmech_ros.nodes.lane import BEHIND_NS, Lane
from hapticmech_ros.nodes.lane_connections import MESSAGE, Outgoing
from hapticmech_ros.nodes.node_time import STEP_NS
from hapticmech_ros.nodes.origin import INSIDE, OUTLETS
from hapticmech_ros.nodes.sources import Sources

# So many messages are enough for once.
MOST_READ = 64
# Two clocks are read at one time if they are no further apart, ns.
_CLOSE_NS = 50_000


def frame_of(prefix: bytes, size: int) -> tuple[Array, Array]:
    """Return words (n,) for a message of the lane, with all but its header, and a view of its data.

    Args:
        prefix: its bytes before the data.
        size: how many numbers it has.
    """
    before = kernels.BEGINS_AT + kernels.HEADER_BYTES + len(prefix)
    words = np.zeros(before // 8 + size, dtype=np.int64)
    words.view(np.uint8)[before - len(prefix) : before] = bytearray(prefix)
    return words, words[before // 8 :].view(np.float64)


def words_of(data: bytes) -> Array:
    """Return bytes as words (n,), filled up with zeros."""
    return np.frombuffer(data.ljust(-(-len(data) // 8) * 8, b"\0"), np.int64).copy()


class PlainMessages:
    """Lets a kernel handle an actor's plain messages; a kind of actor is a subclass.

    Args:
        actor: whose.
        topic: of what is read, its full name and type on the lane.
        sources: of what is read.
        read: bytes before the data of what is read, and how many numbers these are.
        alike: how many of these bytes all messages have.
        outlet: of what is sent.
        sent: words of what is sent, and how many bytes its message has.
        link: (n,) what Python and kernel tell each other.
    """

    def __init__(
        self,
        actor: Any,
        topic: str,
        sources: Sources,
        read: tuple[bytes, int],
        alike: int,
        outlet: Outlet,
        sent: tuple[Array, int],
        link: Array,
    ) -> None:
        self._topic, self._sources, self._outlet, self.link = topic, sources, outlet, link
        self._actor = actor
        prefix, size = read
        self.frame, self.values = frame_of(*read)
        self.prefix = words_of(prefix[:alike])
        self.out_frame, out_bytes = sent
        self.words = np.zeros(4, dtype=np.int64)
        self.ages = np.zeros(MOST_READ, dtype=np.int64)
        self.polled = self.targets = np.zeros(0, dtype=np.int64)
        self._hearers: list[tuple[Outgoing, int]] = []
        self._origin = INSIDE
        link[kernels.DATA] = kernels.HEADER_BYTES + alike
        link[kernels.LENGTH] = kernels.HEADER_BYTES + len(prefix) + 8 * size
        link[kernels.OUT_LENGTH] = kernels.HEADER_BYTES + out_bytes
        link[kernels.STEP], link[kernels.BEHIND] = STEP_NS, BEHIND_NS

    def ready(self) -> bool:
        """Tell the kernel how the actor is; return whether it may do anything for it now."""
        raise NotImplementedError

    def run(self) -> int:
        """Call the kernel; return why it returned."""
        raise NotImplementedError

    def did(self, code: int, reads: int) -> None:
        """Tell the actor what the kernel did.

        Args:
            code: why it returned.
            reads: how many messages it read.
        """
        raise NotImplementedError

    def prepare(self, lane: Lane, waited: list[int], until_ns: int) -> bool:
        """Tell the kernel how things stand; return whether it may do anything.

        Args:
            lane: of the process.
            waited: its connections.
            until_ns: until when to wait, ns of the monotonic clock.
        """
        origin, link = self._sources.only, self.link
        before, now, after = time.monotonic_ns(), self._actor.now_ns(), time.monotonic_ns()
        if after - before > _CLOSE_NS:
            # Interrupted: how far one is ahead of the other would be wrong by as much.
            return False
        link[kernels.AHEAD] = now - (before + after) // 2
        hearers = lane.plain_hearers(self._outlet.topic) if self._outlet.is_on_lane_alone else []
        if not (hearers and origin and self._actor.node.active):
            return False
        speaker = lane.speaker(self._topic, origin.via)
        if speaker is None:
            return False
        connection, code = speaker
        others = [number for number in waited if number != connection]
        self.polled = np.array([connection, *others], dtype=np.int64) | kernels.WAITS_TO_READ
        numbers = [number for to, code_ in hearers for number in (to.connection.fileno(), code_)]
        self.targets = np.array(numbers, dtype=np.int64)
        self._hearers, self._origin = hearers, origin
        link[kernels.UNTIL] = until_ns
        link[kernels.HEAD] = MESSAGE | code << 16 | (origin.via & OUTLETS) << 32
        link[kernels.NUMBER], link[kernels.OUT_NUMBER] = origin.number, self._outlet.published
        link[kernels.OUT_HEAD] = MESSAGE | self._outlet.number << 32
        link[kernels.SENT] = lane.sent(self._outlet.number)
        link[kernels.OLDEST] = self._actor.age_limit_ns
        link[kernels.IDLE] = link[kernels.READS] = link[kernels.UNSENT] = 0
        return self.ready()

    def __call__(self, lane: Lane, waited: list[int]) -> tuple[list[int], int]:
        """Do what is plain until there is something else to do, once :meth:`prepare` allows it.

        Args:
            lane: of the process.
            waited: its connections.

        Returns:
            Those that have something to read, and when it had to wait, ns of the monotonic clock.
        """
        code, link = self.run(), self.link
        lane.note_sent(self._outlet.number, int(link[kernels.SENT]))
        reads = int(link[kernels.READS])
        if reads:
            numbers = link.tolist()
            counted, sent_ns = numbers[kernels.COUNTED], numbers[kernels.SENT_NS]
            last = self._origin._replace(sent=counted, sent_ns=sent_ns)
            self._sources.heard(last, numbers[kernels.READ])
            for age_ns in self.ages[:reads].tolist():
                self._actor.ages.add(age_ns)
        if link[kernels.UNSENT]:
            self._send_again(lane)
        self.did(code, reads)
        ready = select.select(waited, (), (), 0.0)[0] if code == kernels.TO_READ else []
        return ready, int(link[kernels.IDLE])

    def _send_again(self, lane: Lane) -> None:
        """Send the last message to those whose connection did not take it."""
        failed = int(self.link[kernels.UNSENT])
        to = [one for at, one in enumerate(self._hearers) if failed >> at & 1]
        begin = kernels.BEGINS_AT + kernels.HEADER_BYTES
        end = kernels.BEGINS_AT + int(self.link[kernels.OUT_LENGTH])
        message = self.out_frame.tobytes()[begin:end]
        counts = self._outlet.number, self._outlet.published, int(self.link[kernels.SENT])
        lane.send_to(to, *counts, message, False)
