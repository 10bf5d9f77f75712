# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The life of a node: configure, activate, deactivate, cleanup; parameters, time, diagnostics.

An actor is built on configure and dropped on cleanup. A node that starts by itself (``autostart``)
goes through both first steps at once.

Parameters are declared with descriptors, validated as a whole and applied as a whole. Their
callbacks and ticks take turns: a change comes between two ticks. Whole numbers are accepted
where numbers are wanted; setting a parameter to its present value is no change: a node accepts its
own ``ros2 param dump``.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import partial, wraps
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.clock import Clock, ClockType, JumpHandle, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter

from hapticmech_ros.errors import HapticMechError, as_ours
from hapticmech_ros.nodes.actor import Actor, ClockedActor
from hapticmech_ros.nodes.exchange import Exchange
from hapticmech_ros.nodes.loop import QuietEventsNode
from hapticmech_ros.nodes.messages import STREAM_PUBLISHER, set_stamp, wait_until_acknowledged
from hapticmech_ros.nodes.node_time import Backlog, NodeTime, clock_step_text, processor_time
from hapticmech_ros.nodes.parameters import (
    LOCK,
    NodeParameters,
    ParameterError,
    changes_of,
    choices_of,
    is_typed,
    locked_by,
    range_of,
    validated,
)
from hapticmech_ros.nodes.realtime import Realtime
from hapticmech_ros.nodes.sources import Listener
from hapticmech_ros.nodes.timeouts import OwnPauses
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.system.readiness import Report, send_report
from hapticmech_ros.wire.stamped import nearest_stamp
from hapticmech_ros.wire.topics import DIAGNOSTICS

SIM_TIME = "use_sim_time"


class HostedParameters:
    """The parameters of a model, on a node.

    Args:
        node: where they are declared.
        model: of the parameters, with their rules.
        configured: whether the actor is built from them: some can then no longer change.
        checked: called with parameters that keep the model's rules; may refuse by HapticMechError.
        adopted: called with the parameters before, after a change.

    Raises:
        ParameterError: a parameter given at the start breaks a rule.
    """

    def __init__(
        self,
        node: Node,
        model: type[NodeParameters],
        configured: Callable[[], bool],
        checked: Callable[[NodeParameters], None],
        adopted: Callable[[NodeParameters], None],
    ) -> None:
        self._node = node
        self._model = model
        self._configured = configured
        self._vetted = checked
        self._adopted = adopted
        overrides = node._parameter_overrides
        for name, given in overrides.items():
            overrides[name] = self._as_number(given)
        try:
            self.values = validated(model, {name: self._declare(name) for name in self._names})
        except ParameterError as error:
            raise ParameterError(f"{node.get_name()}: {error}") from None
        self._name_unknown()
        node.add_pre_set_parameters_callback(self._as_numbers)
        node.add_on_set_parameters_callback(self._vet)
        node.add_post_set_parameters_callback(self._adopt)

    @property
    def _names(self) -> list[str]:
        return list(self._model.model_fields)

    def _declare(self, name: str) -> object:
        default = self._model.model_fields[name].default
        try:
            descriptor = descriptor_of(self._model, name)
            return self._node.declare_parameter(name, default, descriptor).value
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            raise ParameterError(str(error)) from None

    def _as_number(self, given: Parameter) -> Parameter:
        """Return a parameter with a whole number as the number that is wanted there."""
        field = self._model.model_fields.get(given.name)
        if field is None or type(field.default) is not float or type(given.value) is not int:
            return given
        return Parameter(given.name, value=float(given.value))

    def _as_numbers(self, changes: list[Parameter]) -> list[Parameter]:
        return [self._as_number(given) for given in changes]

    def _is_new(self, given: Parameter) -> bool:
        """Return whether a parameter would be another than now."""
        if given.name == SIM_TIME:
            return bool(given.value != self._node.get_parameter(SIM_TIME).value)
        known = given.name in self._model.model_fields
        return not known or given.value != getattr(self.values, given.name)

    def _name_unknown(self) -> None:
        """Log unknown parameters given at the start: most often typing errors."""
        for name in self._node._parameter_overrides:
            if not self._node.has_parameter(name) and not name.startswith("qos_overrides"):
                known = ", ".join(self._names)
                self._node.get_logger().warning(
                    f"unknown parameter {name!r} is ignored; this node has: {known}"
                )

    def _proposed(self, changes: Sequence[Parameter]) -> NodeParameters:
        new = {p.name: p.value for p in changes if p.name in self._model.model_fields}
        return validated(self._model, {**self.values.model_dump(), **new})

    def _vet(self, changes: Sequence[Parameter]) -> SetParametersResult:
        # rclpy takes this for declared.
        if not all(p.name for p in changes):
            return SetParametersResult(successful=False, reason="'': must have a name")
        new = [p.name for p in changes if self._is_new(p)]
        locked = [name for name in new if locked_by(self.values, name)]
        if locked:
            reason = f"{', '.join(locked)}: stays as it is, since the node was started with {LOCK}"
            return SetParametersResult(successful=False, reason=reason)
        given = [name for name in new if self._changes(name) == "never"]
        if given:
            reason = f"{', '.join(given)}: can only be given at the start"
            return SetParametersResult(successful=False, reason=reason)
        fixed = [name for name in new if self._configured() and self._is_fixed(name)]
        if fixed:
            reason = f"{', '.join(fixed)}: can change only while the node is unconfigured"
            return SetParametersResult(successful=False, reason=reason)
        try:
            self._vetted(self._proposed(changes))
        except HapticMechError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _changes(self, name: str) -> str:
        """Return when a parameter may change; nothing: it is rclpy's own."""
        return changes_of(self._model, name) if name in self._model.model_fields else ""

    def _is_fixed(self, name: str) -> bool:
        return name == SIM_TIME or self._changes(name) == "unconfigured"

    def _adopt(self, changes: Sequence[Parameter]) -> None:
        before, self.values = self.values, self._proposed(changes)
        self._adopted(before)


def descriptor_of(model: type[NodeParameters], name: str) -> ParameterDescriptor:
    """Return a parameter's descriptor, for `ros2 param describe`."""
    changes = changes_of(model, name)
    rules = []
    if choices := choices_of(model, name):
        rules.append(f"one of {', '.join(choices)}")
    if changes == "unconfigured":
        rules.append("can change only while the node is unconfigured")
    elif changes == "never":
        # Not as read-only: rclpy refuses to set that to the value which it has.
        rules.append("can only be given at the start")
    bounds = range_of(model, name)
    whole = isinstance(model.model_fields[name].default, int)
    return ParameterDescriptor(
        description=model.model_fields[name].description or "",
        additional_constraints="; ".join(rules),
        dynamic_typing=not is_typed(model, name),
        floating_point_range=[FloatingPointRange(from_value=bounds[0], to_value=bounds[1])]
        if bounds and not whole
        else [],
        integer_range=[IntegerRange(from_value=int(bounds[0]), to_value=int(bounds[1]))]
        if bounds and whole
        else [],
    )


E = TypeVar("E")
# Largest advance of /clock that a clocked actor catches up with. More is a step.
CLOCK_STEP_NS = NANOSECONDS // 2
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class ManagedNode(QuietEventsNode, LifecycleNode):
    """A lifecycle node that hosts an actor.

    Args:
        actor_type: of the actor built on configure.
        exchange: of its messages.

    Attributes:
        actor: the node's work; None while unconfigured.
        active: whether the actor works.
        pauses: of its loop.
        refused: messages refused so far.
        in_sim_time: whether its time is /clock's.
        realtime: requests of its process to the system; None: none yet.
    """

    def __init__(self, actor_type: type[Actor[Any]], exchange: Exchange) -> None:
        self.exchange = exchange
        super().__init__(actor_type.name)
        # All that there are now, however they were made.
        for service in self.services:
            service.callback = self._settled(service.callback)
        self._actor_type = actor_type
        self._listeners: list[tuple[str, Listener, str]] = []
        self.pauses = OwnPauses(self._wait_ns)
        self._on_lane = False
        self.actor: Actor[Any] | None = None
        self.active = False
        self.in_sim_time = False
        self.realtime: Realtime | None = None
        self.failure: HapticMechError | None = None
        self.refused = 0
        self.last_refusal = ""
        self._kept: list[Any] = []
        self._jumps: JumpHandle | None = None
        self._time = NodeTime()
        self._looked_ns = self._time.now_ns()
        self._clock_steps, self._last_step = 0, ""
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._hosted = HostedParameters(
            self,
            actor_type.parameters_type,
            configured=lambda: self.actor is not None,
            checked=lambda parameters: (
                self.actor.validate_parameters(parameters) if self.actor else None
            ),
            adopted=self._adopt,
        )
        self._diagnostics = self.create_publisher(
            DiagnosticArray, DIAGNOSTICS.name, STREAM_PUBLISHER
        )
        self._start_diagnostics()

    def _settled(self, callback: Callable[..., Any], topic: str = "") -> Callable[..., Any]:
        """Return a callback that runs while no kernel runs, with the actor up to date.

        Args:
            callback: of a subscription, service or timer. After one of the latter two the node may
                have another deadline, or they are urgent.
            topic: full name and type, on the lane, of a subscription.
        """

        @wraps(callback)
        def settled(*arguments: Any) -> Any:
            if topic:
                first = arguments[0]
                message = first[0] if isinstance(first, tuple) else first
                if self.exchange.defer(partial(callback, *arguments), topic, message):
                    return None
            with self.exchange.taken(not topic):
                return callback(*arguments)

        return settled

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Callable[..., None], *args: Any, **kwargs: Any
    ) -> Any:
        """Create a subscription, as :meth:`rclpy.node.Node.create_subscription` does.

        Returns:
            The subscription.
        """
        name = f"{self.resolve_topic_name(topic)} {msg_type.__name__}"
        settled = self._settled(callback, name)
        return super().create_subscription(msg_type, topic, settled, *args, **kwargs)

    def create_service(
        self, srv_type: Any, srv_name: str, callback: Callable[..., Any], **kwargs: Any
    ) -> Any:
        """Create a service, as :meth:`rclpy.node.Node.create_service` does.

        Returns:
            The service.
        """
        return super().create_service(srv_type, srv_name, self._settled(callback), **kwargs)

    def create_timer(
        self, timer_period_sec: float, callback: Callable[..., Any], *args: Any, **kwargs: Any
    ) -> Any:
        """Create a timer, as :meth:`rclpy.node.Node.create_timer` does.

        Returns:
            The timer.
        """
        return super().create_timer(timer_period_sec, self._settled(callback), *args, **kwargs)

    @property
    def parameters(self) -> NodeParameters:
        """Parameters as they stand."""
        return self._hosted.values

    def start(self) -> None:
        """Configure and activate, unless that is left to others.

        Raises:
            HapticMechError: the node cannot be configured.
        """
        if not self.parameters.autostart:
            return
        if self.trigger_configure() is SUCCESS:
            self.trigger_activate()
        if self.failure is not None:
            raise self.failure

    def next_deadline_ns(self) -> int | None:
        """Return when the node wants to go on by its own time; None: never, or by /clock."""
        actor = self.actor
        if actor is None or not self.active or self.in_sim_time:
            return None
        if isinstance(actor, ClockedActor):
            return None if actor.clock is None else actor.clock.next_ns
        return self._looked_ns + actor.longest_wait_ns if actor.longest_wait_ns else None

    def act(self, now_ns: int) -> None:
        """Let a clocked actor act."""
        if self.active and isinstance(self.actor, ClockedActor):
            self.actor.act(now_ns)
            self.exchange.deliver()

    def now_ns(self) -> int:
        """Return the node's time, ns."""
        if self.in_sim_time:
            return int(self.get_clock().now().nanoseconds)
        # The same as ROS's clock, without its objects: called for every message.
        return self._time.now_ns()

    def look_at_clock(self) -> None:
        """Begin anew if the machine's clock was set; called for every message and deadline."""
        self.pauses.look()
        self._looked_ns = self._time.now_ns()
        step = self._time.step_ns()
        if step and not self.in_sim_time:
            self._begin_anew(f"the machine's {clock_step_text(step)}")

    def keep(self, entity: E) -> E:
        """Remember a publisher, subscription or service until cleanup, and return it."""
        self._kept.append(entity)
        return entity

    def drop(self, entity: object) -> None:
        """Destroy an entity of :meth:`keep`."""
        self._kept.remove(entity)
        self._destroy(entity)

    def lane_kind(self, message_type: Any) -> str:
        """Return a type's name on the lane; empty: its messages do not go there."""
        return message_type.__name__ if self._on_lane else ""

    def hand_over(
        self, topic: str, message_type: Any, listener: Listener
    ) -> Callable[[bytes], bool]:
        """Give a listener a topic's messages on this host until cleanup.

        Returns:
            Whether a message was handed over already; for subscriptions.
        """
        kind = self.lane_kind(message_type)
        self._listeners.append((topic, listener, kind))
        return self.exchange.listen(topic, listener, kind)

    def every(
        self, period_s: float, callback: Callable[[], None], is_due: Callable[[], bool]
    ) -> None:
        """Call back at a period of the machine's clock while the node is active, until cleanup.

        Args:
            period_s: s.
            callback: called where it is due, while no kernel runs.
            is_due: asked first, while the node's loop goes on.
        """
        call = self._settled(callback)

        def when_active() -> None:
            if self.active and is_due():
                call()

        self.keep(super().create_timer(period_s, when_active, clock=self._steady))

    def refuse(self, topic: str, error: HapticMechError) -> None:
        """Count a message that breaks a rule, and log that now and then."""
        self.refused += 1
        self.last_refusal = f"{topic}: {error}"
        super().refuse(topic, error)

    def report_status(self, last: bool = False) -> None:
        """Send the node's state to the parent process."""
        send_report(Report(self.get_fully_qualified_name(), *self._status(), last))

    def final_report(self) -> str:
        """Return the text printed when the node ends."""
        _, sentence, figures = self._status()
        shown = ", ".join(f"{key} {value}" for key, value in figures.items())
        return f"{self.get_name()}: {sentence}; {shown}"

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Build the actor from scene and parameters.

        Returns:
            Whether it succeeded.
        """
        del state
        self.failure = None
        self._look_for_clock()
        try:
            if self.parameters.lockstep and not self.in_sim_time:
                raise ParameterError("lockstep: needs use_sim_time:=true (got false)")
            self._join_lane()
            self.actor = self._actor_type(self, self.parameters)
        except Exception as error:  # noqa: BLE001 - the middleware's too: a name may be too long
            self.failure = as_ours(error)
            self.get_logger().error(f"cannot be configured: {self.failure}")
            self._release()
            return FAILURE
        return SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to act, by the machine's clock or by /clock.

        Returns:
            Whether it succeeded.
        """
        actor = self.actor
        if actor is None:
            return FAILURE
        self._look_for_clock()
        self._activate(actor)
        if self.in_sim_time:
            self._follow_clock()
        self.active = True
        return super().on_activate(state)

    def _activate(self, actor: Actor[Any]) -> None:
        actor.activate()
        if isinstance(actor, ClockedActor):
            actor.backlog = Backlog()
            if self.in_sim_time:
                # /clock does not wait for late nodes: a step's periods are due all at once.
                actor.backlog.per_tick = actor.backlog.limit
                actor.clock = None
            else:
                actor.begin(self.now_ns())

    def _begin_anew(self, reason: str) -> None:
        """Put forces at zero, forget received messages, and act again from now on."""
        actor = self.actor
        if actor is None or not self.active:
            return
        self.exchange.settle()
        self._clock_steps += 1
        self._last_step = reason
        self.get_logger().warning(f"{reason}: forces are zero, this node starts anew")
        # Each separately, as either may fail: stamps may not be able to represent the time now.
        actor.failures.run("clock", actor.deactivate)
        actor.failures.run("clock", self._activate, actor)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop acting; devices are left without force.

        Returns:
            Whether it succeeded.
        """
        self._stop()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Drop the actor and all its topics.

        Returns:
            Whether it succeeded.
        """
        del state
        self._release()
        return SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End, from any state.

        Returns:
            Whether it succeeded.
        """
        del state
        self._stop()
        self._release()
        return SUCCESS

    def begin(self) -> None:
        """Activate if configured and inactive."""
        if self.actor is not None and not self.active:
            self.trigger_activate()

    def end(self) -> None:
        """Deactivate if active; what remains is destroyed with the node."""
        if self.active:
            self.trigger_deactivate()

    def destroy_node(self) -> None:
        """End, with all that the actor has beside ROS."""
        actor, self.actor = self.actor, None
        if actor is not None:
            actor.close()
        super().destroy_node()

    def acknowledged(self) -> None:
        """Wait until subscribers have this node's last messages, if it is not active."""
        if not self.active:
            wait_until_acknowledged(self._kept)

    def _stop(self) -> None:
        if self.active and self.actor is not None:
            self.actor.failures.run("deactivation", self.actor.deactivate)
            # The last messages command zero; their publishers may be gone soon.
            self.exchange.publish_kept()
        self.active = False
        if self._jumps is not None:
            self._jumps.unregister()
            self._jumps = None

    def _release(self) -> None:
        self.acknowledged()
        for topic, listener, kind in self._listeners:
            self.exchange.silence(topic, listener, kind)
        self._listeners.clear()
        for entity in self._kept:
            self._destroy(entity)
        self._kept.clear()
        if self.actor is not None:
            self.actor.close()
        self.actor = None

    def _destroy(self, entity: Any) -> None:
        for destroy in (
            self.destroy_publisher,
            self.destroy_subscription,
            self.destroy_service,
            self.destroy_client,
            self.destroy_timer,
        ):
            if destroy(entity):
                return

    def _wait_ns(self) -> int | None:
        """Return how long the node would still wait; less than nothing: it is late."""
        deadline = self.next_deadline_ns()
        # A kernel that keeps deadlines is further than is known here.
        kept = isinstance(self.actor, ClockedActor) and not self.exchange.settled
        return None if deadline is None or kept else deadline - self.now_ns()

    def _look_for_clock(self) -> None:
        """Store whether time is /clock's: once, since now_ns() is called often."""
        self.in_sim_time = bool(self.get_parameter("use_sim_time").value)

    def _join_lane(self) -> None:
        """Exchange messages with other processes of this host directly, where that is allowed.

        Nodes that follow /clock keep no pace.
        """
        self._on_lane = self.parameters.transport == "auto" and not self.in_sim_time
        if self._on_lane:
            self.exchange.join_lane(os.environ)
            self._on_lane = self.exchange.lane is not None

    def _follow_clock(self) -> None:
        clocked = isinstance(self.actor, ClockedActor)
        forward = Duration(nanoseconds=1 if clocked else CLOCK_STEP_NS)
        threshold = JumpThreshold(
            min_forward=forward, min_backward=Duration(nanoseconds=-1), on_clock_change=False
        )
        self._jumps = self.get_clock().create_jump_callback(threshold, post_callback=self._jumped)

    def _jumped(self, jump: TimeJump) -> None:
        """Act at the time that /clock has just published; begin anew when it was set."""
        now, step = self.now_ns(), int(jump.delta.nanoseconds)
        actor = self.actor
        if actor is None or not self.active or now == 0:
            return
        # From zero the clock begins, without a step; messages received before may be of that time.
        if step != now and not 0 <= step <= CLOCK_STEP_NS:
            self._begin_anew(f"/{clock_step_text(step)}")
        if isinstance(actor, ClockedActor):
            if actor.clock is None:
                actor.begin(now)
            self.act(now)

    def _adopt(self, before: NodeParameters) -> None:
        if self.actor is not None:
            self.actor.failures.run("parameters", self.actor.apply_parameters, self.parameters)
        if self.parameters.diagnostics_period != before.diagnostics_period:
            self.destroy_timer(self._timer)
            self._start_diagnostics()

    def _start_diagnostics(self) -> None:
        # By a steady clock: diagnostics are published also when /clock stands still.
        self._timer = super().create_timer(
            self.parameters.diagnostics_period, self._publish_diagnostics, clock=self._steady
        )

    def _status(self) -> tuple[bool, str, dict[str, str]]:
        actor = self.actor
        if actor is None:
            reason = "" if self.failure is None else f": {self.failure}"
            return False, f"unconfigured{reason}", {}
        # First what a kernel has done since the last time: in one pause with the actor's status it
        # would stop the kernel for twice as long.
        with self.exchange.taken():
            pass
        # The next entries are not the actor's: it may go on meanwhile.
        with self.exchange.taken():
            well, sentence, figures = actor.failures.status(actor.status)
            figures = {**figures, **actor.ways()}
        for name, durations in actor.durations.items():
            figures.update(durations.summary(name))
        figures["transport"] = self._transport()
        if self.realtime is not None:
            figures.update(self.realtime.figures())
        figures.update(processor_time())
        figures["clock_steps"] = str(self._clock_steps)
        figures["last_clock_step"] = self._last_step
        figures["refused_messages"] = str(self.refused)
        figures["last_refusal"] = self.last_refusal
        return (well, sentence, figures) if self.active else (False, "inactive", figures)

    def _transport(self) -> str:
        """Return whether messages may go to other processes directly, or why they do not."""
        if self._on_lane:
            return "lane and middleware"
        refusal = self.exchange.refusal if self.parameters.transport == "auto" else ""
        return f"middleware: {refusal}" if refusal else "middleware"

    def _publish_diagnostics(self) -> None:
        well, sentence, figures = self._status()
        status = DiagnosticStatus(
            level=DiagnosticStatus.OK if well else DiagnosticStatus.WARN,
            name=self.get_fully_qualified_name().lstrip("/"),
            message=sentence,
            hardware_id=self.parameters.scene,
            values=[KeyValue(key=key, value=value) for key, value in figures.items()],
        )
        message = DiagnosticArray(status=[status])
        set_stamp(message.header.stamp, nearest_stamp(self.now_ns()))
        self._diagnostics.publish(message)
        send_report(Report(self.get_fully_qualified_name(), well, sentence, figures))
