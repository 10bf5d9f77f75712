# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Plays a rosbag2 bag into the graph: recorded bytes, recorded QoS, recorded times.

A thread reads messages ahead: a slow disk does not delay their publication.

Which messages of a bag to play, and in which order: latched ones first.

And the clock of a replay: which bag time it is, at which rate, and whether it stands still.
"""

from __future__ import annotations

import os
import select
import sys
import termios
import time
import tty
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any

import rclpy
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.qos import ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rosbags.interfaces import QosDurability
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from hapticmech_ros.bag.reader import BagReader, BagTopic
from hapticmech_ros.errors import BagError, HapticMechError, check_positive
from hapticmech_ros.nodes.bags.recorded_topic import adapted_offer
from hapticmech_ros.nodes.loop import (
    LONGEST_WAIT_S,
    SHORTEST_WAIT_S,
    QuietEventsNode,
    StopRequest,
    wait_for_messages,
)
from hapticmech_ros.nodes.messages import message_class, set_stamp, wait_until_acknowledged
from hapticmech_ros.numerics.times import NANOSECONDS, nanoseconds

Message = tuple[str, int, bytes]
# A recorder receives latched messages only after discovery: until then they count as received at
# the start.
DISCOVERY_NS = NANOSECONDS


@dataclass(frozen=True, slots=True)
class Cut:
    """The part of a bag that is played.

    Attributes:
        topics: names; all if empty.
        start_ns: time of reception at which it begins.
        stop_ns: and before which it ends.
    """

    topics: tuple[str, ...]
    start_ns: int
    stop_ns: int


def cut_of(
    bag: BagReader,
    topics: Sequence[str] = (),
    start_offset_s: float = 0.0,
    duration_s: float | None = None,
) -> Cut:
    """Return the part of a bag to play.

    Args:
        bag: open.
        topics: names, as in the bag; all if empty.
        start_offset_s: leave out so much of its beginning, s.
        duration_s: and messages that come so much later than that, s.

    Raises:
        BagError: topic not in the bag, nothing to play, or times that are negative.
    """
    if start_offset_s < 0.0 or (duration_s is not None and duration_s <= 0.0):
        raise BagError(
            f"start offset {start_offset_s} s, duration {duration_s} s: must be positive"
        )
    unknown = [name for name in topics if name not in bag.topics]
    if unknown:
        raise BagError(f"bag {bag.path}: no topic {', '.join(unknown)}")
    first, last = bag.span_ns
    start = first + nanoseconds(start_offset_s)
    if start > last or not last:
        raise BagError(f"bag {bag.path}: nothing to play after {start_offset_s:g} s")
    stop = last + 1 if duration_s is None else min(last + 1, start + nanoseconds(duration_s))
    return Cut(tuple(topics), start, stop)


def latched_first(bag: BagReader, cut: Cut) -> list[Message]:
    """Return one message of each latched topic: the one that stands at the beginning of the cut.

    That is the last one received until then, or else the first one received soon after.
    """
    names = [
        name
        for name, topic in bag.topics.items()
        if is_latched(topic) and (not cut.topics or name in cut.topics)
    ]
    found: dict[str, Message] = {}
    if not names:
        return []
    for message in bag.serialized(*names, stop_ns=min(cut.stop_ns, cut.start_ns + DISCOVERY_NS)):
        name, time_ns, _ = message
        if time_ns <= cut.start_ns or name not in found:
            found[name] = message
    return [found[name] for name in names if name in found]


def stream(bag: BagReader, cut: Cut, first: Sequence[Message]) -> Iterator[Message]:
    """Yield the messages of the cut in order of reception, without those in ``first``."""
    done = {(name, time_ns) for name, time_ns, _ in first}
    for message in bag.serialized(*cut.topics, start_ns=cut.start_ns, stop_ns=cut.stop_ns):
        if message[:2] in done:
            done.discard(message[:2])
        else:
            yield message


def is_latched(topic: BagTopic) -> bool:
    """Return whether a publisher of the topic kept messages for those who come late."""
    return any(offer.durability is QosDurability.TRANSIENT_LOCAL for offer in topic.offered)


class Timeline:
    """Maps a steady clock to the time of a bag and back; both in ns.

    Deadlines are absolute: a late message does not delay later ones.

    Args:
        bag_ns: time of the bag at the beginning.
        now_ns: steady time then.
        rate: bag seconds per second.

    Raises:
        InvalidInputError: a rate that is not positive.
    """

    def __init__(self, bag_ns: int, now_ns: int, rate: float = 1.0, paused: bool = False) -> None:
        check_positive(rate=rate)
        self._rate = rate
        self._bag_ns, self._from_ns = bag_ns, now_ns
        self.paused = paused

    def bag_ns(self, now_ns: int) -> int:
        """Return the bag's time."""
        if self.paused:
            return self._bag_ns
        return self._bag_ns + round((now_ns - self._from_ns) * self._rate)

    def deadline_ns(self, bag_ns: int) -> int:
        """Return the steady time of a bag's time, unless paused before."""
        return self._from_ns + round((bag_ns - self._bag_ns) / self._rate)

    def pause(self, now_ns: int) -> None:
        """Stand still."""
        self._bag_ns = self.bag_ns(now_ns)
        self.paused = True

    def resume(self, now_ns: int) -> None:
        """Go on from where it stands."""
        if self.paused:
            self._from_ns = now_ns
            self.paused = False


class Keyboard:
    """Reads single keys while its block lasts; without a terminal there are none."""

    def __init__(self) -> None:
        self._saved: list[Any] | None = None

    @property
    def is_there(self) -> bool:
        """Whether there is a terminal to read from."""
        return self._saved is not None

    def pressed(self) -> str:
        """Return the keys pressed since the last call."""
        if self._saved is None or not select.select([sys.stdin], [], [], 0.0)[0]:
            return ""
        return os.read(sys.stdin.fileno(), 64).decode(errors="replace")

    def __enter__(self) -> Keyboard:
        # A job in the background is stopped by the terminal if it changes the terminal.
        if sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp():
            self._saved = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._saved is not None:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._saved)


# Messages that are read at a time.
AHEAD = 1000


def read_ahead(messages: Iterator[Message]) -> Generator[Message, None, None]:
    """Yield messages, of which a thread reads some ahead.

    Raises:
        BagError: the bag is damaged behind the last one.
    """
    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(_some, messages)
        while True:
            found, error = coming.result()
            coming = pool.submit(_some, messages)
            yield from found
            if error is not None:
                raise error
            if not found:
                return


def _some(messages: Iterator[Message]) -> tuple[list[Message], BagError | None]:
    """Return the next messages, and the error behind them if the bag is damaged there."""
    found: list[Message] = []
    try:
        found.extend(islice(messages, AHEAD))
    except BagError as error:
        return found, error
    return found, None


CLOCK = "/clock"
SHORT_WAIT_S = 0.01
# Messages published in one go when late, before services and keys get their turn.
LONGEST_BURST = 200
# How long reliable subscribers get to take the last messages.
ACKNOWLEDGE_S = 2.0


@dataclass(frozen=True, slots=True)
class PlayOptions:
    """Options of playing.

    Attributes:
        path: bag folder or file.
        topics: names as in the bag; all if empty.
        rate: bag seconds per second.
        start_offset_s: leave out so much of the beginning, s.
        duration_s: play so much of the bag, s.
        loop: begin anew at the end, until a signal.
        remaps: topic of the bag -> topic to publish on.
        clock_hz: rate of ``/clock``, Hz; 0 for none.
        paused: wait for resume before the first message.
        namespace: put the node and every topic under this name.
        wait_s: wait so long at most for a subscriber of every topic, s.
    """

    path: Path
    topics: tuple[str, ...] = ()
    rate: float = 1.0
    start_offset_s: float = 0.0
    duration_s: float | None = None
    loop: bool = False
    remaps: Mapping[str, str] = field(default_factory=dict)
    clock_hz: float = 0.0
    paused: bool = False
    namespace: str = ""
    wait_s: float = 0.0


class BagPlayerNode(QuietEventsNode):
    """Publishes messages of a bag when it is time.

    Attributes:
        published: messages sent.
        latest_ns: how late a message was sent at worst, ns.

    Raises:
        BagError: a message type that is not installed, or a topic to remap that is not played.
    """

    def __init__(self, bag: BagReader, cut: Cut, options: PlayOptions) -> None:
        super().__init__("bag_player", namespace=options.namespace or None, enable_rosout=False)
        self._bag, self._cut, self._options = bag, cut, options
        names = set(cut.topics or bag.topics)
        if options.clock_hz > 0.0:
            names.discard(CLOCK)
        if stray := sorted(set(options.remaps) - names):
            raise BagError(f"bag {bag.path}: cannot remap {', '.join(stray)}: not played")
        self._sent: dict[str, Any] = {name: self._publisher(name) for name in sorted(names)}
        self._clock_out = (
            self.create_publisher(Clock, CLOCK, 10) if options.clock_hz > 0.0 else None
        )
        self.timeline = Timeline(cut.start_ns, time.monotonic_ns(), options.rate, paused=True)
        self.published = 0
        self.latest_ns = 0
        self._next_clock_ns = 0
        for verb in ("pause", "resume", "toggle_paused"):
            self.create_service(Trigger, f"~/{verb}", self._service(getattr(self, verb)))

    def pause(self) -> None:
        """Stand still."""
        self.timeline.pause(time.monotonic_ns())

    def resume(self) -> None:
        """Go on."""
        self.timeline.resume(time.monotonic_ns())

    def toggle_paused(self) -> None:
        """Pause if it plays, play if it pauses."""
        if self.timeline.paused:
            self.resume()
        else:
            self.pause()

    def deaf(self) -> list[str]:
        """Return topics without subscribers."""
        return [name for name, p in self._sent.items() if p.get_subscription_count() == 0]

    def begin(self, first: list[Message], paused: bool) -> None:
        """Publish the first messages, and start the bag's time."""
        for name, _, data in first:
            self._publish(name, data)
        now = time.monotonic_ns()
        self.timeline = Timeline(self._cut.start_ns, now, self._options.rate, paused)
        self._next_clock_ns = now

    def publish_due(self, message: Message) -> bool:
        """Publish a message if its time has come; return whether it has."""
        now = time.monotonic_ns()
        late = now - self.timeline.deadline_ns(message[1])
        if self.timeline.paused or late < 0:
            return False
        self.latest_ns = max(self.latest_ns, late)
        self._publish(message[0], message[2])
        return True

    def tick_clock(self) -> None:
        """Publish ``/clock`` if it is time to: the bag's time, which stands still in a pause."""
        now = time.monotonic_ns()
        if self._clock_out is None or now < self._next_clock_ns:
            return
        period = round(NANOSECONDS / self._options.clock_hz)
        self._next_clock_ns += (1 + (now - self._next_clock_ns) // period) * period
        message = Clock()
        set_stamp(message.clock, self.timeline.bag_ns(now))
        self._clock_out.publish(message)

    def wait_s(self, message: Message) -> float:
        """Return how long nothing is to be done before a message, in finite bounds."""
        now = time.monotonic_ns()
        # Who resumes does not want to wait for the end of a long wait.
        longest_s = SHORT_WAIT_S if self.timeline.paused else LONGEST_WAIT_S
        next_ns = now + round(longest_s * NANOSECONDS)
        if not self.timeline.paused:
            next_ns = min(next_ns, self.timeline.deadline_ns(message[1]))
        if self._clock_out is not None:
            next_ns = min(next_ns, self._next_clock_ns)
        return max((next_ns - now) / NANOSECONDS, SHORTEST_WAIT_S)

    def settle(self) -> None:
        """Wait, for a while at most, until reliable subscribers have everything."""
        reliable = [
            publisher
            for publisher in self._sent.values()
            if publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE
        ]
        wait_until_acknowledged(reliable, ACKNOWLEDGE_S)

    def _publisher(self, name: str) -> Any:
        topic = self._bag.topics[name]
        prefix = self._options.namespace.strip("/")
        target = self._options.remaps.get(name) or (f"/{prefix}{name}" if prefix else name)
        return self.create_publisher(
            message_class(topic.type), target, adapted_offer(topic.offered)
        )

    def _publish(self, name: str, data: bytes) -> None:
        # The bag's own /clock is left out where this node makes one.
        if name in self._sent:
            self._sent[name].publish(data)
            self.published += 1

    def _service(self, act: Any) -> Any:
        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            act()
            response.success = True
            response.message = "paused" if self.timeline.paused else "playing"
            return response

        return answer


def play(options: PlayOptions) -> int:
    """Play until the end or a signal; print a report; return the exit code."""
    stop = StopRequest()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        with BagReader(options.path) as bag, Keyboard() as keyboard, ExitStack() as ends:
            cut = cut_of(bag, options.topics, options.start_offset_s, options.duration_s)
            node = BagPlayerNode(bag, cut, options)
            ends.callback(node.destroy_node)
            executor = EventsExecutor()
            executor.add_node(node)
            _wait_for_subscribers(node, executor, stop, options.wait_s)
            if keyboard.is_there:
                print("space pauses and resumes; Ctrl-C ends it", flush=True)
            paused = options.paused
            while not stop.asked:
                _play_once(node, bag, cut, executor, stop, keyboard, paused)
                paused = False
                if not options.loop:
                    break
            node.settle()
        late_ms = node.latest_ns / 1e6
        print(f"{node.published} messages played, {late_ms:.1f} ms late at worst", flush=True)
        return 0
    except HapticMechError as error:
        sys.stderr.write(f"error: {error}\n")
        return 1
    finally:
        rclpy.try_shutdown()


def _play_once(
    node: BagPlayerNode,
    bag: BagReader,
    cut: Cut,
    executor: Executor,
    stop: StopRequest,
    keyboard: Keyboard,
    paused: bool,
) -> None:
    first = latched_first(bag, cut)
    with closing(read_ahead(stream(bag, cut, first))) as ahead:
        message = next(ahead, None)
        node.begin(first, paused)
        while message is not None and not stop.asked:
            if " " in keyboard.pressed():
                node.toggle_paused()
            node.tick_clock()
            for _ in range(LONGEST_BURST):
                if message is None or not node.publish_due(message):
                    break
                message = next(ahead, None)
            if message is not None:
                wait_for_messages(executor, node.wait_s(message))


def _wait_for_subscribers(
    node: BagPlayerNode, executor: Executor, stop: StopRequest, longest_s: float
) -> None:
    end = time.monotonic() + longest_s
    while longest_s > 0.0 and not stop.asked and (deaf := node.deaf()):
        if time.monotonic() > end:
            print(f"playing without subscribers of {', '.join(deaf)}", flush=True)
            return
        wait_for_messages(executor, SHORT_WAIT_S)
