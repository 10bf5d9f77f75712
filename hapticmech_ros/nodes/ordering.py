# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in the order in which they were sent: what later ones have overtaken is told apart.

Best-effort readers take messages as they come, and a network may swap them. A command that answers
an older sample than the one obeyed would take the device back in time, with a step of the force.
Stamps are compared with each other only, never with a clock.
"""

from __future__ import annotations

from hapticmech_ros.nodes.inputs import NEVER
from hapticmech_ros.times import NANOSECONDS

# After so long without a newer one, an older stamp is a sender that began anew: its clock was set,
# or it was replaced.
FORGET_NS = NANOSECONDS // 4


class InOrder:
    """The newest stamp of one stream of messages.

    Attributes:
        overtaken: messages that came after newer ones.
    """

    def __init__(self) -> None:
        self.overtaken = 0
        self._newest_ns = NEVER
        self._arrived_ns = NEVER

    def is_next(self, stamp_ns: int, now_ns: int) -> bool:
        """Return whether a message is no older than those before it, and count it if it is.

        Args:
            stamp_ns: its stamp; one that equals ``now_ns`` had none, and is taken as it comes.
            now_ns: when it arrived.
        """
        if stamp_ns == now_ns:
            return True
        if stamp_ns < self._newest_ns and now_ns - self._arrived_ns <= FORGET_NS:
            self.overtaken += 1
            return False
        self._newest_ns, self._arrived_ns = stamp_ns, now_ns
        return True

    @property
    def last(self) -> tuple[int, int]:
        """The newest stamp, and when it arrived, ns."""
        return self._newest_ns, self._arrived_ns

    @last.setter
    def last(self, stamps: tuple[int, int]) -> None:
        self._newest_ns, self._arrived_ns = stamps

    def forget(self) -> None:
        """Take whatever comes next as the newest."""
        self._newest_ns = self._arrived_ns = NEVER
