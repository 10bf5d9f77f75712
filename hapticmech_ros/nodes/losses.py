# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What an actor loses because nothing comes in time, and whether a pause explains it.

Pauses do if they make up half of the silence.
"""

from __future__ import annotations

from collections.abc import Callable

from hapticmech_ros.nodes.pauses import OwnPauses, Pauses, SenderPauses


class Losses:
    """Counts an actor's losses, and says what explains them.

    Args:
        own: pauses of this process.
        rate_hz: the control rate, Hz.
        say: warns.

    Attributes:
        count: losses.
        without_processor: of these, those that a pause of this process explains.
        sender_paused: those that a pause of the sender explains.
    """

    def __init__(self, own: OwnPauses, rate_hz: float, say: Callable[[str], None]) -> None:
        self._own, self._rate_hz, self._say = own, rate_hz, say
        self.count = self.without_processor = self.sender_paused = 0
        # What is not explained yet: who was silent since when, and the timeout.
        self._open: tuple[SenderPauses, int, int] | None = None

    def explained(
        self,
        silence_ns: int | None,
        timeout_ns: int,
        now_ns: int,
        sender: SenderPauses | None = None,
    ) -> str:
        """Count a loss, and return what explains it; empty if nothing does, or not yet.

        Args:
            silence_ns: how long nothing has come, ns; None: that is not known, and a pause explains
                losses for two timeouts.
            timeout_ns: how long nothing may come, ns.
            now_ns: present time, ns.
            sender: pauses of who was silent, if they can be known.
        """
        self.count += 1
        self._open = None
        if paused := _explaining(self._own, silence_ns, timeout_ns):
            self.without_processor += 1
            self._explain(paused, now_ns)
            return f"this process had no processor for {paused / 1e6:.0f} ms"
        if sender is None or silence_ns is None:
            return ""
        self._open = sender, now_ns - silence_ns, timeout_ns
        return self.explained_now(now_ns)

    def explained_now(self, now_ns: int) -> str:
        """Return what has come to explain the last loss, ns; empty if nothing has."""
        if self._open is None:
            return ""
        sender, heard_ns, timeout_ns = self._open
        paused = _explaining(sender, sender.looked_ns - heard_ns, timeout_ns)
        if not paused:
            return ""
        self._open = None
        self.sender_paused += 1
        self._explain(paused, now_ns)
        return f"{sender.name} had paused for {paused / 1e6:.0f} ms"

    def figures(self) -> dict[str, str]:
        """Return what diagnostics say."""
        return {
            "losses": str(self.count),
            "lost_without_processor": str(self.without_processor),
        }

    def _explain(self, paused_ns: int, now_ns: int) -> None:
        if said := self._own.remedy.after(paused_ns, self._rate_hz, now_ns):
            self._say(said)


def _explaining(pauses: Pauses, silence_ns: int | None, timeout_ns: int) -> int:
    """Return how long the pauses were, ns, that explain a silence; 0 if none do."""
    within, whole = pauses.within(2 * timeout_ns if silence_ns is None else silence_ns)
    return whole if 2 * within >= (silence_ns or timeout_ns) else 0
