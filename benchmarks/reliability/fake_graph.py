# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The actors of a graph in one thread, on a host that is no node: no middleware, no clock.

Time goes on when it is told to, and every message that an actor sends is looked at.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

from rclpy.serialization import serialize_message

from benchmarks.reliability.outputs import Outputs
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.nodes.actor import Actor, ClockedActor
from hapticmech_ros.nodes.exchange import Exchange
from hapticmech_ros.nodes.haptic_device import HapticDevice
from hapticmech_ros.nodes.mechanism_simulator import MechanismSimulator
from hapticmech_ros.nodes.nullspace_analyser import NullspaceAnalyser
from hapticmech_ros.nodes.sources import WithInfo
from hapticmech_ros.nodes.teleoperation_controller import TeleoperationController
from hapticmech_ros.nodes.timeouts import OwnPauses
from hapticmech_ros.nodes.viewer.scene_viewer import SceneViewer
from hapticmech_ros.numerics.times import NANOSECONDS

ACTORS: tuple[type[Actor[Any]], ...] = (
    HapticDevice,
    MechanismSimulator,
    NullspaceAnalyser,
    TeleoperationController,
    SceneViewer,
)
WRENCH_TYPE = "geometry_msgs/msg/WrenchStamped"
START_NS = 1_700_000_000 * NANOSECONDS


@dataclass
class Subscription:
    """What an actor hears, as bytes."""

    topic: str
    kind: Any
    callback: Callable[..., None]

    def get_publisher_count(self) -> int:
        """One speaks."""
        return 1


@dataclass
class Log:
    """What a node says, by level."""

    lines: list[tuple[str, str]] = field(default_factory=list)

    def __getattr__(self, level: str) -> Callable[[str], None]:
        def say(text: str) -> None:
            if len(self.lines) < 1000:
                self.lines.append((level, text))

        return say


class Host:
    """Hosts one actor."""

    def __init__(self, graph: FakeGraph, name: str) -> None:
        self.graph = graph
        self.name = name
        self.active = False
        self.exchange = graph.exchange
        self.pauses = OwnPauses(lambda: None)
        self.log = Log()
        self.refused = 0
        self.last_refusal = ""
        self.timers: list[list[Any]] = []
        self.services: dict[str, Callable[[Any, Any], Any]] = {}
        self.actor: Any = None

    def create_publisher(self, kind: Any, name: str, qos: Any) -> Any:
        """Return what sends to the graph."""
        topic = self.resolve_topic_name(name)
        return SimpleNamespace(
            topic_name=topic,
            publish=lambda message: self.graph.sent(topic, kind, message),
            get_subscription_count=lambda: 1000,
        )

    def create_subscription(
        self, kind: Any, name: str, callback: Any, qos: Any, raw: bool = False
    ) -> Subscription:
        """Hear a topic."""
        if not raw:
            raise TypeError(f"{name}: actors hear bytes")
        made = Subscription(self.resolve_topic_name(name), kind, callback)
        self.graph.subscriptions[made.topic].append(made)
        return made

    def create_service(self, kind: Any, name: str, callback: Any) -> object:
        """Offer a service."""
        self.services[name] = callback
        return object()

    def create_client(self, kind: Any, name: str) -> object:
        """As of an rclpy node; none of these actors asks anything of others."""
        return kind, name

    def drop(self, entity: Any) -> None:
        """Hear a topic no more."""
        self.graph.subscriptions[entity.topic].remove(entity)

    destroy_subscription = drop

    def resolve_topic_name(self, name: str) -> str:
        """Return the full name."""
        return name if name.startswith("/") else f"{self.graph.namespace}/{name}"

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        """Return the topics that people push through."""
        return [(name, [WRENCH_TYPE]) for name in self.graph.pushing]

    def count_publishers(self, topic: str) -> int:
        """One speaks."""
        return 1

    def get_publishers_info_by_topic(self, topic: str) -> list[Any]:
        """Nobody that has a name."""
        return []

    def get_logger(self) -> Log:
        """Return the log."""
        return self.log

    def look_at_clock(self) -> None:
        """Nobody sets this clock."""

    def now_ns(self) -> int:
        """Return the graph's time, ns."""
        return self.graph.now_ns

    def keep(self, entity: Any) -> Any:
        """Return it."""
        return entity

    def lane_kind(self, message_type: Any) -> str:
        """There is one process."""
        return ""

    def hand_over(self, topic: str, kind: Any, listener: Any) -> Callable[[bytes], bool]:
        """All goes through the middleware."""
        return lambda message: False

    def every(
        self, period_s: float, callback: Callable[[], None], is_due: Callable[[], bool]
    ) -> None:
        """Call back while active, where it is due."""
        self.timers.append([period_s, 0, callback, is_due])

    def end(self) -> None:
        """Deactivate."""
        if self.active:
            self.actor.deactivate()
        self.active = False

    def refuse(self, topic: str, error: HapticMechError) -> None:
        """Count a message that breaks a rule."""
        self.refused += 1
        self.last_refusal = f"{topic}: {error}"

    def begin(self) -> None:
        """Activate if inactive."""
        if not self.active:
            self.begin_anew()

    def begin_anew(self) -> None:
        """Activate, or begin anew if active, as after a step of the clock."""
        self.actor.activate()
        if isinstance(self.actor, ClockedActor):
            self.actor.begin(self.graph.now_ns)
        self.active = True

    def act(self, now_ns: int) -> None:
        """Let the actor act, and what waits for its turn."""
        if not self.active:
            return
        for timer in self.timers:
            if now_ns >= timer[1]:
                timer[1] = now_ns + round(timer[0] * NANOSECONDS)
                if timer[3]():
                    timer[2]()
        if isinstance(self.actor, ClockedActor):
            self.actor.act(now_ns)
        self.graph.deliver()


class FakeGraph:
    """All actors of a scene.

    Args:
        scene: name or path.
        pushing: full names of topics through which people push.
        actors: which.
        parameters: by actor's name.
        namespace: of all of them, such as ``/left``.

    Attributes:
        namespace: as given.
        now_ns: the time.
        hosts: by actor's name.
        seen: what was sent.
        last: topic -> the last message sent, as bytes where it is sent so.
    """

    def __init__(
        self,
        scene: str,
        pushing: Iterable[str] = (),
        actors: Iterable[type[Actor[Any]]] = ACTORS,
        parameters: Mapping[str, Mapping[str, object]] | None = None,
        namespace: str = "",
    ) -> None:
        self.namespace = namespace
        self.now_ns = START_NS
        self.exchange = Exchange()
        self.subscriptions: dict[str, list[Subscription]] = defaultdict(list)
        self.pushing = tuple(pushing)
        self.seen = Outputs(load_scene(scene).device)
        self.last: dict[str, Any] = {}
        self._numbers: dict[str, int] = defaultdict(int)
        self._waiting: deque[tuple[Subscription, bytes, int]] = deque()
        self.hosts: dict[str, Host] = {}
        for kind in actors:
            host = self.hosts[kind.name] = Host(self, kind.name)
            given: dict[str, Any] = {"scene": scene, **(parameters or {}).get(kind.name, {})}
            host.actor = kind(host, kind.parameters_type(**given))
        first = next(iter(self.hosts.values())).actor
        self.period_ns = first.scene.simulation.period * 1e9
        for host in self.hosts.values():
            host.begin()

    def actor(self, name: str) -> Any:
        """Return an actor by name."""
        return self.hosts[name].actor

    def run(self, seconds: float) -> None:
        """Let time go on, by halves of a period."""
        for _ in range(round(2e9 * seconds / self.period_ns)):
            self.tick()

    def tick(self) -> None:
        """Let half a period go by."""
        self.now_ns += round(self.period_ns / 2)
        for host in self.hosts.values():
            host.act(self.now_ns)

    def listened(self) -> list[tuple[str, Any]]:
        """Return every topic that somebody hears, and its message type."""
        return [(name, found[0].kind) for name, found in self.subscriptions.items() if found]

    def put(self, topic: str, message: bytes, number: int = 0) -> None:
        """Bring a message's bytes to all who hear the topic, as the middleware would.

        Args:
            topic: its full name.
            message: its bytes.
            number: of another publisher's message; 0: the next one of the same publisher.
        """
        self._waiting += [(one, message, number) for one in self.subscriptions[topic]]
        self.deliver()

    def sent(self, topic: str, kind: Any, message: Any) -> None:
        """Look at what an actor sends, and bring it to those who hear the topic."""
        self.seen.look(topic, kind, message)
        self.last[topic] = message
        if received := list(self.subscriptions.get(topic, ())):
            given = message if isinstance(message, bytes) else serialize_message(message)
            self._waiting += [(one, given, 0) for one in received]

    def deliver(self) -> None:
        """Bring all that was sent, and what is sent meanwhile, one after the other."""
        while self._waiting:
            self._received(*self._waiting.popleft())

    def _received(self, one: Subscription, message: bytes, number: int) -> None:
        if isinstance(one.callback, WithInfo):
            self._numbers[one.topic] += not number
            info = {"publication_sequence_number": number or self._numbers[one.topic]}
            one.callback(message, info)
        else:
            one.callback(message)
