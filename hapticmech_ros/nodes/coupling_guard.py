# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether what commands are corrected for other hands by comes from one publisher each.

Of two nobody knows which one is right, so that neither is used. That costs no more than the
correction: other hands are felt two periods late, as behind a connection. The force is not set to
zero, as it is for two who command, or who tell how commands depend on the device itself: somebody
else's second device must not stop this one.
"""

from __future__ import annotations

from typing import Any

from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.nodes.sources import Sources


class CouplingGuard:
    """Watches topics, each of which has one publisher.

    Args:
        actor: that hears them.
    """

    def __init__(self, actor: Actor[Any]) -> None:
        self._actor = actor
        self._watched: dict[str, Sources] = {}
        self._warned = False

    def watch(self, topic: str) -> Sources | None:
        """Return what is told whom a topic's messages come from.

        None in lockstep, where nothing is dropped that is waited for.
        """
        if self._actor.lockstep:
            return None
        return self._watched.setdefault(topic, self._actor.sources(topic))

    def doubtful(self, now_ns: int) -> list[str]:
        """Return the topics that must not be used now, and say so when the first of them comes."""
        found = [topic for topic, one in self._watched.items() if one.fault(now_ns)]
        if found and not self._warned:
            text = f"{self.fault(now_ns)}: commands are not corrected for other hands by it"
            self._actor.node.get_logger().warning(text)
        self._warned = bool(found)
        return found

    def fault(self, now_ns: int) -> str:
        """Return a sentence that names two publishers of one topic; empty if there are none."""
        return next((text for one in self._watched.values() if (text := one.fault(now_ns))), "")

    def forget(self) -> None:
        """Forget who spoke."""
        for one in self._watched.values():
            one.forget()
