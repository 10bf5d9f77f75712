# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a node does, without its lifecycle: an actor is made on configure and dropped on cleanup.

An actor is a thin shell around core objects of one scene. Its host, a node (:class:`Host`),
provides topics, time and parameters.

An exception in a callback or tick never ends the process and leaves no force applied: it is logged,
and the actor is reset to its last valid state, at rest, so that the graph recovers by itself. A
HapticMechError, such as for a state that is not finite, may recur as often as its cause does. Any
other exception is a defect of the program; an actor with repeated defects is deactivated.
"""

from __future__ import annotations

import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from geometry_msgs.msg import WrenchStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.control.loop_delay import jitter_allowance
from hapticmech_ros.errors import HapticMechError, InvalidInputError, OutputError, shown
from hapticmech_ros.loading import load_scene
from hapticmech_ros.nodes.exchange import Exchange, Outlet
from hapticmech_ros.nodes.lane import Waits
from hapticmech_ros.nodes.messages import (
    CONTROL_SUBSCRIBER,
    LOCKSTEP,
    STREAM_PUBLISHER,
    check_in_world,
    checked_time,
    deserialized,
)
from hapticmech_ros.nodes.node_time import Backlog, DurationHistogram, PeriodClock
from hapticmech_ros.nodes.parameters import NodeParameters
from hapticmech_ros.nodes.sources import MIDDLEWARE, Info, Listener, Origin, Sources, WithInfo
from hapticmech_ros.nodes.timeouts import OwnPauses
from hapticmech_ros.nodes.turn import FOR_EVER
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import NANOSECONDS, nanoseconds
from hapticmech_ros.scene.rules import check_limits
from hapticmech_ros.wire.bounds import wrench_bounds
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.stamped import seconds_of
from hapticmech_ros.wire.topics import Topic
from hapticmech_ros.wire.wrench import decode_wrench

E = TypeVar("E")


class Host(Protocol):
    """A ROS node that keeps its actor's publishers and subscriptions, and drops them on cleanup.

    The members of an rclpy node have type Any, as rclpy declares no types.

    Attributes:
        active: whether the actor acts.
        exchange: the node's messages, over the lane and by the middleware.
        pauses: of its loop.
    """

    active: bool
    exchange: Exchange
    pauses: OwnPauses

    @property
    def create_publisher(self) -> Any:
        """As of an rclpy node."""

    @property
    def create_subscription(self) -> Any:
        """As of an rclpy node."""

    @property
    def create_service(self) -> Any:
        """As of an rclpy node."""

    @property
    def create_client(self) -> Any:
        """As of an rclpy node."""

    @property
    def destroy_subscription(self) -> Any:
        """As of an rclpy node."""

    @property
    def resolve_topic_name(self) -> Any:
        """As of an rclpy node."""

    @property
    def get_topic_names_and_types(self) -> Any:
        """As of an rclpy node."""

    @property
    def count_publishers(self) -> Any:
        """As of an rclpy node."""

    @property
    def get_publishers_info_by_topic(self) -> Any:
        """As of an rclpy node."""

    @property
    def get_logger(self) -> Any:
        """As of an rclpy node."""

    def look_at_clock(self) -> None:
        """Check whether the machine's clock was set; if so, restart the actor."""

    def now_ns(self) -> int:
        """Return the node's time, ns."""

    def keep(self, entity: E) -> E:
        """Keep a publisher, subscription or service until cleanup, and return it."""

    def drop(self, entity: object) -> None:
        """Destroy a kept entity."""

    def lane_kind(self, message_type: Any) -> str:
        """Return a message type's name on the lane; empty: the type does not use the lane."""

    def hand_over(
        self, topic: str, message_type: Any, listener: Listener
    ) -> Callable[[bytes], bool]:
        """Subscribe a listener to a topic on the lane until cleanup.

        Returns:
            A function that returns whether the middleware's message is a copy of one received over
            the lane.
        """

    def every(
        self, period_s: float, callback: Callable[[], None], is_due: Callable[[], bool]
    ) -> None:
        """Call back at a period of the machine's clock when ``is_due``; see ``ManagedNode``."""

    def begin(self) -> None:
        """Activate if configured and inactive."""

    def end(self) -> None:
        """Deactivate if active."""

    def refuse(self, topic: str, error: HapticMechError) -> None:
        """Count a message that breaks a rule, and log it at a limited rate."""


# The node deactivates itself after this many defects within this time, ns.
MOST_DEFECTS, DEFECTS_WITHIN_NS = 20, 10 * NANOSECONDS
# Least time between two logged failures of one callback, ns; all of them are counted.
LOG_PERIOD_NS = NANOSECONDS

Status = tuple[bool, str, dict[str, str]]
# Of SetBool and Trigger.
Response = TypeVar("Response", bound="Told")


class Told(Protocol):
    """A service's response.

    Attributes:
        success: whether the request was carried out.
        message: the result in a sentence.
    """

    success: bool
    message: str


class Failures:
    """Runs an actor's callbacks and ticks, and counts those that fail.

    Args:
        node: that hosts the actor.
        reset: resets the actor to its last valid state, at rest, without forces.

    Attributes:
        count, defects: number of failures so far, and of unexpected ones among them.
        last: the last failure: what failed, and the error.
    """

    def __init__(self, node: Host, reset: Callable[[], None]) -> None:
        self._node = node
        self._reset = reset
        self.count = 0
        self.last = ""
        self.defects = 0
        self._lately: deque[int] = deque(maxlen=MOST_DEFECTS)
        self._logged: dict[str, int] = {}

    def run(self, what: str, call: Callable[..., object], *arguments: object) -> None:
        """Call a function; an exception is logged under the name ``what``, and resets the actor."""
        try:
            call(*arguments)
        except Exception as error:  # noqa: BLE001 - a hand is held: no error may stop what stops it
            self.met(what, error)

    def answer(
        self, what: str, call: Callable[[], object], response: Response, done: str
    ) -> Response:
        """Call a function for a service, and return the response, with the reason if not done.

        Args:
            what: name of the service.
            call: carries out the request, or refuses it with a HapticMechError.
            response: to fill.
            done: message of a request carried out.
        """
        before = self.count
        refusals: list[str] = []

        def called() -> None:
            try:
                call()
            except OutputError:
                raise  # a failure of this node, not a refusal
            except HapticMechError as error:
                refusals.append(str(error))

        self.run(what, called)
        if self.count > before:
            refusals.append(self.last)
        response.success = not refusals
        response.message = refusals[0] if refusals else done
        return response

    def status(self, ask: Callable[[], Status]) -> Status:
        """Return an actor's status with its failures; if ``ask`` raises, that failure."""
        statuses: list[Status] = []
        self.run("status", lambda: statuses.append(ask()))
        well, sentence, figures = statuses[0] if statuses else (False, self.last, {})
        return well, sentence, {**figures, "failures": str(self.count), "last_failure": self.last}

    def met(self, what: str, error: Exception) -> None:
        """Log an error, then reset the actor or, after repeated defects, deactivate its node."""
        self.count += 1
        self.last = f"{what}: {_sentence(error)}"
        now = time.monotonic_ns()
        last = self._logged.get(what)
        if last is None or now - last > LOG_PERIOD_NS:
            self._logged[what] = now
            self._node.get_logger().error(
                f"error in {self.last}: forces are zero, this node restarts at rest from its last "
                "valid state"
            )
        if isinstance(error, HapticMechError):
            self._begin_anew()
            return
        self.defects += 1
        self._lately.append(now)
        full = len(self._lately) == MOST_DEFECTS
        if full and now - self._lately[0] <= DEFECTS_WITHIN_NS:
            self._give_up()
        else:
            self._begin_anew()

    def _begin_anew(self) -> None:
        try:
            self._reset()
        except Exception as error:  # noqa: BLE001 - as in run(): what cannot begin anew must end
            self.last = f"cannot begin anew: {_sentence(error)}"
            self._give_up()

    def _give_up(self) -> None:
        """Deactivate the node, even if its own deactivation raises."""
        self._lately.clear()
        self._node.get_logger().fatal(
            f"this node deactivates itself after repeated errors; last error: {self.last}"
        )
        try:
            self._node.end()
        except Exception as error:  # noqa: BLE001 - as in run(): it does nothing more either way
            self._node.get_logger().fatal(f"cannot be deactivated: {_sentence(error)}")
        self._node.active = False


def _sentence(error: Exception) -> str:
    """Return an error's message; for a defect with its type, file and line."""
    if isinstance(error, HapticMechError):
        return str(error)
    frames = traceback.extract_tb(error.__traceback__)
    where = f" ({frames[-1].filename.rpartition('/')[2]}:{frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {shown(str(error))}{where}"


T = TypeVar("T")
# An actor that fails again within this time, s, goes back to its start state.
CALM_S = 0.25
# An actor that failed publishes nothing for this long, ns, so that others detect its loss.
SILENCE_NS = NANOSECONDS // 2


class LastValidState(Generic[T]):
    """An actor's last valid state, and its start state for when the last valid one fails too.

    Args:
        start: the start state.
        period_s: between two ticks, s.

    Attributes:
        resting: whether the actor is silent now, after a failure.
    """

    def __init__(self, start: T, period_s: float) -> None:
        self._start = self._good = start
        self._since = self._calm = max(1, round(CALM_S / period_s))
        self._until_ns = 0
        self.resting = False

    def keep(self, state: T, ticks: int = 1) -> None:
        """Keep a published state as the last valid one, ``ticks`` ticks after the one before."""
        self._good = state
        self._since += ticks

    def go_back(self, now_ns: int) -> T:
        """Return the last valid state, or the start after less than CALM_S; begin a silence."""
        if self._since < self._calm:
            self._good = self._start
        self._since = 0
        self._until_ns, self.resting = now_ns + SILENCE_NS, True
        return self._good

    def rests(self, now_ns: int, begin: Callable[[], None]) -> bool:
        """Return whether the actor is silent at a time, ns; call ``begin`` once that is over.

        Activation then discards messages received meanwhile.
        """
        # A clock set back meanwhile does not prolong the silence.
        if self.resting and not self._until_ns - SILENCE_NS <= now_ns < self._until_ns:
            self.resting = False
            begin()
        return self.resting


M = TypeVar("M")
P = TypeVar("P", bound=NodeParameters)


def always(now_ns: int) -> bool:
    """Return True: every message is wanted."""
    return True


class Actor(Generic[P]):
    """The function of a configured node.

    Attributes:
        name: of the node, and of the executable.
        longest_wait_ns: longest wait for messages while active, ns, of an actor without deadlines
            that detects its own pauses; else 0.
        parameters: the current ones; replaced as a whole between two callbacks.
        scene, point: the scene of one user, and the operational point held.
        shared_scene: the scene with all its ``hands``.
        ages: of messages on arrival.
        failures: of its callbacks and ticks.
        limits, wrenches: bounds of numbers in messages, and those of wrenches.
    """

    name: ClassVar[str]
    parameters_type: ClassVar[type[NodeParameters]]
    longest_wait_ns: ClassVar[int] = 0

    def __init__(self, node: Host, parameters: P) -> None:
        self.node = node
        self.failures = Failures(node, self.reset)
        # Refuse at once a time that no stamp can hold.
        seconds_of(node.now_ns())
        scene = load_scene(parameters.scene, parameters.control_rate, parameters.network_delay)
        self.point = scene.operational_point(
            parameters.operational_point or scene.held_points[0]
        ).name
        self.shared_scene, self.scene = scene, scene.held_at(self.point)
        check_limits(self.scene)
        self.lockstep = parameters.lockstep
        self.control_input: QoSProfile = LOCKSTEP if self.lockstep else CONTROL_SUBSCRIBER
        self.output_qos: QoSProfile = LOCKSTEP if self.lockstep else STREAM_PUBLISHER
        self.limits = self.scene.limits
        self.wrenches = wrench_bounds(self.limits)
        self.ages = DurationHistogram()
        self.durations = {"message_age": self.ages}
        self._outlets: dict[str, Outlet] = {}
        # Not a subclass's: what that applies parameters to is made after this.
        Actor.apply_parameters(self, parameters)

    @property
    def other_points(self) -> list[str]:
        """Operational points of the scene other than this actor's."""
        points = self.shared_scene.operational_points
        return [point.name for point in points if point.name != self.point]

    def apply_parameters(self, parameters: P) -> None:
        """Replace all parameters at once."""
        self.parameters = parameters
        self.view_every = max(1, round(1.0 / (parameters.view_rate * self.period_s)))
        # Answers are older by the round trip over the network.
        there_and_back = 2.0 * self.scene.connection.latest
        limit_ns = nanoseconds(parameters.message_age_limit + there_and_back)
        # In lockstep a sample may arrive before the clock message of its time.
        self.age_limit_ns = FOR_EVER if self.lockstep else limit_ns

    def silence_ns(self, timeout: float) -> int:
        """Return a timeout (s) in ns, plus the allowance for a declared network's jitter."""
        return nanoseconds(timeout + jitter_allowance(self.scene.connection))

    def validate_parameters(self, parameters: P) -> None:
        """Raise a HapticMechError for new parameters that do not fit the scene."""

    def refuse_in_lockstep(self, what: str, given: object, verb: str = "change") -> None:
        """Refuse what would make a run in lockstep another one.

        Args:
            what: its name.
            given: for it.
            verb: what it cannot do, in words.

        Raises:
            InvalidInputError: in lockstep.
        """
        if self.lockstep:
            raise InvalidInputError(what, given, f"cannot {verb} in lockstep, whose runs repeat")

    def activate(self) -> None:
        """Begin to act; messages received before are discarded."""

    def deactivate(self) -> None:
        """Stop acting, and leave no force applied."""

    def close(self) -> None:
        """Release resources other than ROS's, at the end of the actor's use."""

    def reset(self) -> None:
        """Return after a failure to the last valid state, at rest, and leave no force applied.

        Does not send what may have failed; messages received before are discarded.
        """
        self.activate()

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return for diagnostics whether all is well, a sentence, and figures by name."""
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
        """Return the outlet of a topic of :mod:`~hapticmech_ros.wire.topics`."""
        name = topic.of(point or self.point)
        return self.output_named(name, message_type, qos or self.output_qos)

    def view(self, topic: Topic, message_type: Any, point: str = "") -> Outlet:
        """Return the outlet of a topic outside the control loop, sent when the loop has time."""
        name = topic.of(point or self.point)
        return self.output_named(name, message_type, self.output_qos, later=True)

    def output_named(
        self, name: str, message_type: Any, qos: QoSProfile, later: bool = False
    ) -> Outlet:
        """Return the outlet of a topic of any name."""
        publisher = self.node.keep(self.node.create_publisher(message_type, name, qos))
        stays = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
        kind = self.node.lane_kind(message_type)
        made = self.node.exchange.outlet(publisher, publisher.topic_name, stays, kind, later)
        if kind and not (stays or later):
            self._outlets[publisher.topic_name] = made
        return made

    def ways(self) -> dict[str, str]:
        """Return for diagnostics how each topic of the control rate is sent: lane, middleware."""
        return {f"transport of {topic}": found.ways() for topic, found in self._outlets.items()}

    def lane_topic(self, name: str, message_type: Any) -> str:
        """Return a topic's full name and type on the lane; empty if it does not use the lane."""
        kind = self.node.lane_kind(message_type)
        return f"{self.node.resolve_topic_name(name)} {kind}" if kind else ""

    def wait_by(self, waits: Waits | None) -> None:
        """Set what waits for the lane's sockets; None: ``select`` does."""
        if self.node.exchange.lane is not None:
            self.node.exchange.lane.wait = waits

    def sources(self, name: str) -> Sources:
        """Return a check that a topic has one publisher only; pass it to the topic's input."""
        return Sources(self.node, self.node.resolve_topic_name(name))

    def input(
        self,
        name: str,
        message_type: type[M],
        qos: QoSProfile,
        accept: Callable[[M, int], None],
    ) -> Subscription:
        """Subscribe; a message that ``accept`` refuses with InvalidInputError is counted.

        ``accept`` is called with a message and the time of arrival, ns. The topic is received by
        the middleware only.

        Returns:
            The subscription.
        """

        def read(message: bytes, now_ns: int) -> None:
            accept(deserialized(message, message_type), now_ns)

        # As bytes: one that cannot be deserialized is refused here and counted like all others.
        callback = self.guarded(name, read)
        create = self.node.create_subscription
        made: Subscription = create(message_type, name, callback, qos, raw=True)
        return self.node.keep(made)

    def input_stream(
        self,
        name: str,
        message_type: type[M],
        qos: QoSProfile,
        accept: Callable[[M, int], None],
        sources: Sources,
        wanted: Callable[[int], bool] = always,
    ) -> None:
        """Subscribe to a topic of the control rate, over the lane and by the middleware.

        A message that ``accept`` refuses with InvalidInputError is counted. Messages are not
        deserialized when ``wanted`` returns False.

        Args:
            name: of the topic.
            message_type: of its messages.
            qos: of the subscription.
            accept: called with a message and the time of arrival, ns.
            sources: receives each message's origin before ``accept`` is called.
            wanted: returns whether messages are wanted at a time, ns.
        """

        def read(message: bytes, now_ns: int) -> None:
            if wanted(now_ns):
                accept(deserialized(message, message_type), now_ns)

        self._input_raw(name, message_type, qos, read, sources)

    def input_array(
        self,
        name: str,
        qos: QoSProfile,
        accept: Callable[[Array, int], None],
        fields: Mapping[str, int],
        sources: Sources | None = None,
    ) -> None:
        """Subscribe to a Float64MultiArray's data, read from the serialized message.

        Decoding is fastest for messages with ``fields``; others are passed to ``accept`` as well.

        Args:
            name: of the topic.
            qos: of the subscription.
            accept: called with data (n,) and the time of arrival, ns.
            fields: of the message.
            sources: receives each message's origin before ``accept`` is called.
        """
        decode = FlatArray(fields).decode

        def read(message: bytes, now_ns: int) -> None:
            accept(decode(message), now_ns)

        self._input_raw(name, Float64MultiArray, qos, read, sources)

    def input_command(
        self,
        name: str,
        qos: QoSProfile,
        accept: Callable[[Array, int, int], None],
        unstamped_is_now: bool = True,
        sources: Sources | None = None,
    ) -> None:
        """Subscribe to wrenches in ``world``, read from the serialized message.

        As in CRTK, a command's header may be empty: it then stands for now, and for ``world``.

        Args:
            name: of the topic.
            qos: of the subscription.
            accept: called with a valid wrench (6,), N and N m, its stamp and the time of arrival,
                ns.
            unstamped_is_now: whether a zero stamp stands for the time of arrival.
            sources: receives each message's origin before ``accept`` is called.
        """

        def read(message: bytes, now_ns: int) -> None:
            found = decode_wrench(message, self.wrenches)
            check_in_world(found.frame)
            limit = self.age_limit_ns
            stamp = checked_time(found.stamp_ns, now_ns, limit, unstamped_is_now)
            accept(found.values, stamp, now_ns)

        self._input_raw(name, WrenchStamped, qos, read, sources)

    def guarded(self, name: str, accept: Callable[[M, int], None]) -> Callable[[M], None]:
        """Return a callback that passes messages to ``accept`` while active, and counts refusals.

        Any error other than InvalidInputError is a failure; see :class:`Failures`.
        """

        def accepted(message: M) -> None:
            try:
                accept(message, self.now_ns())
            except InvalidInputError as error:
                self.node.refuse(name, error)

        def callback(message: M) -> None:
            if not self.node.active:
                return
            self.node.look_at_clock()
            self.failures.run(name, accepted, message)
            self.node.exchange.deliver()

        return callback

    def _input_raw(
        self,
        name: str,
        message_type: Any,
        qos: QoSProfile,
        read: Callable[[bytes, int], None],
        sources: Sources | None = None,
    ) -> None:
        """Subscribe to a topic's serialized messages, over the lane and by the middleware."""
        node, watched = self.node, sources or self.sources(name)
        callback = self.guarded(name, read)

        def receive(message: bytes, origin: Origin) -> None:
            watched.received(origin, self.now_ns())
            callback(message)

        # In lockstep by the middleware only: late messages there are waited for, not dropped.
        had = None
        if not self.lockstep:
            had = node.hand_over(node.resolve_topic_name(name), message_type, receive)

        def receive_from_middleware(message: bytes, info: Info) -> None:
            number = info["publication_sequence_number"]
            if had is not None and had(message):
                watched.copied(number, self.now_ns())
                return
            receive(message, Origin(MIDDLEWARE, number, sent_ns=info.get("source_timestamp", 0)))

        given = WithInfo(receive_from_middleware)
        node.keep(node.create_subscription(message_type, name, given, qos, raw=True))


class ClockedActor(Actor[P]):
    """An actor that acts on deadlines as well as on messages.

    Attributes:
        clock: its deadlines; started on activation.
        backlog: periods passed for which no step has been made yet.
        phase: offset of its deadlines from the common grid, as a share of a period.
    """

    phase: ClassVar[float] = 0.0

    def __init__(self, node: Host, parameters: P) -> None:
        super().__init__(node, parameters)
        self.clock: PeriodClock | None = None
        self.backlog = Backlog()

    def begin(self, now_ns: int) -> None:
        """Start the deadlines: on the grid common to all nodes, or in lockstep at ``now_ns``."""
        if self.lockstep:
            self.clock = PeriodClock(self.period_ns, now_ns)
        else:
            self.clock = PeriodClock.on_grid(self.period_s, self.phase, now_ns)

    def act(self, now_ns: int) -> None:
        """Tick if a deadline has passed; in lockstep, as often as clock and inputs allow."""
        clock = self.clock
        if clock is None:
            return
        if not self.lockstep:
            periods = clock.due(now_ns)
            if periods:
                self.failures.run("tick", self.tick, periods, clock.last_deadline_ns)
            return
        while clock.next_ns <= now_ns and self.ready(clock.next_ns):
            clock.due(clock.next_ns)
            self.failures.run("tick", self.tick, 1, clock.last_deadline_ns)

    def steps(self, periods: int, deadline_ns: int) -> Iterator[tuple[int, int]]:
        """Yield two times (ns) for each step, which select the command that acts over it.

        The command must have arrived by the first, just before the step begins, as with a driver
        that reads and writes once per period. It must be valid until the second: the step's end, or
        now for the last step.
        """
        now = deadline_ns if self.lockstep else max(deadline_ns, self.now_ns())
        steps = self.backlog.steps(periods)
        for lag in reversed(range(self.backlog.owed, self.backlog.owed + steps)):
            end = deadline_ns - lag * self.period_ns
            yield end - self.period_ns - 1, end if lag else now

    @property
    def period_ns(self) -> int:
        """Control period of the scene, ns."""
        return nanoseconds(self.period_s)

    def answered_ns(self, deadline_ns: int) -> int:
        """Return the time (ns) of the sample whose answer acts, in lockstep, before a deadline."""
        return deadline_ns - 2 * self.period_ns

    def ready(self, deadline_ns: int) -> bool:
        """Return whether all inputs of a tick in lockstep have arrived."""
        raise NotImplementedError

    def tick(self, periods: int, deadline_ns: int) -> None:
        """Act on a deadline; ``periods`` is 1, or more after missed deadlines."""
        raise NotImplementedError

    def clock_figures(self) -> dict[str, str]:
        """Return the figures of deadlines for diagnostics."""
        clock = self.clock
        periods, missed = (clock.periods, clock.missed) if clock else (0, 0)
        share = (periods - missed) / periods if periods else 1.0
        return {
            "periods": str(periods),
            "missed_deadlines": str(missed),
            "dropped_periods": str(self.backlog.dropped),
            "achieved_rate_hz": f"{share / self.period_s:.1f}",
        }
