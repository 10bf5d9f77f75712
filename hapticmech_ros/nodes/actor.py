"""What the nodes do, apart from their life: an actor is made on configure and dropped on cleanup.

An actor is a thin shell around core objects of one scene. Its host (a
:class:`~hapticmech_ros.nodes.host.Host`) lends it topics, time and parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Generic, TypeVar

from geometry_msgs.msg import WrenchStamped
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.control.lateness import jitter_allowance
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.nodes.exchange import Outlet
from hapticmech_ros.nodes.host import Host
from hapticmech_ros.nodes.messages import checked_time
from hapticmech_ros.nodes.parameters import NodeParameters
from hapticmech_ros.nodes.period_clock import Backlog, PeriodClock
from hapticmech_ros.nodes.qos import CONTROL_SUBSCRIBER, LOCKSTEP, STREAM_PUBLISHER
from hapticmech_ros.nodes.statistics import DurationHistogram
from hapticmech_ros.scene import Scene, load_scene
from hapticmech_ros.times import nanoseconds
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.topic import Topic
from hapticmech_ros.wire.wrench import WORLD, decode_wrench

M = TypeVar("M")
P = TypeVar("P", bound=NodeParameters)
FOR_EVER = 1 << 62


class Actor(Generic[P]):
    """One of the graph's parts, configured.

    Attributes:
        name: of the node, and of the executable.
        parameters: as they stand; replaced as a whole between two callbacks.
        scene, point: what is modelled, and the operational point held.
        ages: of messages on arrival.
    """

    name: ClassVar[str]
    parameters_type: ClassVar[type[NodeParameters]]

    def __init__(self, node: Host, parameters: P) -> None:
        self.node = node
        self.scene: Scene = load_scene(
            parameters.scene, parameters.control_rate, parameters.network_delay
        )
        self.point = self.scene.operational_point(parameters.operational_point).name
        self.lockstep = parameters.lockstep
        self.control_input: QoSProfile = LOCKSTEP if self.lockstep else CONTROL_SUBSCRIBER
        self.output_qos: QoSProfile = LOCKSTEP if self.lockstep else STREAM_PUBLISHER
        self.ages = DurationHistogram()
        self.adopt(parameters)

    def adopt(self, parameters: P) -> None:
        """Take new parameters, all of them at once."""
        self.parameters = parameters
        self.view_every = max(1, round(1.0 / (parameters.view_rate * self.period_s)))
        # Answers are older by the way there and back.
        there_and_back = 2.0 * self.scene.connection.latest
        limit_ns = nanoseconds(parameters.message_age_limit + there_and_back)
        # In lockstep a sample may come before its own time has been told here.
        self.age_limit_ns = FOR_EVER if self.lockstep else limit_ns

    def silence_ns(self, timeout: float) -> int:
        """Return a timeout (s) in ns, with what a declared network's jitter may add to silence."""
        return nanoseconds(timeout + jitter_allowance(self.scene.connection))

    def vet(self, parameters: P) -> None:
        """Refuse new parameters that this scene cannot have, by HapticMechError."""

    def activate(self) -> None:
        """Begin to act; what was heard before counts no more."""

    def deactivate(self) -> None:
        """Stop acting, and leave nobody under a force."""

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return whether all is well, a sentence, and figures, for diagnostics."""
        raise NotImplementedError

    @property
    def period_s(self) -> float:
        """Control period of the scene, s."""
        return self.scene.simulation.period

    def now_ns(self) -> int:
        """Return the node's time, ns."""
        return self.node.now_ns()

    def output(
        self, topic: Topic, message_type: Any, qos: QoSProfile | None = None, point: str = ""
    ) -> Outlet:
        """Create what a topic of the table is published through."""
        name = topic.of(point or self.point)
        return self.output_named(name, message_type, qos or self.output_qos)

    def output_named(self, name: str, message_type: Any, qos: QoSProfile) -> Outlet:
        """Create what a topic of any name is published through."""
        publisher = self.node.keep(self.node.create_publisher(message_type, name, qos))
        stays = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
        return self.node.exchange.outlet(publisher, publisher.topic_name, stays)

    def input(
        self,
        name: str,
        message_type: type[M],
        qos: QoSProfile,
        accept: Callable[[M, int], None],
    ) -> Subscription:
        """Subscribe; what ``accept(message, now_ns)`` refuses with InvalidInputError is counted."""
        guarded = self.guarded(name, accept)
        made: Subscription = self.node.create_subscription(message_type, name, guarded, qos)
        return self.node.keep(made)

    def input_array(
        self,
        name: str,
        qos: QoSProfile,
        accept: Callable[[Array, int], None],
        fields: Mapping[str, int],
    ) -> None:
        """Subscribe to a Float64MultiArray's data, read from the bytes on the wire.

        Messages are expected to have ``fields``; those that have not are handed on as well.
        """
        decode = FlatArray(fields).decode

        def read(message: bytes, now_ns: int) -> None:
            accept(decode(message), now_ns)

        self._input_raw(name, Float64MultiArray, qos, read)

    def input_command(
        self,
        name: str,
        qos: QoSProfile,
        accept: Callable[[Array, int, int], None],
        unstamped_is_now: bool = True,
        events: SubscriptionEventCallbacks | None = None,
    ) -> None:
        """Subscribe to wrenches in ``world``, read from the bytes on the wire.

        ``accept(wrench, stamp_ns, now_ns)`` gets those that keep the rules. As CRTK has it, a
        command's header may be left empty: it then stands for now, and for ``world``.
        """

        def read(message: bytes, now_ns: int) -> None:
            found = decode_wrench(message)
            if found.frame not in ("", WORLD):
                raise InvalidInputError("frame_id", found.frame, f"must be '{WORLD}', or empty")
            limit = self.age_limit_ns
            stamp = checked_time(found.stamp_ns, now_ns, limit, unstamped_is_now)
            accept(found.values, stamp, now_ns)

        self._input_raw(name, WrenchStamped, qos, read, events)

    def guarded(self, name: str, accept: Callable[[M, int], None]) -> Callable[[M], None]:
        """Return a callback that hands on messages while active, and counts those refused."""

        def callback(message: M) -> None:
            if not self.node.active:
                return
            now = self.now_ns()
            try:
                accept(message, now)
            except InvalidInputError as error:
                self.node.refuse(name, error)
            self.node.exchange.deliver()

        return callback

    def _input_raw(
        self,
        name: str,
        message_type: Any,
        qos: QoSProfile,
        read: Callable[[bytes, int], None],
        events: SubscriptionEventCallbacks | None = None,
    ) -> None:
        """Subscribe to a topic's bytes, be they from this process or from outside."""
        node, callback = self.node, self.guarded(name, read)
        if not self.lockstep:
            # In lockstep all goes one way: what is late there is waited for, not dropped.
            callback = node.hand_over(node.resolve_topic_name(name), callback)
        made = node.create_subscription(
            message_type, name, callback, qos, raw=True, event_callbacks=events
        )
        node.keep(made)


class ClockedActor(Actor[P]):
    """An actor that acts on deadlines of its own as well as on messages.

    Attributes:
        clock: its deadlines; begun on activation.
        backlog: periods that it owes to the clock.
        phase: share of a period by which its deadlines follow the common grid.
    """

    phase: ClassVar[float] = 0.0

    def __init__(self, node: Host, parameters: P) -> None:
        super().__init__(node, parameters)
        self.clock: PeriodClock | None = None
        self.backlog = Backlog()

    def begin(self, now_ns: int) -> None:
        """Start the grid of deadlines: the next one common to all, or in lockstep right now."""
        if self.lockstep:
            self.clock = PeriodClock(self.period_ns, now_ns)
        else:
            self.clock = PeriodClock.on_grid(self.period_s, self.phase, now_ns)

    def act(self, now_ns: int) -> None:
        """Tick if a deadline has come; in lockstep, as often as clock and inputs allow."""
        clock = self.clock
        if clock is None:
            return
        if not self.lockstep:
            periods = clock.due(now_ns)
            if periods:
                self.tick(periods, clock.last_deadline_ns)
            return
        while clock.next_ns <= now_ns and self.ready(clock.next_ns):
            clock.due(clock.next_ns)
            self.tick(1, clock.last_deadline_ns)

    @property
    def period_ns(self) -> int:
        """Control period of the scene, ns."""
        return nanoseconds(self.period_s)

    def answered_ns(self, deadline_ns: int) -> int:
        """Return the sample whose answer acts, in lockstep, over the period before a deadline."""
        return deadline_ns - 2 * self.period_ns

    def ready(self, deadline_ns: int) -> bool:
        """Return whether all that a tick in lockstep needs is there."""
        raise NotImplementedError

    def tick(self, periods: int, deadline_ns: int) -> None:
        """Act on a deadline; ``periods`` is 1, or more after missed deadlines."""
        raise NotImplementedError

    def clock_figures(self) -> dict[str, str]:
        """Return what diagnostics say of deadlines."""
        clock = self.clock
        periods, missed = (clock.periods, clock.missed) if clock else (0, 0)
        share = (periods - missed) / periods if periods else 1.0
        return {
            "periods": str(periods),
            "missed_deadlines": str(missed),
            "dropped_periods": str(self.backlog.dropped),
            "achieved_rate_hz": f"{share / self.period_s:.1f}",
        }
