# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The one loop that runs nodes: it waits for messages, but no longer than the next deadline.

A bare spin() of the events executor hangs on an endless deadline, so waiting with a finite timeout
happens here and nowhere else. One thread at a time runs callbacks and ticks, so nodes need no
locks.

The executor has nothing that the lane's sockets could be waited for together with. So where there
is a lane, the loop's thread waits for that, and a second one for what the middleware brings: they
take turns, see :mod:`.turn`. A third one publishes what people see. So views and services keep few
deadlines waiting, and a command to stop waits for no look.

A watchdog ends a node that is alive and does nothing; whatever started it may do so again. The
middleware may hold a lock for ever (rmw_fastrtps had such a fault with QoS events), while the
thread that waits for it holds Python's. So the watch is a kernel in a thread of its own, which asks
for neither.

The package's kind of node: rclpy's, without two of its habits that stop or end a process.

By default rclpy asks the middleware to tell of peers whose QoS or type does not fit, to log it.
Whoever takes such an event holds a lock of rmw_fastrtps and waits for one of Fast DDS, and the
thread that brings the next one does so the other way round: both may wait for ever (rmw_fastrtps
pull request 890, not in ROS 2 Jazzy's 8.4.3). The peer logs it too.

An exception in a callback ends the process, also in those that are rclpy's own, which anybody may
send anything to: of ``/clock``, and of services of parameters, states and types. Time before 1970,
a parameter of a type that there is not, a transition that the state does not allow: none of it ends
a node here.
"""

from __future__ import annotations

import ctypes
import faulthandler
import gc
import inspect
import json
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from functools import partial
from types import FrameType
from typing import Any, Protocol, TypeVar

import numpy as np
import rclpy
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.service import Service
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from hapticmech_ros.errors import HapticMechError, shown
from hapticmech_ros.nodes.exchange import Exchange
from hapticmech_ros.nodes.lane_kernels import ENDED, LOOK_US, ROUNDS, abort_when_still
from hapticmech_ros.nodes.realtime import come_after_loop
from hapticmech_ros.nodes.turn import Turn
from hapticmech_ros.numerics.times import NANOSECONDS

M = TypeVar("M")
# Told what was wrong.
Refuse = Callable[[HapticMechError], None]


def is_rclpys(callback: object) -> bool:
    """Return whether a function or method is one of rclpy."""
    return (getattr(callback, "__module__", None) or "").partition(".")[0] == "rclpy"


def refusing(callback: Callable[[M], None], refuse: Refuse) -> Callable[[M], None]:
    """Return a subscription's callback that refuses the messages that cannot be taken.

    Args:
        callback: takes a message.
        refuse: told why one was not taken.
    """

    def take(message: M) -> None:
        try:
            callback(message)
        except Exception as error:  # noqa: BLE001 - whatever it is, the process would end
            refuse(_sentence(error))

    return take


def answering(service: Service, refuse: Refuse) -> Callable[[Any, Any], Any]:
    """Return a service's callback that says in its response that a request cannot be answered.

    Args:
        service: with the callback that it has so far.
        refuse: told why one was not answered.
    """
    callback: Callable[[Any, Any], Any] = service.callback
    kind: Any = service.srv_type

    def answer(request: Any, response: Any) -> Any:
        try:
            return callback(request, response)
        except Exception as error:  # noqa: BLE001 - as above
            sentence = _sentence(error)
            refuse(sentence)
            return _refusal(kind.Response(), str(sentence))

    def answer_each(request: Any, response: Any) -> Any:
        # One that cannot be read keeps no other from being set.
        each = (kind.Request(parameters=[parameter]) for parameter in request.parameters)
        response.results = [
            one for single in each for one in answer(single, kind.Response()).results
        ]
        return response

    return answer_each if kind is SetParameters else answer


def _refusal(response: Any, reason: str) -> Any:
    """Fill a response; those of other services say by what they lack that nothing was done."""
    if isinstance(response, SetParameters.Response):
        response.results = [SetParametersResult(successful=False, reason=reason)]
    elif isinstance(response, SetParametersAtomically.Response):
        response.result = SetParametersResult(successful=False, reason=reason)
    return response


def _sentence(error: Exception) -> HapticMechError:
    """Return an error of rclpy as one of ours; it may quote what somebody sent, at any length."""
    return HapticMechError(f"{type(error).__name__}: {shown(str(error))}")


# A refused message is logged at most this often for each topic.
REFUSAL_LOG_PERIOD_NS = NANOSECONDS


class QuietEventsNode(Node):
    """A node that is told of no QoS events, unless that is wanted, and that no message ends.

    Its own callbacks, other than rclpy's, are left as they are.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._refusal_logs: dict[str, int] = {}
        super().__init__(*args, **kwargs)
        # All that there are now, however they were made.
        for service in self.services:
            if is_rclpys(service.callback):
                what = f"request of {service.service_name}"
                service.callback = answering(service, partial(self.report_refused, what))

    def create_publisher(self, *args: Any, **kwargs: Any) -> Any:
        """Create a publisher, as :meth:`rclpy.node.Node.create_publisher` does.

        Returns:
            The publisher.
        """
        kwargs.setdefault("event_callbacks", PublisherEventCallbacks(use_default_callbacks=False))
        return super().create_publisher(*args, **kwargs)

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Callable[..., None], *args: Any, **kwargs: Any
    ) -> Any:
        """Create a subscription, as :meth:`rclpy.node.Node.create_subscription` does.

        Returns:
            The subscription.
        """
        kwargs.setdefault(
            "event_callbacks", SubscriptionEventCallbacks(use_default_callbacks=False)
        )
        if is_rclpys(callback):
            callback = refusing(callback, partial(self.refuse, topic))
        return super().create_subscription(msg_type, topic, callback, *args, **kwargs)

    def refuse(self, topic: str, error: HapticMechError) -> None:
        """Drop a message that breaks a rule, and say so now and then."""
        self.report_refused(f"message on {topic}", error)

    def report_refused(self, what: str, error: HapticMechError) -> None:
        """Log what was refused, and why; at most once in :data:`REFUSAL_LOG_PERIOD_NS`."""
        now = time.monotonic_ns()
        last = self._refusal_logs.get(what)
        if last is None or now - last > REFUSAL_LOG_PERIOD_NS:
            self._refusal_logs[what] = now
            self.get_logger().warning(f"{what} refused: {error}")


# Longer than anything that a node's loop does at once, the loading of a large scene included.
STILL_S = 20.0


class Watchdog:
    """Aborts the process when its loop stands still, with a sentence and the stacks of its threads.

    A process that was stopped as a whole, by SIGSTOP or a debugger, goes on afterwards.

    Args:
        still_s: how long it may stand.
    """

    def __init__(self, still_s: float = STILL_S) -> None:
        faulthandler.enable()
        sentence = (
            f"watchdog: the loop of this process has stood still for {still_s:g} s; aborted\n"
        )
        padded = sentence.encode().rjust(-(-len(sentence) // 8) * 8)
        self._shared = np.zeros(2, dtype=np.int64)
        arguments = (
            self._shared,
            np.frombuffer(padded, dtype=np.int64).copy(),
            np.zeros(1, dtype=np.int64),
            max(1, round(still_s * 1e6 / LOOK_US)),
        )
        threading.Thread(target=abort_when_still, args=arguments, daemon=True).start()

    def go_round(self) -> None:
        """Note that the loop goes on."""
        self._shared[ROUNDS] += 1

    def end(self) -> None:
        """Watch no more."""
        self._shared[ENDED] = 1


# Longest wait for a message or deadline: also how late a signal is answered at the worst.
LONGEST_WAIT_S = 0.1
# Longest run of a kernel, which whoever has something to do for Python ends before.
LONGEST_RUN_S = 1.0
# A deadline closer than this is waited for by looking at the clock: timers wake up later than that.
SHORTEST_WAIT_S = 20e-6
# A processor that idles wakes up late, by 50 to 100 us where it is a virtual one. A deadline is
# waited for with open eyes from as much before it, but for no more than this share of the wait, and
# no longer than this, ns: whoever looks at the clock takes the processor from everybody else.
AWAKE_SHARE, AWAKE_NS = 10, 40_000
# Of the latenesses seen, what a new one counts; and no more than this of it, ns: a thread that
# something else kept waiting would not have come earlier for looking at the clock.
_LEARNS, _WAKES_WITHIN_NS = 8, 150_000
# How long the middleware is waited for at once, s.
SPIN_S = 0.02
# Whoever wants Python's lock gets it after so long, s: five milliseconds are several periods.
SWITCH_S = 0.0005
# For how long callbacks that have waited keep a kernel from going on, s.
CALLBACKS_S = 0.005
# Who answers nobody takes what has come so often, s: to wake up for each message would take as much
# of a processor again, and keep those waiting who answer.
GATHER_S = 0.01
# Messages for people are sent while nothing else is to be done for so long, and, after a deadline,
# not before its answer has come or so much time has passed.
SENDS_NS, ANSWER_NS = 150_000, 400_000
# A timeout of zero would still be waited for, by 20 to 80 us: the system is asked to wait until a
# time that has gone by when it is asked. It is not asked where that time is before 1970.
NO_WAIT_S = -4e9
_PR_SET_TIMERSLACK = 29


class StopRequest:
    """Set by the first SIGINT or SIGTERM; further ones change nothing, nor disturb the end.

    Attributes:
        asked: whether to stop.
        calls: called then, in the main thread.
    """

    def __init__(self) -> None:
        self.asked = False
        self.calls: list[Callable[[], None]] = []
        signal.signal(signal.SIGINT, self._handle)
        signal.signal(signal.SIGTERM, self._handle)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self.ask()
        # Python takes its handlers away as it ends: a second Ctrl-C would kill it there.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)

    def ask(self) -> None:
        """Ask to stop."""
        self.asked = True
        for call in self.calls:
            call()


def wake_up_in_time() -> None:
    """Ask Linux not to gather this process's wake-ups, by which it delays each by some 50 µs."""
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1)


def wait_for_messages(executor: Executor, timeout_s: float, until: Future | None = None) -> None:
    """Run callbacks for ``timeout_s``, which must be finite, or until a future is done.

    One by one: each call of the events executor's ``spin_until_future_complete`` leaves an object
    of 24 bytes behind (rclpy 7.1), which at 1 kHz comes to 70 MB an hour.
    """
    end, left = time.monotonic() + timeout_s, timeout_s
    while until is None or not until.done():
        executor.spin_once(timeout_sec=max(left, 0.0))
        left = end - time.monotonic()
        if left <= 0.0:
            return


def run_waiting(executor: Executor, most_s: float) -> None:
    """Run the callbacks of what the middleware has brought by now, for ``most_s`` at most.

    The executor does not tell whether a call of ``spin_once`` found anything, and what it found may
    be as short as nothing: messages that were replaced before they were taken leave events behind
    for which there is no message. So a mark is queued behind what is there, and callbacks are run
    until it comes out.

    Args:
        executor: of the nodes.
        most_s: s.
    """
    waiting, end = [True], time.monotonic() + most_s
    executor.create_task(waiting.clear)
    while waiting and time.monotonic() < end:
        executor.spin_once(timeout_sec=NO_WAIT_S)


class Threads:
    """The threads of a process beside the loop's.

    They are there at once, so that what is asked of the system for all threads holds for them.

    Args:
        executor: of the nodes.
        exchange: of the process.
    """

    def __init__(self, executor: Executor, exchange: Exchange) -> None:
        self._executor, self._exchange = executor, exchange
        self._turn: Turn | None = None
        self._begun, self._ended = threading.Event(), False
        self._failure: Exception | None = None
        self._seen_ns = 0
        self._threads = [
            threading.Thread(target=self._work, args=(work,), daemon=True)
            for work in (self._run_callbacks, self._publish_views)
        ]
        for thread in self._threads:
            thread.start()

    def begin(self, turn: Turn) -> None:
        """Let them work, unless they do; the thread that calls is the loop's from now on."""
        if self._turn is not None:
            return
        turn.share()
        self._turn = turn
        self._begun.set()

    def have_listened(self) -> bool:
        """Return whether the middleware was listened to since this was asked last.

        Raises:
            Exception: which a callback has raised.
        """
        if self._failure is not None:
            raise self._failure
        if self._turn is None:
            return True
        seen_ns, self._seen_ns = self._seen_ns, int(self._turn.listened[0])
        return self._seen_ns > seen_ns

    def end(self) -> None:
        """Wait for both to end."""
        self._ended = True
        self._begun.set()
        if self._turn is not None:
            self._turn.end()
        for thread in self._threads:
            thread.join()

    def _work(self, work: Callable[[Turn], None]) -> None:
        leave_signals()
        self._begun.wait()
        if self._turn is not None:
            come_after_loop()
            work(self._turn)

    def _run_callbacks(self, turn: Turn) -> None:
        while not self._ended:
            try:
                if self._exchange.has_deferred:
                    time.sleep(max(self._exchange.until_called_s, 0.0))
                    with self._exchange.taken():
                        run_waiting(self._executor, CALLBACKS_S)
                else:
                    self._executor.spin_once(timeout_sec=SPIN_S)
            except Exception as error:  # noqa: BLE001 - the loop's thread raises it
                self._failure = error
                turn.ring()
                return
            turn.listen()
            if self._exchange.has_news:
                turn.ring()

    def _publish_views(self, turn: Turn) -> None:
        while turn.wait_for_view():
            turn.publish_views()
            self._exchange.meet_failures()


class Inbox:
    """What a process waits for: its executor, and the lane.

    Args:
        executor: of the nodes.
        exchange: with the lane.
        threads: that run callbacks where there is a lane; None: there are none.
    """

    def __init__(
        self, executor: Executor, exchange: Exchange, threads: Threads | None = None
    ) -> None:
        self._executor = executor
        self._exchange = exchange
        self._threads = threads
        self._answer_ns = self._late_ns = 0

    def wait(self, timeout_s: float) -> None:
        """Wait for messages, no longer than ``timeout_s``, and hand on what has come.

        Messages for people are sent meanwhile, one after the other, if there is time for that.
        """
        exchange = self._exchange
        lane = exchange.lane
        if lane is None or self._threads is None:
            wait_for_messages(self._executor, timeout_s)
            exchange.collect()
            exchange.deliver()
            return
        self._threads.begin(lane.turn)
        lane.look()
        now = time.monotonic_ns()
        deadline = now + int(timeout_s * NANOSECONDS)
        end = deadline
        if exchange.has_later:
            if now < self._answer_ns:
                end = min(end, self._answer_ns)
            elif end - now > SENDS_NS:
                exchange.collect()
                if not exchange.is_waiting:
                    exchange.publish_one()
                    return
        if not exchange.is_waiting and end < deadline:
            exchange.collect(max(0, end - now) / NANOSECONDS)
        elif not exchange.is_waiting:
            self._collect_until(deadline, now)
        if exchange.is_waiting:
            self._answer_ns = 0
            exchange.deliver()

    def gather(self) -> None:
        """Let messages come for :data:`GATHER_S`, and hand on all that have."""
        exchange = self._exchange
        lane = exchange.lane
        if lane is None or not lane.linked:
            self.wait(LONGEST_WAIT_S)
            return
        time.sleep(GATHER_S)
        lane.look()
        exchange.collect(whole=True)
        exchange.deliver()
        # All of it, but for so long only: messages may come as fast as they are taken.
        run_waiting(self._executor, GATHER_S)

    def drain(self, most_s: float) -> None:
        """Hand on all that has come until now, for ``most_s`` at most."""
        end = time.monotonic() + most_s
        time.sleep(GATHER_S)
        self._exchange.collect(whole=True)
        self._exchange.deliver()
        run_waiting(self._executor, end - time.monotonic())

    def _collect_until(self, deadline: int, now: int) -> None:
        """Let messages come until a deadline, ns, which is met to some microseconds."""
        exchange, lane = self._exchange, self._exchange.lane
        early = min(self._late_ns, AWAKE_NS, (deadline - now) // AWAKE_SHARE)
        timeout_s = (deadline - early - now) / NANOSECONDS
        exchange.collect(timeout_s, longest_s=LONGEST_RUN_S)
        if exchange.is_waiting or (lane is not None and lane.worked):
            return
        now = time.monotonic_ns()
        if now < deadline - early:
            # Something else is to be done.
            return
        # Half as much again as usual: most are in time then.
        late = 3 * min(now - (deadline - early), _WAKES_WITHIN_NS) // 2
        self._late_ns += (late - self._late_ns) // _LEARNS
        while now < deadline and not exchange.is_waiting:
            exchange.collect()
            now = time.monotonic_ns()

    def acted(self) -> None:
        """Note that what was sent now may be answered soon."""
        self._answer_ns = time.monotonic_ns() + ANSWER_NS


class HasDeadlines(Protocol):
    """A node that says when it wants to act next."""

    def look_at_clock(self) -> None:
        """Notice it if the machine's clock was set."""

    def now_ns(self) -> int:
        """Return the node's time, ns."""

    def next_deadline_ns(self) -> int | None:
        """Return the next deadline by the node's time, ns; None: never."""

    def act(self, now_ns: int) -> None:
        """Act on the deadlines that have come."""


def run_each(stop: StopRequest, works: Sequence[Callable[[], None]]) -> None:
    """Run each in a thread of its own until one ends, or a signal comes; then stop all.

    Args:
        stop: looked at by each.
        works: to run.

    Raises:
        Exception: what one of them has raised.
    """
    with ThreadPoolExecutor(len(works), initializer=leave_signals) as pool:
        running = [pool.submit(work) for work in works]
        wait(running, return_when=FIRST_COMPLETED)
        stop.ask()
    for one in running:
        one.result()


def leave_signals() -> None:
    """Leave signals to the main thread, where Python acts on them, from the one that calls."""
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))


def prepare_loops() -> None:
    """Set Python up for loops with deadlines, once all is made."""
    _find_callers()
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(SWITCH_S)


def run_until(
    stop: StopRequest,
    nodes: Sequence[HasDeadlines],
    exchange: Exchange | None = None,
    begun: Callable[[], object] = lambda: None,
) -> None:
    """Run nodes in this thread until a signal: messages as they come, deadlines when they come.

    Args:
        stop: set by a signal.
        nodes: to run.
        exchange: of theirs.
        begun: called once there are all threads.
    """
    executor, exchange = EventsExecutor(), exchange or Exchange()
    for node in nodes:
        executor.add_node(node)  # type: ignore[arg-type]
    threads = Threads(executor, exchange)
    stop.calls.append(exchange.ring)
    begun()
    watchdog = Watchdog()
    inbox = Inbox(executor, exchange, threads)
    try:
        while rclpy.ok() and not stop.asked:
            if threads.have_listened():
                watchdog.go_round()
            inbox.wait(_wait_s(nodes))
            for node in nodes:
                node.look_at_clock()
                deadline = node.next_deadline_ns()
                if deadline is not None and deadline <= (now := node.now_ns()):
                    node.act(now)
                    inbox.acted()
    finally:
        stop.calls.remove(exchange.ring)
        threads.end()
    watchdog.end()
    executor.shutdown()


class Reports(Protocol):
    """A node that has something to say as it ends."""

    def final_report(self) -> str:
        """Return what is printed then."""


def print_report(node: Reports) -> None:
    """Print a node's last line in one write: processes that share a terminal end together."""
    sys.stdout.write(f"{node.final_report()}\n")
    sys.stdout.flush()


def _find_callers() -> None:
    """Do now what rclpy does for its first log line, when a device may wait for an answer.

    It asks inspect for the caller, which then looks through all modules: up to 0.1 s.
    """
    frame = inspect.currentframe()
    if frame is not None:
        inspect.getframeinfo(frame)


def _wait_s(nodes: Sequence[HasDeadlines]) -> float:
    """Return how long to wait for messages: to the next deadline, within finite bounds."""
    ahead = [
        (deadline - node.now_ns()) / NANOSECONDS
        for node in nodes
        if (deadline := node.next_deadline_ns()) is not None
    ]
    return min(max(min(ahead, default=LONGEST_WAIT_S), SHORTEST_WAIT_S), LONGEST_WAIT_S)


def write_progress(event: str, **facts: object) -> None:
    """Print a line of JSON for the parent process."""
    print(json.dumps({"event": event, **facts}), flush=True)


def watch(node_type: Callable[[], Node], arguments: Sequence[str], **facts: Any) -> int:
    """Run a node, which takes no arguments, until a signal; return the exit code.

    Args:
        node_type: of the node.
        arguments: for ROS.
        facts: told as soon as it listens.
    """
    stop = StopRequest()
    rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    node = node_type()
    executor = EventsExecutor()
    executor.add_node(node)
    write_progress("ready", **facts)
    try:
        while rclpy.ok() and not stop.asked:
            wait_for_messages(executor, LONGEST_WAIT_S)
        return 0
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
