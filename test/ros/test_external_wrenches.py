# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pushes of other nodes: found, summed, held or expiring, and slips in them named.

What a push on a link or in another frame does: test/nodes/test_mechanism_alone.py.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import Log

from ros.harness import Peer, running, six

NODE = "mechanism_simulator"


class Pushed:
    """The mechanism as it is pushed: what it says, and publishers that push on while waiting."""

    def __init__(self, peer: Peer) -> None:
        self.peer = peer
        self.forces = peer.listen("mechanism/handle/measured_cf", WrenchStamped)
        self.statuses = peer.statuses()
        self.logs = peer.listen("/rosout", Log)
        self._pushing: dict[str, tuple[Any, tuple[float, ...], str]] = {}

    def push(self, below: str, *wrench: float, frame: str = "world") -> None:
        """Push from now on through a topic below ``mechanism/``."""
        held = self._pushing.get(below)
        publisher = held[0] if held else self.new_publisher(below)
        self._pushing[below] = publisher, wrench, frame

    def new_publisher(self, below: str) -> Any:
        """Return a publisher, met or not."""
        return self.peer.node.create_publisher(WrenchStamped, f"mechanism/{below}", 10)

    def stop(self, below: str, leave: bool = False) -> None:
        """Push no more, and leave the graph if so wished."""
        publisher, _, _ = self._pushing.pop(below)
        if leave:
            self.peer.node.destroy_publisher(publisher)

    def until(self, condition: Any, what: str) -> None:
        """Push until a condition holds."""
        self.peer.until(condition, what, doing=self._go_on)

    def _go_on(self) -> None:
        for publisher, wrench, frame in self._pushing.values():
            publisher.publish(self.peer.wrench(*wrench, frame=frame))
        self.peer.run(0.01)

    def until_force(self, *expected: float, tolerance: float = 0.0) -> None:
        """Push until the mechanism measures a wrench at its handle."""

        def measured() -> bool:
            found = six(self.forces[-1]) if self.forces else [np.nan] * 6
            return bool(np.abs(np.subtract(found, expected)).max() <= tolerance)

        self.until(measured, f"the force {expected}")

    def until_status(self, key: str, *words: str) -> None:
        """Push until diagnostics say all these words of something."""
        self.until(
            lambda: all(word in self.statuses.figure(NODE, key) for word in words),
            f"{key} to say {words}",
        )

    def until_warned(self, *words: str) -> None:
        """Push until a line of the log has all these words."""
        self.until(
            lambda: any(all(word in log.msg for word in words) for log in self.logs),
            f"a warning with {words}",
        )


def test_pushes_add_up_and_run_out_each_by_itself(domain: int, peer: Peer) -> None:
    arm = Pushed(peer)
    with running(NODE, domain, "spatial_arm", external_timeout=0.5, diagnostics_period=0.05):
        arm.push("handle/external_cf", 0.0, 0.0, 0.03, 0.0, 0.0, 0.0)
        arm.push("handle/external_cf/left", 0.01, 0.0, 0.0, 0.0, 0.0, 0.001)
        arm.push("handle/external_cf/right/hand", 0.0, 0.02, 0.0, 0.0, 0.0, 0.0)
        arm.until_force(0.01, 0.02, 0.03, 0.0, 0.0, 0.001)
        pushers = [f"/mechanism/handle/external_cf{who}" for who in ("", "/left", "/right/hand")]
        arm.until_status("pushed_by", *pushers)
        arm.stop("handle/external_cf/right/hand")
        arm.until_force(0.01, 0.0, 0.03, 0.0, 0.0, 0.001)
        arm.stop("handle/external_cf", leave=True)
        arm.until_force(0.01, 0.0, 0.0, 0.0, 0.0, 0.001)
        arm.stop("handle/external_cf/left")
        arm.until_force(*[0.0] * 6)
        arm.until_status("pushed_by", "nobody")

        # A wrench that is held stands when its publisher is gone, until another one comes.
        arm.push("handle/external_cf/persistent", 0.02, 0.0, 0.0, 0.0, 0.0, 0.0)
        arm.push("handle/external_cf/persistent/mass", 0.0, 0.0, 0.01, 0.0, 0.0, 0.0)
        arm.until_force(0.02, 0.0, 0.01, 0.0, 0.0, 0.0)
        arm.stop("handle/external_cf/persistent", leave=True)
        arm.stop("handle/external_cf/persistent/mass")
        seen = len(arm.forces)
        # Twice the timeout that others have, by the mechanism's own samples.
        arm.until(lambda: len(arm.forces) > seen + 100, "a second of samples")
        assert all(six(force)[:3] == [0.02, 0.0, 0.01] for force in arm.forces[seen:])
        arm.push("handle/external_cf/persistent", 0.0, -0.02, 0.0, 0.0, 0.0, 0.0)
        arm.until_force(0.0, -0.02, 0.01, 0.0, 0.0, 0.0)
        arm.push("handle/external_cf/persistent", *[0.0] * 6)
        arm.until_force(0.0, 0.0, 0.01, 0.0, 0.0, 0.0)


def test_slips_are_refused_and_named(domain: int, peer: Peer) -> None:
    arm = Pushed(peer)
    with running(NODE, domain, "spatial_arm", diagnostics_period=0.05):
        arm.push("handle/external_cf", 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, frame="tool0")
        arm.push("tip/external_cf", 0.1, 0.0, 0.0, 0.0, 0.0, 0.0)
        arm.until_status("last_refusal", "handle/external_cf", "tool0", "handle_world", "hand")
        # One slip at a time: of two, diagnostics show whichever was refused last.
        arm.stop("handle/external_cf")
        arm.push("elbow/external_cf/persistent/me", np.nan, 0.0, 0.0, 0.0, 0.0, 0.0)
        arm.until_status("last_refusal", "elbow/external_cf/persistent/me", "nan", "finite")
        assert arm.statuses.count(NODE, "refused_messages") > 1
        assert arm.statuses.figure(NODE, "pushed_by") == "nobody"
        arm.until_warned("/mechanism/tip/external_cf", "handle", "forearm")
        assert not any("servo_cf" in log.msg for log in arm.logs)
        arm.new_publisher("handle/external_cf")
        arm.until_warned("2 publishers", "/mechanism/handle/external_cf", "of its own")
        arm.push("handle/external_cf", 0.01, 0.0, 0.0, 0.0, 0.0, 0.0, frame="handle")
        arm.until_status("pushed_by", "/mechanism/handle/external_cf")
    warnings = [log.msg for log in arm.logs if "names no body" in log.msg]
    assert len(warnings) == 1
    assert all(np.isfinite(six(force)).all() for force in arm.forces)
