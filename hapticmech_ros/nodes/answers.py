# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Answers to a device's samples: in order, and how long each took, by the device's own clock."""

from __future__ import annotations

from collections.abc import Sequence

from hapticmech_ros.control.loop_delay import RoundTripEstimate
from hapticmech_ros.nodes.inputs import NEVER, InOrder
from hapticmech_ros.nodes.local_loop import LocalLoop
from hapticmech_ros.times import NANOSECONDS


class Answers(InOrder):
    """The commands that answer a device's samples.

    Args:
        loop: remembers these samples.

    Attributes:
        obeys: whether the device obeys them.
        answered_ns: stamp of the sample that the newest of them answers.
    """

    def __init__(self, loop: LocalLoop) -> None:
        super().__init__()
        self.obeys = False
        self.answered_ns = 0
        self._let_go_ns = NEVER
        self._loop = loop
        self._estimate = RoundTripEstimate()

    @property
    def round_trip(self) -> float:
        """Time (s) from a sample to its answer, 95 in 100 of late; 0 while it is not known."""
        return self._estimate.value

    def is_next(self, stamp_ns: int, now_ns: int) -> bool:
        """Return whether an answer is no older than those before it, and take its time."""
        if not super().is_next(stamp_ns, now_ns):
            return False
        self.answered_ns = stamp_ns
        if self._loop.remembers(stamp_ns):
            self._estimate.add((now_ns - stamp_ns) / NANOSECONDS)
        return True

    @property
    def until_renewed(self) -> int:
        """How many more answers leave :attr:`round_trip` as it is."""
        return self._estimate.until_renewed

    def went_on(self, newest: tuple[int, int], trips: Sequence[float]) -> None:
        """Note answers.

        Args:
            newest: stamp of the newest one, and when it came, ns.
            trips: s, that they took, of those that answer samples.
        """
        self.last = newest
        self.answered_ns = newest[0]
        for trip in trips:
            self._estimate.add(trip)

    def lost(self, now_ns: int) -> str:
        """Return what is lost of what it obeys, at a time (ns); empty if nothing is."""
        well = not self.obeys or self._loop.can_correct(self.answered_ns, now_ns)
        return "" if well else "local_feedback_gain is lost"

    def begin(self, answered_ns: int, now_ns: int) -> bool:
        """Return whether to obey a command from now on, or already.

        What answers a sample from before the device let go was meant for a hand that was held.
        Commands that answer no sample are those of somebody who closes no loop.

        Args:
            answered_ns: stamp of the sample that it answers, ns.
            now_ns: present time, ns.
        """
        late = answered_ns <= self._let_go_ns and self._loop.remembers(answered_ns)
        if not (self.obeys or late) and self._loop.can_correct(answered_ns, now_ns):
            self.obeys = True
            self._loop.begin()
        return self.obeys

    def let_go(self, now_ns: int) -> None:
        """Obey nothing that answers a sample up to now (ns)."""
        if self.obeys:
            self._let_go_ns = now_ns
        self.obeys = False
        self._loop.forget(self._let_go_ns)

    def figures(self) -> dict[str, str]:
        """Return what diagnostics say."""
        return {
            "round_trip_ms": f"{1e3 * self.round_trip:.1f}",
            "overtaken_commands": str(self.overtaken),
            "overtaken_gains": str(self._loop.order.overtaken),
        }
