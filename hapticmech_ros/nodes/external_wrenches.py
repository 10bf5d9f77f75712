# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Wrenches on a body by any other nodes: any number at once, summed.

A body's wrenches come on ``external_cf`` below its name, where each expires after a timeout, and on
``external_cf/persistent``, where the last one stays until it is replaced, as in Gazebo's
``wrench/persistent``. Further publishers use names below these, such as ``external_cf/<who>`` and
``external_cf/persistent/<who>``: one name for each, because a ROS subscriber does not know a
message's publisher. Names are found in the graph as publishers appear: a body without pushes costs
nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

from geometry_msgs.msg import WrenchStamped
from rclpy.subscription import Subscription

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.nodes.inputs import ExpiringWrench
from hapticmech_ros.nodes.messages import CONTROL_SUBSCRIBER, WORLD, checked_stamp, read_wrench
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.quaternions import turned
from hapticmech_ros.numerics.times import NANOSECONDS

WRENCH_TYPE = "geometry_msgs/msg/WrenchStamped"
# How often the graph is searched for new publishers, s of the machine's clock.
SCAN_PERIOD_S = 0.25
# Suffix of a topic whose wrenches stay until they are replaced.
PERSISTENT = "/persistent"
RAMP_NS = NANOSECONDS // 20


@dataclass(slots=True)
class Source:
    """One topic of wrenches: on which body, in which frame's axes, and for how long."""

    body: str
    persistent: bool
    wrench: ExpiringWrench
    subscription: Subscription
    found: bool
    frame: str = WORLD
    shared: bool = False


class ExternalWrenches:
    """All pushes on some bodies.

    Args:
        actor: whose node listens.
        prefixes: body -> relative name below which it is pushed.
        verb: name of the topic below a prefix; ``<verb>/persistent`` is the one of wrenches that
            stay until they are replaced.
        frames: frames whose axes a wrench may be given in, apart from ``world``.
        root: relative name below which every body is; a publisher there that matches no body is
            logged.
    """

    def __init__(
        self,
        actor: Actor[Any],
        prefixes: Mapping[str, str],
        verb: str,
        frames: Collection[str],
        root: str = "",
    ) -> None:
        self._actor = actor
        self._frames = {WORLD, *frames}
        resolve = actor.node.resolve_topic_name
        # Of names that begin alike the longer one comes first.
        self._own = {
            resolve(f"{prefix}/{verb}{below}"): (body, below == PERSISTENT)
            for below in (PERSISTENT, "")
            for body, prefix in prefixes.items()
        }
        self._bodies = tuple(prefixes)
        self._verb = verb
        self._root = f"{resolve(root)}/" if root else ""
        self._timeout_ns = 0
        self._named: set[str] = set()
        self._seen: dict[str, int] = {}
        self.sources: dict[str, Source] = {}
        actor.node.every(
            SCAN_PERIOD_S,
            lambda: actor.failures.run("scan for pushes", self.scan),
            self._has_changed,
        )

    def listen(self, relative: str) -> None:
        """Listen to a body's own topic from the start, without waiting for a publisher."""
        name = self._actor.node.resolve_topic_name(relative)
        self._add(name, *self._own[name], found=False)

    def set_timeout(self, timeout_ns: int) -> None:
        """Set how long wrenches act that are not persistent."""
        self._timeout_ns = timeout_ns
        for source in self.sources.values():
            if not source.persistent:
                source.wrench.timeout_ns = timeout_ns

    def forget(self) -> None:
        """Drop all wrenches; publishers that go on are received again."""
        for source in self.sources.values():
            source.wrench.clear()

    def pushes(self, now_ns: int) -> bool:
        """Return whether any wrench acts at a time, ns."""
        return any(source.wrench.stands(now_ns) for source in self.sources.values())

    def at(self, now_ns: int, rotation_of: Callable[[str], Array]) -> dict[str, Array]:
        """Return the sum of wrenches (6,) on each body that is pushed, N and N m, world axes.

        Args:
            now_ns: present time, ns.
            rotation_of: returns a frame's rotation (3, 3) in the world.
        """
        total: dict[str, Array] = {}
        for source in self.sources.values():
            if not source.wrench.stands(now_ns):
                continue
            wrench = source.wrench.at(now_ns)
            if source.frame != WORLD:
                wrench = turned(wrench, rotation_of(source.frame))
            held = total.get(source.body)
            total[source.body] = wrench if held is None else held + wrench
        return total

    def scan(self) -> None:
        """Subscribe to new publishers, drop those that left, log those that push no body."""
        node = self._actor.node
        self._seen = self._publishers()
        for name in self._seen:
            if name not in self.sources:
                self._consider(name)
        for name, source in list(self.sources.items()):
            publishers = self._seen.get(name, 0)
            if publishers > 1 and not source.shared:
                source.shared = True
                node.get_logger().warning(
                    f"{publishers} publishers on {name}: only the newest message acts; "
                    f"to sum them, publish each on a topic of its own, such as {name}/left"
                )
            # A persistent wrench stays when its publisher is gone; so does one not yet expired.
            gone = source.found and not publishers and not source.persistent
            if gone and not source.wrench.at(self._actor.now_ns()).any():
                del self.sources[name]
                node.drop(source.subscription)

    def _publishers(self) -> dict[str, int]:
        """Return how many publishers each topic of wrenches has."""
        node = self._actor.node
        found = node.get_topic_names_and_types()
        return {name: node.count_publishers(name) for name, types in found if WRENCH_TYPE in types}

    def _has_changed(self) -> bool:
        """Return whether a scan would find anything; the node may go on meanwhile."""
        seen = self._publishers()
        leaving = [source.found and not seen.get(name) for name, source in self.sources.items()]
        return seen != self._seen or any(leaving)

    def figures(self, now_ns: int) -> dict[str, str]:
        """Return who pushes now, for diagnostics."""
        pushing = [name for name, s in self.sources.items() if s.wrench.at(now_ns).any()]
        return {"pushed_by": " ".join(sorted(pushing)) or "nobody"}

    def _consider(self, name: str) -> None:
        node = self._actor.node
        for own, (body, persistent) in self._own.items():
            if name == own or name.startswith(f"{own}/"):
                if self._seen[name]:
                    self._add(name, body, persistent, found=True)
                return
        below = name.removeprefix(self._root) if self._root else name
        if below != name and name not in self._named and self._verb in below.split("/"):
            self._named.add(name)
            known = ", ".join(self._bodies)
            node.get_logger().warning(
                f"{name} names no body of the scene: must be below one of {known}"
            )

    def _add(self, name: str, body: str, persistent: bool, found: bool) -> None:
        actor = self._actor
        timeout_ns = 0 if persistent else self._timeout_ns
        wrench = ExpiringWrench(timeout_ns=timeout_ns, ramp_ns=RAMP_NS)

        def accept(message: WrenchStamped, now_ns: int) -> None:
            checked_stamp(message.header, now_ns, actor.age_limit_ns, unstamped_is_now=True)
            frame = message.header.frame_id
            if frame not in self._frames:
                rule = f"must be one of {', '.join(sorted(self._frames))}"
                raise InvalidInputError("frame_id", frame, rule)
            source.wrench.put(read_wrench(message, actor.wrenches, frame), now_ns)
            source.frame = frame

        subscription = actor.input(name, WrenchStamped, CONTROL_SUBSCRIBER, accept)
        source = Source(body, persistent, wrench, subscription, found)
        self.sources[name] = source
