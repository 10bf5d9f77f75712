# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node's loop: it waits for messages until the next deadline, and acts on deadlines.

Each node has its own loop in a thread of its own (:func:`run_each`). With a lane, two more threads
work for it (:class:`Threads`): one runs the middleware's callbacks, one publishes views. The
executor cannot wait for the lane's sockets, so the loop's thread waits for these. Loop and
callbacks take turns (:mod:`.turn`), so nodes need no locks. Views and services thus delay few
deadlines, and a stop command need not wait until the loop polls the middleware.

Without a lane, the loop's thread runs the callbacks too. A bare spin() of the events executor hangs
on an infinite timeout; this module waits with finite ones only.

A watchdog aborts a process whose loop stands still; what started it may restart it. The middleware
may hold a lock for ever (rmw_fastrtps had such a fault with QoS events) while the thread that waits
for it holds Python's lock. So the watchdog is a compiled kernel in a thread of its own that needs
neither.

:class:`QuietEventsNode` is rclpy's node without two behaviours that stop or end a process.

By default rclpy subscribes to the middleware's events on peers with an incompatible QoS or type, to
log them. The thread that takes such an event holds a lock of rmw_fastrtps and waits for one of Fast
DDS; the thread that delivers the next one locks in the opposite order: both may wait for ever
(rmw_fastrtps pull request 890, not in ROS 2 Jazzy's 8.4.3). The peer logs it too.

An exception in a callback ends the process, even in rclpy's own callbacks, which take messages from
any peer: of ``/clock``, and of services of parameters, states and types. Here a time before 1970, a
parameter of an unknown type, or a transition that the state does not allow ends no node.
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
from contextlib import suppress
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
from rclpy.task import Future

from hapticmech_ros.errors import HapticMechError, shown
from hapticmech_ros.nodes.exchange import Exchange
from hapticmech_ros.nodes.lane_kernels import ENDED, LOOK_US, ROUNDS, abort_when_still
from hapticmech_ros.nodes.realtime import come_after_loop
from hapticmech_ros.nodes.turn import Turn
from hapticmech_ros.numerics.times import NANOSECONDS

M = TypeVar("M")
# Called with the error.
Refuse = Callable[[HapticMechError], None]


def is_rclpys(callback: object) -> bool:
    """Return whether a function or method is defined in rclpy."""
    return (getattr(callback, "__module__", None) or "").partition(".")[0] == "rclpy"


def refusing(callback: Callable[[M], None], refuse: Refuse) -> Callable[[M], None]:
    """Return a subscription's callback that refuses messages on which ``callback`` raises.

    Args:
        callback: called with a message.
        refuse: called with the error.
    """

    def take(message: M) -> None:
        try:
            callback(message)
        except Exception as error:  # noqa: BLE001 - whatever it is, the process would end
            refuse(_sentence(error))

    return take


def answering(service: Service, refuse: Refuse) -> Callable[[Any, Any], Any]:
    """Return a service's callback whose response reports the error that its own callback raises.

    Args:
        service: with its own callback.
        refuse: called with the error.
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
        # Each by itself: a parameter that cannot be read does not prevent the others being set.
        each = (kind.Request(parameters=[parameter]) for parameter in request.parameters)
        response.results = [
            one for single in each for one in answer(single, kind.Response()).results
        ]
        return response

    return answer_each if kind is SetParameters else answer


def _refusal(response: Any, reason: str) -> Any:
    """Fill a parameter service's response with a refusal; return others as they are, empty."""
    if isinstance(response, SetParameters.Response):
        response.results = [SetParametersResult(successful=False, reason=reason)]
    elif isinstance(response, SetParametersAtomically.Response):
        response.result = SetParametersResult(successful=False, reason=reason)
    return response


def _sentence(error: Exception) -> HapticMechError:
    """Return an error as one of this package, shortened: it may quote a long message."""
    return HapticMechError(f"{type(error).__name__}: {shown(str(error))}")


# A refused message is logged at most this often for each topic.
REFUSAL_LOG_PERIOD_NS = NANOSECONDS


class QuietEventsNode(Node):
    """A node without QoS events unless requested, which no message to rclpy's callbacks ends.

    Callbacks that are not rclpy's are not changed.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._refusal_logs: dict[str, int] = {}
        super().__init__(*args, **kwargs)
        # All services that rclpy has created by now.
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
        """Log a message that breaks a rule; see :meth:`report_refused`."""
        self.report_refused(f"message on {topic}", error)

    def report_refused(self, what: str, error: HapticMechError) -> None:
        """Log a refusal and its reason, at most once per :data:`REFUSAL_LOG_PERIOD_NS`."""
        now = time.monotonic_ns()
        last = self._refusal_logs.get(what)
        if last is None or now - last > REFUSAL_LOG_PERIOD_NS:
            self._refusal_logs[what] = now
            self.get_logger().warning(f"{what} refused: {error}")


# Longer than any single step of a node's loop, the loading of a large scene included.
STILL_S = 20.0


class Watchdog:
    """Aborts the process when its loop stands still, and prints the stacks of its threads.

    A process that was stopped as a whole, by SIGSTOP or a debugger, continues afterwards.

    Args:
        still_s: longest time without :meth:`go_round`, s.
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
        """Count a pass of the loop."""
        self._shared[ROUNDS] += 1

    def end(self) -> None:
        """Stop watching."""
        self._shared[ENDED] = 1


# Longest wait for a message or deadline, s: also the longest delay before a signal is handled.
LONGEST_WAIT_S = 0.1
# Longest run of a kernel, s; work for Python ends it earlier: diagnostics do so each second, and a
# second return in each second would cost as much again.
LONGEST_RUN_S = 1.5
# Shortest wait for messages, s: timers wake up later than that.
SHORTEST_WAIT_S = 20e-6
# An idle processor wakes up late, by 50 to 100 us if it is virtual. The last part of a wait for a
# deadline, as long as the expected lateness, is busy polling: at most 1/AWAKE_SHARE of the wait and
# AWAKE_NS, ns, since polling takes the processor from other threads.
AWAKE_SHARE, AWAKE_NS = 10, 40_000
# The mean lateness moves by 1/_LEARNS towards each new one, of which at most _WAKES_WITHIN_NS, ns,
# counts: polling does not help a thread that had to wait for another one.
_LEARNS, _WAKES_WITHIN_NS = 8, 150_000
# Longest single wait for the middleware, s.
SPIN_S = 0.02
# A thread waiting for Python's lock gets it after this, s; the default, 5 ms, is several periods.
SWITCH_S = 0.0005
# How long deferred callbacks may keep a kernel from running, s.
CALLBACKS_S = 0.005
# Longest and shortest period at which a process that only receives takes its messages, s: each
# wake-up costs as much as many messages, and delays the processes of the control loop.
GATHER_S, GATHER_LEAST_S = 0.05, 0.002
# It wakes up more often if a publisher's socket would fill to more than this, bytes with overhead:
# a third of the buffer that Linux grants by default.
GATHER_BYTES = 140_000
# Kept messages are sent if the next deadline is at least SENDS_NS away, ns, and not before the
# answers to a node's last output have arrived or ANSWER_NS, ns, have passed.
SENDS_NS, ANSWER_NS = 150_000, 400_000
# A timeout of zero costs 20 to 80 us, as the system call waits until a time that has just passed.
# No system call is made if that time is before 1970.
NO_WAIT_S = -4e9
_PR_SET_TIMERSLACK = 29


class StopRequest:
    """A request to stop, set by the first SIGINT or SIGTERM; further signals are ignored.

    Attributes:
        asked: whether to stop.
        calls: called by :meth:`ask`; after a signal in the main thread.
    """

    def __init__(self) -> None:
        self.asked = False
        self.calls: list[Callable[[], None]] = []
        signal.signal(signal.SIGINT, self._handle)
        signal.signal(signal.SIGTERM, self._handle)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self.ask()
        # Python removes its handlers at exit: a second Ctrl-C would kill the process there.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)

    def ask(self) -> None:
        """Request to stop."""
        self.asked = True
        for call in self.calls:
            call()


def wake_up_in_time() -> None:
    """Set the thread's timer slack to 1 ns: Linux else delays wake-ups by 50 us to group them."""
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1)


def wait_for_messages(executor: Executor, timeout_s: float, until: Future | None = None) -> None:
    """Run callbacks for ``timeout_s``, which must be finite, or until a future is done.

    By ``spin_once``: each call of the events executor's ``spin_until_future_complete`` leaks 24
    bytes (rclpy 7.1), at 1 kHz 70 MB an hour.
    """
    end, left = time.monotonic() + timeout_s, timeout_s
    while until is None or not until.done():
        executor.spin_once(timeout_sec=max(left, 0.0))
        left = end - time.monotonic()
        if left <= 0.0:
            return


def run_waiting(executor: Executor, most_s: float) -> None:
    """Run the callbacks of all messages that have arrived by now, for ``most_s`` at most.

    The executor's ``spin_once`` does not return whether it ran a callback, and its duration does
    not show that either: a message replaced before it was taken leaves an event without a message.
    So a task is queued behind the present events, and callbacks are run until this task has run.

    Args:
        executor: of the nodes.
        most_s: longest duration, s.
    """
    waiting, end = [True], time.monotonic() + most_s
    executor.create_task(waiting.clear)
    while waiting and time.monotonic() < end:
        executor.spin_once(timeout_sec=NO_WAIT_S)


class Threads:
    """A loop's two further threads: one runs callbacks, one publishes views.

    They are started at once, so that settings made for all threads of the process include them, but
    wait for :meth:`begin`.

    Args:
        executor: of the loop's nodes.
        exchange: of the loop's nodes.
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
        """Start the threads' work, unless started; the calling thread becomes the loop's."""
        if self._turn is not None:
            return
        turn.share()
        self._turn = turn
        self._begun.set()

    def have_listened(self) -> bool:
        """Return whether the middleware was polled since the last call; True before :meth:`begin`.

        Raises:
            Exception: raised by a callback.
        """
        if self._failure is not None:
            raise self._failure
        if self._turn is None:
            return True
        seen_ns, self._seen_ns = self._seen_ns, int(self._turn.listened[0])
        return self._seen_ns > seen_ns

    def end(self) -> None:
        """Stop both threads, and wait until they have ended."""
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
                    self._exchange.drop_copies()
                    if self._exchange.has_deferred:
                        with self._exchange.taken():
                            run_waiting(self._executor, CALLBACKS_S)
                    else:
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
    """Receives a loop's messages from its executor and from the lane.

    Args:
        executor: of the nodes.
        exchange: of the nodes, with the lane.
        threads: that run callbacks if there is a lane; None: :meth:`wait` runs the callbacks.
    """

    def __init__(
        self, executor: Executor, exchange: Exchange, threads: Threads | None = None
    ) -> None:
        self._executor = executor
        self._exchange = exchange
        self._threads = threads
        self._answer_ns = self._late_ns = 0
        self._gather_s, self._gathered_s = GATHER_LEAST_S, time.monotonic()

    def wait(self, timeout_s: float) -> None:
        """Wait for messages, at most ``timeout_s``, and deliver those that have arrived.

        If there is time, one kept message is sent instead; see :data:`SENDS_NS`.
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
        """Wait until a socket of the lane is a third full, then deliver all that has arrived.

        For :data:`GATHER_S` at most, and as expected from the last time. Without another process on
        the lane: :meth:`wait` for at most :data:`LONGEST_WAIT_S`.
        """
        exchange = self._exchange
        lane = exchange.lane
        if lane is None or not lane.linked:
            self.wait(LONGEST_WAIT_S)
            return
        time.sleep(self._gather_s)
        lane.look()
        now = time.monotonic()
        exchange.collect(whole=True)
        fills_s = (now - self._gathered_s) * GATHER_BYTES / max(lane.fullest, 1)
        self._gather_s = min(max(fills_s, GATHER_LEAST_S), GATHER_S)
        self._gathered_s = now
        exchange.deliver()
        # With a time limit: messages may arrive as fast as they are taken.
        run_waiting(self._executor, GATHER_S)

    def drain(self, most_s: float) -> None:
        """Wait :data:`GATHER_S`, then deliver all messages that have arrived.

        The middleware's callbacks run until ``most_s`` after the call.
        """
        end = time.monotonic() + most_s
        time.sleep(GATHER_S)
        self._exchange.collect(whole=True)
        self._exchange.deliver()
        run_waiting(self._executor, end - time.monotonic())

    def _collect_until(self, deadline: int, now: int) -> None:
        """Receive messages until a deadline, ns, which is met to some microseconds."""
        exchange, lane = self._exchange, self._exchange.lane
        early = min(self._late_ns, AWAKE_NS, (deadline - now) // AWAKE_SHARE)
        timeout_s = (deadline - early - now) / NANOSECONDS
        exchange.collect(timeout_s, longest_s=LONGEST_RUN_S)
        if exchange.is_waiting or (lane is not None and lane.worked):
            return
        now = time.monotonic_ns()
        if now < deadline - early:
            # Woken early, for something else.
            return
        # A margin of a half on the mean lateness: most deadlines are met then.
        late = 3 * min(now - (deadline - early), _WAKES_WITHIN_NS) // 2
        self._late_ns += (late - self._late_ns) // _LEARNS
        while now < deadline and not exchange.is_waiting:
            exchange.collect()
            now = time.monotonic_ns()

    def acted(self) -> None:
        """Note that answers to the node's output are expected within :data:`ANSWER_NS`."""
        self._answer_ns = time.monotonic_ns() + ANSWER_NS


class HasDeadlines(Protocol):
    """A node that acts on deadlines."""

    def look_at_clock(self) -> None:
        """Check whether the machine's clock was set."""

    def now_ns(self) -> int:
        """Return the node's time, ns."""

    def next_deadline_ns(self) -> int | None:
        """Return the next deadline by the node's time, ns; None: there is none."""

    def act(self, now_ns: int) -> None:
        """Act on the deadlines up to a time, ns."""


def run_each(
    stop: StopRequest,
    works: Sequence[Callable[[Callable[[], None]], None]],
    begin: Callable[[], None] = lambda: None,
) -> None:
    """Run each function in a thread of its own; once one returns or raises, stop all.

    Args:
        stop: checked by each function; a signal sets it too.
        works: the functions; each calls its argument once it has made all its threads, and waits
            there for the others.
        begin: called once when all have.

    Raises:
        Exception: raised by one of them.
    """
    barrier = threading.Barrier(len(works), begin)
    stop.calls.append(barrier.abort)

    def begun() -> None:
        with suppress(threading.BrokenBarrierError):
            barrier.wait()

    with ThreadPoolExecutor(len(works), initializer=leave_signals) as pool:
        running = [pool.submit(work, begun) for work in works]
        wait(running, return_when=FIRST_COMPLETED)
        stop.ask()
    for one in running:
        one.result()


def leave_signals() -> None:
    """Block SIGINT and SIGTERM in the calling thread: the main thread handles them."""
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))


def prepare_loops() -> None:
    """Set Python up for loops with deadlines, once all nodes are created."""
    _find_callers()
    gc.collect()
    gc.freeze()
    gc.enable()
    sys.setswitchinterval(SWITCH_S)


def prepare_to_gather() -> None:
    """Set Python up for thousands of messages a second that are kept for a while, without circles.

    The garbage collector would look through them again and again.
    """
    gc.freeze()
    gc.set_threshold(100_000, 50, 100)


def run_until(
    stop: StopRequest,
    nodes: Sequence[HasDeadlines],
    exchange: Exchange | None = None,
    begun: Callable[[], object] = lambda: None,
) -> None:
    """Run a loop for nodes in this thread until a stop: deliver messages, act on deadlines.

    Args:
        stop: the request to stop.
        nodes: to run.
        exchange: of the nodes; None: a new one, without a lane.
        begun: called once this loop's :class:`Threads` are started.
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
                if deadline is None or exchange.has_stepped:
                    continue
                if deadline <= (now := node.now_ns()):
                    node.act(now)
                    inbox.acted()
    finally:
        stop.calls.remove(exchange.ring)
        threads.end()
    watchdog.end()
    executor.shutdown()


def print_line(text: str) -> None:
    """Print a line in one write, as processes that share a terminal end together."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def _find_callers() -> None:
    """Fill inspect's cache, before a device waits for answers.

    For its first log line rclpy looks up the caller by inspect, which searches all modules: up to
    0.1 s.
    """
    frame = inspect.currentframe()
    if frame is not None:
        inspect.getframeinfo(frame)


def _wait_s(nodes: Sequence[HasDeadlines]) -> float:
    """Return how long (s) to wait for messages: until the next deadline, within finite bounds."""
    ahead = [
        (deadline - node.now_ns()) / NANOSECONDS
        for node in nodes
        if (deadline := node.next_deadline_ns()) is not None
    ]
    return min(max(min(ahead, default=LONGEST_WAIT_S), SHORTEST_WAIT_S), LONGEST_WAIT_S)


def write_progress(event: str, **facts: object) -> None:
    """Print a line of JSON for the parent process."""
    print(json.dumps({"event": event, **facts}), flush=True)
