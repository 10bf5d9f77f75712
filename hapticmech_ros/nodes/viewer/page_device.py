# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A user's device as a page on a graph knows it: where it is, and whether a mouse can drag it."""

from __future__ import annotations

from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.arrays import Array
from hapticmech_ros.live.commands import Draggable
from hapticmech_ros.live.live_session import holding
from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.nodes.timeouts import ByRate
from hapticmech_ros.nodes.viewer.graph_commands import GraphCommands
from hapticmech_ros.nodes.viewer.scene_inputs import SceneInput
from hapticmech_ros.scene.hand import STILL_HAND
from hapticmech_ros.times import NANOSECONDS, nanoseconds
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.layouts import DeviceSample, unpack_device
from hapticmech_ros.wire.topic import DEVICE, REAL_DEVICES
from hapticmech_ros.wire.topics import DEVICE_STATE, DIAGNOSTICS, HAND_WRENCH

# What is older nobody is pushed by.
STALE = ByRate(12, 0.05)
# Diagnostics come once a second; older ones (ns) are not shown.
_TOLD_NS = 3 * NANOSECONDS


class PageDevice:
    """What is heard of the device that holds an operational point.

    Args:
        page: the node.
        point: that is held.
        prefix: before the names of the user's topics and nodes.
        commands: of the page.
    """

    def __init__(self, page: Actor[Any], point: str, prefix: str, commands: GraphCommands) -> None:
        self._body, self._prefix, self._commands = Draggable("hand", point), prefix, commands
        self._scene = page.shared_scene.held_at(point)
        self._stale_ns = nanoseconds(STALE.at(page.period_s))
        self._state: SceneInput[DeviceSample] = SceneInput(
            page,
            prefix + DEVICE_STATE.name,
            Float64MultiArray,
            lambda data: unpack_device(decode(data)),
        )
        # Full name of each node that may drive it -> the node.
        self._drivers = {
            page.node.resolve_topic_name(prefix + name).lstrip("/"): name
            for name in (DEVICE, *REAL_DEVICES)
        }
        self._driver, self._said = DEVICE, ""
        self._figures: dict[str, str] = {}
        self._heard_ns = -_TOLD_NS

    def listen(self, wanted: bool) -> None:
        """Subscribe to its samples, or not."""
        if wanted:
            self._state.open()
        else:
            self._state.close()

    def forget(self) -> None:
        """Forget its samples."""
        self._state.forget()

    def hear(self, message: DiagnosticArray, now_ns: int) -> None:
        """Take what its driver says of itself at a time (ns)."""
        for status in message.status:
            if status.name in self._drivers:
                self._driver, self._said = self._drivers[status.name], status.message
                self._figures = {pair.key: pair.value for pair in status.values}
                self._heard_ns = now_ns

    def motion(self, now_ns: int) -> tuple[Array, Array] | None:
        """Return its place (3,), m, and velocity (3,), m/s, world axes; None if not known."""
        sample = self._state.value(now_ns, self._stale_ns)
        if sample is None:
            return None
        return sample.measured.pose.translation, sample.measured.twist[:3]

    def told(self, now_ns: int) -> str:
        """Return what its driver says of its rate."""
        if not self._is_told(now_ns):
            return f"nothing of {self._prefix}{DEVICE} on {DIAGNOSTICS.name}"
        rate, missed = (
            self._figures.get(key, "-") for key in ("achieved_rate_hz", "missed_deadlines")
        )
        return f"{self._prefix}{self._driver} {rate} Hz, {missed} deadlines missed"

    def holding(self, now_ns: int) -> str:
        """Return what holds it beside the mouse, and what its driver says of itself."""
        if not self._is_told(now_ns):
            return ""
        chosen = self._figures.get("hand", "")
        hand = {"still": STILL_HAND, "commanded": None}.get(chosen, self._scene.hand)
        return f"{holding(hand, self._scene.device.force_limit)}; {self._driver}: {self._said}"

    def immovable(self, now_ns: int) -> str:
        """Return why the mouse cannot drag it; empty if it can."""
        topic = f"{self._prefix}{HAND_WRENCH.name}"
        if self._is_told(now_ns) and self._driver in REAL_DEVICES:
            return f"{self._driver} drives a real device, which its own user's hand alone moves"
        if not self._commands.is_heard(self._body):
            return f"no device listens to {topic}"
        if self.motion(now_ns) is None:
            return f"nothing is heard on {self._prefix}{DEVICE_STATE.name}"
        return ""

    def _is_told(self, now_ns: int) -> bool:
        return now_ns - self._heard_ns <= _TOLD_NS
