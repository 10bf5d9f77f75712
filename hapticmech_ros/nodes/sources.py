# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Origins of messages: detects a second publisher on a topic that one node may publish on.

A ROS subscriber does not know a message's publisher, but each publisher counts its messages.
Numbers of one publisher increase; those of two interleave. A publisher that is idle, or has died
unnoticed, sends nothing and is no second one.

Messages from the middleware may be late: after its publisher has changed to the lane, the
middleware may deliver seconds-old messages, if its own threads get no processor. Such a message is
another publisher's only if the middleware lists two publishers, or has delivered that number
already.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from hapticmech_ros.numerics.times import NANOSECONDS

# By the middleware, which does not identify a message's publisher.
MIDDLEWARE = 0
# Bits of a lane publisher's id for its number in its process; the others are its process's
# connection.
OUTLETS = (1 << 32) - 1


class Origin(NamedTuple):
    """The path of a message, and its publisher where that is known.

    Attributes:
        via: :data:`MIDDLEWARE`, or the id of one publisher on the lane in this process.
        number: of its publisher's messages through the middleware.
        sent: number of its messages over the lane; 0: it did not come over the lane.
        sent_ns: when it was sent, ns of the sending machine's clock; 0: that is not known.
    """

    via: int
    number: int
    sent: int = 0
    sent_ns: int = 0


NO_ORIGIN = Origin(-1, 0)

Listener = Callable[[bytes, Origin], None]
# Of a topic's messages that came together, in the order in which they were sent.
Batch = list[tuple[bytes, Origin]]
BatchListener = Callable[[Batch], None]


Info = Mapping[str, Any]
_POSITIONAL = inspect.Parameter.POSITIONAL_ONLY


class WithInfo:
    """Passes messages on to ``function(message, info)``, with any executor.

    rclpy looks at a callback's signature to see whether it takes one argument or two. For a
    callback of two, the events executor of ROS 2 Jazzy hands both over as one tuple, and ends in a
    SystemError.

    ``info`` has ``source_timestamp`` and ``received_timestamp`` (ns, by the machines' clocks) and
    ``publication_sequence_number``, which each publisher counts up by one.
    """

    # rclpy sees two arguments, but may pass a message and its info, or a pair of them.
    __signature__ = inspect.Signature(
        [inspect.Parameter(name, _POSITIONAL) for name in ("message", "info")]
    )

    def __init__(self, function: Callable[[Any, Info], None]) -> None:
        self._function = function

    def __call__(self, *arguments: Any) -> None:
        """Hand over one message."""
        message, info = arguments if len(arguments) == 2 else arguments[0]
        self._function(message, info)


# The number from a middleware that counts no messages (rmw: UINT64_MAX).
UNNUMBERED = (1 << 64) - 1
# A publisher counts as alive for so long after a message; or for so many of its own periods, if
# longer, but no longer than the last of these.
ALIVE_NS = NANOSECONDS // 10
ALIVE_PERIODS = 3
LONGEST_ALIVE_NS = NANOSECONDS // 2
# Messages sent through the middleware before a change of path have arrived after so long.
ARRIVED_NS = NANOSECONDS // 20
# A message that was sent so long ago is late: while a topic has suspicious messages, the middleware
# is checked more often.
LATE_NS = 3_000_000
# Two publishers count as two until one of them has been silent for so long: a process may stall for
# a while. If there are two again within AGAIN_NS after that, for longer: a publisher at 1 Hz must
# not let force return each second.
FORGET_NS = NANOSECONDS
AGAIN_NS = 3 * NANOSECONDS // 2
LONGER_FORGET_NS = 3 * NANOSECONDS
# Names are requested anew so often: messages may come before the middleware lists their publisher
# or knows its node, and its list keeps dead ones for a while.
NAMED_NS = NANOSECONDS // 10
# Numbers of one publisher increase by no more than this, even with losses.
LONGEST_GAP = 100_000
# A network may deliver numbers in another order, as far apart as this; but none twice.
REORDERED = 16
_MASK = (1 << REORDERED) - 1


class KnowsPublishers(Protocol):
    """The part of a node used to name publishers."""

    @property
    def get_publishers_info_by_topic(self) -> Any:
        """As of an rclpy node."""


@dataclass(slots=True)
class _Source:
    """One publisher: its path, highest number, which of the last ones were delivered, and when.

    Numbers count messages through the middleware. Messages on other paths carry that count.
    """

    via: int
    last: int
    recent: int
    received_ns: int
    sent: int = 0
    gap_ns: int = 0
    still: int = 0
    moved_ns: int = -1
    # Of the highest number and those below, which should not be in flight any more.
    over: int = 0

    def takes(self, number: int) -> bool:
        """Return whether a middleware's message can be this publisher's next, or a late one."""
        if self.via < MIDDLEWARE:
            return False
        ahead = number - self.last
        if ahead > 0:
            return ahead <= LONGEST_GAP
        return -ahead < REORDERED and not (self.recent | self.over) >> -ahead & 1

    def may_be_before(self, origin: Origin) -> bool:
        """Return whether a message on a new path of the lane can be this publisher's next.

        It can if the middleware delivered its messages until now, or if its connection was made
        anew.
        """
        if not 0 <= origin.number - self.last <= LONGEST_GAP:
            return False
        anew = MIDDLEWARE < self.via < origin.via and 0 < self.sent < origin.sent
        return self.via == MIDDLEWARE or (anew and not (self.via ^ origin.via) & OUTLETS)

    def received(self, origin: Origin, now_ns: int) -> None:
        """Note a message."""
        ahead = origin.number - self.last
        if ahead > 0:
            self.last = origin.number
            self.recent = self.recent << min(ahead, REORDERED) & _MASK
            self.over = self.over << min(ahead, REORDERED) & _MASK
        if origin.via == MIDDLEWARE:
            self.recent |= 1 << max(-ahead, 0)
        else:
            self.sent = origin.sent
            # After so many messages and so long, none is in flight in the middleware any more.
            if ahead or self.moved_ns < 0:
                self.still, self.moved_ns = 0, now_ns
            self.still += ahead == 0
            if self.still >= REORDERED and now_ns - self.moved_ns >= ARRIVED_NS:
                self.over = _MASK
        self.gap_ns = now_ns - self.received_ns
        self.received_ns = now_ns

    def copied(self, number: int) -> bool:
        """Note that the middleware delivered a number too; return whether it had done so before."""
        behind = self.last - number
        if not 0 <= behind < REORDERED:
            return False
        before = bool(self.recent >> behind & 1)
        self.recent |= 1 << behind
        return before

    def alive(self, now_ns: int, least_ns: int = ALIVE_NS) -> bool:
        """Return whether it counts as alive; it does for ``least_ns`` after a message."""
        longest = max(least_ns, min(ALIVE_PERIODS * self.gap_ns, LONGEST_ALIVE_NS))
        return now_ns - self.received_ns <= longest


class Sources:
    """Watches that the messages of a topic come from one publisher.

    Args:
        node: that subscribes.
        topic: its full name.

    Attributes:
        latest: origin of the last message.
    """

    def __init__(self, node: KnowsPublishers, topic: str) -> None:
        self._node = node
        self._topic = topic
        self.latest = NO_ORIGIN
        self._sources: list[_Source] = []
        self._two = False
        self._single_ns = -AGAIN_NS
        self._forget_ns = FORGET_NS
        self._received_ns = 0
        self._named = ""
        self._named_ns = 0

    def received(self, origin: Origin, now_ns: int) -> None:
        """Note a message.

        Args:
            origin: of the message.
            now_ns: time of its arrival, ns.
        """
        self._received_ns = now_ns
        self.latest = origin
        via, number = origin.via, origin.number
        if via == MIDDLEWARE and number == UNNUMBERED:
            # There is only the middleware's list, which keeps dead publishers for a while.
            self._two = len(self._node.get_publishers_info_by_topic(self._topic)) > 1
            return
        source = self._nearest(number) if via == MIDDLEWARE else self._known(origin, now_ns)
        if source is None:
            if self._is_late(origin, now_ns):
                return
            # Its earlier messages through the middleware were not for this subscriber: none can
            # come late.
            recent = _MASK if via == MIDDLEWARE else 0
            self._add(_Source(via, number, recent, now_ns, origin.sent), now_ns)
        else:
            source.received(origin, now_ns)
        if len(self._sources) > 1:
            self._sources = [one for one in self._sources if one.alive(now_ns, self._forget_ns)]
        self._count(now_ns)

    def _count(self, now_ns: int) -> None:
        """Note whether there are two publishers, and for how long one may then be silent."""
        two = len(self._sources) > 1
        if two and not self._two:
            again = now_ns - self._single_ns < AGAIN_NS
            self._forget_ns = LONGER_FORGET_NS if again else FORGET_NS
        elif self._two and not two:
            self._single_ns = now_ns
        self._two = two

    def silent(self, now_ns: int) -> bool:
        """Return whether nobody has sent a message for a second (now in ns)."""
        return not any(one.alive(now_ns, FORGET_NS) for one in self._sources)

    @property
    def only(self) -> Origin | None:
        """The last message's origin, if all are of one publisher on the lane."""
        one = self._sources[0] if len(self._sources) == 1 else None
        alone = one is not None and one.via == self.latest.via > MIDDLEWARE
        return self.latest if alone else None

    def copied(self, number: int, now_ns: int) -> None:
        """Note that the middleware delivered a message received on another path.

        Args:
            number: by which its publisher counts it.
            now_ns: time of its arrival, ns.
        """
        on_lane = [one for one in self._sources if one.via > MIDDLEWARE]
        if len(on_lane) == 1 and on_lane[0].copied(number):
            # Another publisher's message was taken for it.
            self._add(_Source(MIDDLEWARE, number, _MASK, now_ns), now_ns)
            self._count(now_ns)

    def _nearest(self, number: int) -> _Source | None:
        """Return the publisher whose number it can be; of two, the one that lost least."""
        source, least = None, LONGEST_GAP + 1
        for one in self._sources:
            apart = abs(number - one.last)
            if apart < least and one.takes(number):
                source, least = one, apart
        return source

    def _is_late(self, origin: Origin, now_ns: int) -> bool:
        """Return whether a suspicious message is a late one of the only publisher."""
        late = origin.via == MIDDLEWARE and 0 < origin.sent_ns < now_ns - LATE_NS
        if not late or len(self._sources) != 1 or self._sources[0].via == MIDDLEWARE:
            return False
        if self._sources[0].copied(origin.number):
            return False
        return len(self._node.get_publishers_info_by_topic(self._topic)) < 2

    def _known(self, origin: Origin, now_ns: int) -> _Source | None:
        """Return a publisher that is known by the path of its messages, or was by their numbers."""
        via, number = origin.via, origin.number
        for one in self._sources:
            if one.via != via:
                continue
            if number < one.last:
                # It has not sent so many through the middleware: those were another publisher's.
                self._add(_Source(MIDDLEWARE, one.last, one.recent, now_ns), now_ns)
                one.last, one.recent, one.over = number, 0, 0
            return one
        # Until now its messages came on another path, if it is only one.
        found = [one for one in self._sources if one.may_be_before(origin)]
        if len(found) != 1:
            return None
        found[0].via = via
        return found[0]

    def _add(self, source: _Source, now_ns: int) -> None:
        self._sources = [*(one for one in self._sources if one.alive(now_ns)), source]

    def forget(self) -> None:
        """Forget the publishers."""
        self._sources.clear()
        self._two = False
        self._named = ""

    def fault(self, now_ns: int) -> str:
        """Return a sentence that names both if there are two; empty if there are not."""
        if not self._two or now_ns - self._received_ns > self._forget_ns:
            self._named = ""
            return ""
        if not self._named or now_ns - self._named_ns >= NAMED_NS:
            self._named_ns = now_ns
            self._named = f"more than one publisher of {self._topic}: {self._names()}"
        return self._named

    def _names(self) -> str:
        """Return the names of all publishers, two at least; equal ones get a suffix."""
        found = [
            (f"{info.node_namespace.rstrip('/')}/{info.node_name}", bytes(info.endpoint_gid))
            for info in self._node.get_publishers_info_by_topic(self._topic)
        ]
        names = [name for name, _ in found]
        distinct = [
            name if names.count(name) == 1 else f"{name} ({gid[4:16].hex()})"
            for name, gid in sorted(found)
        ]
        # Two have published, whatever the middleware lists.
        if len(distinct) < 2:
            distinct.append("one without a name" if distinct else "two without a name")
        return " and ".join(distinct)


def first_fault(sources: Iterable[Sources], now_ns: int) -> str:
    """Return a sentence that names two publishers of one topic; empty if none has two."""
    return next((fault for one in sources if (fault := one.fault(now_ns))), "")


STOPPED = "emergency stop"


class CommandGuard:
    """Watches the publishers of a device's commands.

    Args:
        sources: of each topic by which it is commanded; none may have a second publisher.
    """

    def __init__(self, *sources: Sources) -> None:
        self._sources = sources
        self.stopped = False

    def forget(self) -> None:
        """Forget the publishers; an emergency stop lasts."""
        for one in self._sources:
            one.forget()

    def fault(self, now_ns: int) -> str:
        """Return why the device must not obey; empty if it may."""
        if self.stopped:
            return STOPPED
        return first_fault(self._sources, now_ns)
