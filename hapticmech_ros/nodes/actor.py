# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the nodes do, apart from their life: an actor is made on configure and dropped on cleanup.

An actor is a thin shell around core objects of one scene. Its host (a
:class:`~hapticmech_ros.nodes.actor.Host`) lends it topics, time and parameters.

When a callback or a tick of its goes wrong it fails closed, says so and goes on. A failure never
ends the process, and nobody is left under a force. The actor is put back to where all was well, at
rest, and begins anew, so that the graph comes back by itself. What the package raises on purpose,
such as a state that is no longer finite, may come as often as its cause does; anything else is a
defect of the program, and an actor that keeps on meeting one is deactivated. What moves something
goes back to its last valid state.

What an actor may ask of the node that hosts it.
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
    """A ROS node that remembers what was made for its actor, and drops it on cleanup.

    What it has as an rclpy node has rclpy's types, which are none.

    Attributes:
        active: whether the actor acts.
        exchange: joins it with the other nodes of its user's on this host.
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
        """Begin anew if the machine's clock was set."""

    def now_ns(self) -> int:
        """Return the node's time, ns."""

    def keep(self, entity: E) -> E:
        """Remember a publisher, subscription or service until cleanup, and return it."""

    def drop(self, entity: object) -> None:
        """Destroy what is kept."""

    def lane_kind(self, message_type: Any) -> str:
        """Return what messages of a type are called on the lane; nothing: they do not go there."""

    def hand_over(
        self, topic: str, message_type: Any, listener: Listener
    ) -> Callable[[bytes], bool]:
        """Give a listener a topic's messages on this host until cleanup.

        Returns what tells of a message from the middleware whether it has been handed over.
        """

    def every(
        self, period_s: float, callback: Callable[[], None], is_due: Callable[[], bool]
    ) -> None:
        """Call back at a period of the machine's clock where that is due; see ``ManagedNode``."""

    def begin(self) -> None:
        """Activate if configured and inactive."""

    def end(self) -> None:
        """Deactivate if active."""

    def refuse(self, topic: str, error: HapticMechError) -> None:
        """Count a message that breaks a rule, and say so now and then."""


# So many defects within this time, and the node deactivates itself.
MOST_DEFECTS, DEFECTS_WITHIN_NS = 20, 10 * NANOSECONDS
# A failure of one callback is logged at most this often; all of them are counted.
LOG_PERIOD_NS = NANOSECONDS

Status = tuple[bool, str, dict[str, str]]
# As of SetBool and Trigger.
Response = TypeVar("Response", bound="Told")


class Told(Protocol):
    """A service's answer.

    Attributes:
        success: whether it was done.
        message: in a sentence.
    """

    success: bool
    message: str


class Failures:
    """Runs an actor's callbacks and ticks, and counts those that fail.

    Args:
        node: that hosts the actor.
        reset: puts the actor back to where all was well, at rest, with nobody under a force.

    Attributes:
        count, defects: failures so far, and unexpected ones among them.
        last: what failed last, and how.
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
        """Call; whatever goes wrong is said under the name ``what``, and the actor begins anew."""
        try:
            call(*arguments)
        except Exception as error:  # noqa: BLE001 - a hand is held: no error may stop what stops it
            self.met(what, error)

    def answer(
        self, what: str, call: Callable[[], object], response: Response, done: str
    ) -> Response:
        """Call for a service, and return its response: done, or why it was refused or failed.

        Args:
            what: the service.
            call: does it, or refuses with a HapticMechError.
            response: to fill.
            done: sentence if all went well.
        """
        before = self.count
        refusals: list[str] = []

        def called() -> None:
            try:
                call()
            except OutputError:
                raise  # a failure: something is wrong in here
            except HapticMechError as error:
                refusals.append(str(error))

        self.run(what, called)
        if self.count > before:
            refusals.append(self.last)
        response.success = not refusals
        response.message = refusals[0] if refusals else done
        return response

    def status(self, ask: Callable[[], Status]) -> Status:
        """Return an actor's status with what failed, be it that the status cannot be told."""
        statuses: list[Status] = []
        self.run("status", lambda: statuses.append(ask()))
        well, sentence, figures = statuses[0] if statuses else (False, self.last, {})
        return well, sentence, {**figures, "failures": str(self.count), "last_failure": self.last}

    def met(self, what: str, error: Exception) -> None:
        """Say what went wrong, and begin anew, or give up."""
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
        """Deactivate the node, whatever becomes of it meanwhile."""
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
    """Return what an error says; of a defect also what it is, and where it was."""
    if isinstance(error, HapticMechError):
        return str(error)
    frames = traceback.extract_tb(error.__traceback__)
    where = f" ({frames[-1].filename.rpartition('/')[2]}:{frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {shown(str(error))}{where}"


T = TypeVar("T")
# Who fails again so soon goes back to where it began, s.
CALM_S = 0.25
# How long one that failed is silent, so that everyone notices, before it goes on at rest.
SILENCE_NS = NANOSECONDS // 2


class LastValidState(Generic[T]):
    """The last state in which all was well, and the one to begin with where even that fails.

    Args:
        start: the state to begin with.
        period_s: between two ticks.

    Attributes:
        resting: whether it is silent now, after a failure.
    """

    def __init__(self, start: T, period_s: float) -> None:
        self._start = self._good = start
        self._since = self._calm = max(1, round(CALM_S / period_s))
        self._until_ns = 0
        self.resting = False

    def keep(self, state: T, ticks: int = 1) -> None:
        """Remember a state that was sent to others, and those before it: they kept every rule."""
        self._good = state
        self._since += ticks

    def go_back(self, now_ns: int) -> T:
        """Return the last state that was well; the start, if it was gone back to just now."""
        if self._since < self._calm:
            self._good = self._start
        self._since = 0
        self._until_ns, self.resting = now_ns + SILENCE_NS, True
        return self._good

    def rests(self, now_ns: int, begin: Callable[[], None]) -> bool:
        """Return whether it is silent at a time; call ``begin`` when that is over.

        What was heard meanwhile was for one that was not there, and counts no more.
        """
        # Time that was set back meanwhile prolongs nothing.
        if self.resting and not self._until_ns - SILENCE_NS <= now_ns < self._until_ns:
            self.resting = False
            begin()
        return self.resting


M = TypeVar("M")
P = TypeVar("P", bound=NodeParameters)


def always(now_ns: int) -> bool:
    """Return that every message is wanted."""
    return True


class Actor(Generic[P]):
    """One of the graph's parts, configured.

    Attributes:
        name: of the node, and of the executable.
        longest_wait_ns: for how long at most it waits for messages while active, ns, if it is to
            notice its own pauses and has no deadlines; else 0.
        parameters: as they stand; replaced as a whole between two callbacks.
        scene, point: what is modelled, as one user has it, and the operational point held.
        shared_scene: the scene with all its ``hands``.
        ages: of messages on arrival.
        failures: of its callbacks and ticks.
        limits, wrenches: how large numbers may be in messages, and those of wrenches.
    """

    name: ClassVar[str]
    parameters_type: ClassVar[type[NodeParameters]]
    longest_wait_ns: ClassVar[int] = 0

    def __init__(self, node: Host, parameters: P) -> None:
        self.node = node
        self.failures = Failures(node, self.reset)
        # Time that no stamp can hold is refused where it is first asked for.
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
        self.apply_parameters(parameters)

    @property
    def other_points(self) -> list[str]:
        """Operational points that other hands may hold."""
        points = self.shared_scene.operational_points
        return [point.name for point in points if point.name != self.point]

    def apply_parameters(self, parameters: P) -> None:
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

    def validate_parameters(self, parameters: P) -> None:
        """Refuse new parameters that this scene cannot have, by HapticMechError."""

    def activate(self) -> None:
        """Begin to act; what was heard before counts no more."""

    def deactivate(self) -> None:
        """Stop acting, and leave nobody under a force."""

    def close(self) -> None:
        """Give back what it has beside ROS: it is not used any more."""

    def reset(self) -> None:
        """Go back, after a failure, to where all was well, at rest, and leave nobody under a force.

        Does not send what may have failed; what was heard before counts no more.
        """
        self.activate()

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
        """Return what a topic of the table is published through."""
        name = topic.of(point or self.point)
        return self.output_named(name, message_type, qos or self.output_qos)

    def view(self, topic: Topic, message_type: Any, point: str = "") -> Outlet:
        """Return what a topic outside the control loop is published through, when there is time."""
        name = topic.of(point or self.point)
        return self.output_named(name, message_type, self.output_qos, later=True)

    def output_named(
        self, name: str, message_type: Any, qos: QoSProfile, later: bool = False
    ) -> Outlet:
        """Return what a topic of any name is published through."""
        publisher = self.node.keep(self.node.create_publisher(message_type, name, qos))
        stays = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
        kind = self.node.lane_kind(message_type)
        made = self.node.exchange.outlet(publisher, publisher.topic_name, stays, kind, later)
        if kind and not (stays or later):
            self._outlets[publisher.topic_name] = made
        return made

    def ways(self) -> dict[str, str]:
        """Return by which ways each topic of the control rate goes, for diagnostics."""
        return {f"transport of {topic}": found.ways() for topic, found in self._outlets.items()}

    def lane_topic(self, name: str, message_type: Any) -> str:
        """Return what a topic is called on the lane; empty if it does not go there."""
        kind = self.node.lane_kind(message_type)
        return f"{self.node.resolve_topic_name(name)} {kind}" if kind else ""

    def wait_by(self, waits: Waits | None) -> None:
        """Let the lane be waited for in another way."""
        if self.node.exchange.lane is not None:
            self.node.exchange.lane.wait = waits

    def sources(self, name: str) -> Sources:
        """Return what watches that one publisher speaks on a topic; an input is told of it."""
        return Sources(self.node, self.node.resolve_topic_name(name))

    def input(
        self,
        name: str,
        message_type: type[M],
        qos: QoSProfile,
        accept: Callable[[M, int], None],
    ) -> Subscription:
        """Subscribe; what ``accept(message, now_ns)`` refuses with InvalidInputError is counted.

        Such messages come through the middleware only.

        Returns:
            The subscription.
        """

        def read(message: bytes, now_ns: int) -> None:
            accept(deserialized(message, message_type), now_ns)

        # As bytes: what is no whole message is refused here, as all others are, and counted.
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
        """Subscribe to what may come at the control rate, whichever way it comes.

        What ``accept(message, now_ns)`` refuses with InvalidInputError is counted. Messages are not
        read where ``wanted(now_ns)`` is false.

        Args:
            name: of the topic.
            message_type: of its messages.
            qos: of the subscription.
            accept: called with a message and the time of arrival, ns.
            sources: told before whom each message comes from.
            wanted: whether messages are wanted at a time, ns.
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
        """Subscribe to a Float64MultiArray's data, read from the bytes on the wire.

        Messages are expected to have ``fields``; those that have not are handed on as well.
        ``sources`` is told before whom each message comes from.

        Args:
            name: of the topic.
            qos: of the subscription.
            accept: called with data (n,) and the time of arrival, ns.
            fields: of the message.
            sources: tells publishers apart.
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
        """Subscribe to wrenches in ``world``, read from the bytes on the wire.

        ``accept(wrench, stamp_ns, now_ns)`` gets those that keep the rules. As CRTK has it, a
        command's header may be left empty: it then stands for now, and for ``world``. ``sources``
        is told before whom each message comes from.

        Args:
            name: of the topic.
            qos: of the subscription.
            accept: called with a wrench (6,), N and N m, its stamp and the time of arrival, ns.
            unstamped_is_now: whether a zero stamp stands for the time of arrival.
            sources: tells publishers apart.
        """

        def read(message: bytes, now_ns: int) -> None:
            found = decode_wrench(message, self.wrenches)
            check_in_world(found.frame)
            limit = self.age_limit_ns
            stamp = checked_time(found.stamp_ns, now_ns, limit, unstamped_is_now)
            accept(found.values, stamp, now_ns)

        self._input_raw(name, WrenchStamped, qos, read, sources)

    def guarded(self, name: str, accept: Callable[[M, int], None]) -> Callable[[M], None]:
        """Return a callback that hands on messages while active, and counts those refused.

        What goes wrong otherwise is a failure: see :mod:`~hapticmech_ros.nodes.actor`.
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
        """Subscribe to a topic's bytes, whichever way they come."""
        node = self.node
        callback: Callable[..., None] = self.guarded(name, read)
        # In lockstep all goes one way: what is late there is waited for, not dropped.
        if not self.lockstep:
            callback = self._handed_over(name, message_type, callback, sources)
        elif sources is not None:
            callback = self._watched(sources, callback)
        node.keep(node.create_subscription(message_type, name, callback, qos, raw=True))

    def _handed_over(
        self,
        name: str,
        message_type: Any,
        callback: Callable[[bytes], None],
        sources: Sources | None,
    ) -> Callable[..., None]:
        """Hear a topic on this host, and return the callback for what the middleware brings."""

        def handed(message: bytes, origin: Origin) -> None:
            if sources is not None:
                sources.received(origin, self.now_ns())
            callback(message)

        had = self.node.hand_over(self.node.resolve_topic_name(name), message_type, handed)
        if sources is not None:
            return self._watched(sources, callback, had)

        def from_outside(message: bytes) -> None:
            if not had(message):
                callback(message)

        return from_outside

    def _watched(
        self,
        sources: Sources,
        callback: Callable[[M], None],
        had: Callable[[M], bool] = lambda message: False,
    ) -> WithInfo:
        """Return a callback that tells ``sources`` first whom a message comes from."""

        def receive(message: M, info: Info) -> None:
            number = info["publication_sequence_number"]
            if had(message):
                sources.copied(number, self.now_ns())
                return
            origin = Origin(MIDDLEWARE, number, sent_ns=info.get("source_timestamp", 0))
            sources.received(origin, self.now_ns())
            callback(message)

        return WithInfo(receive)


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
                self.failures.run("tick", self.tick, periods, clock.last_deadline_ns)
            return
        while clock.next_ns <= now_ns and self.ready(clock.next_ns):
            clock.due(clock.next_ns)
            self.failures.run("tick", self.tick, 1, clock.last_deadline_ns)

    def steps(self, periods: int, deadline_ns: int) -> Iterator[tuple[int, int]]:
        """Yield (ns) by when what acts over each step has come, and when it must not have run out.

        Before the step, as with a driver that reads and writes once in a period; its end, or now.
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
