# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which messages of a bag to play, and in which order: latched ones first.

And the clock of a replay: which bag time it is, at which rate, and whether it stands still.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rosbags.interfaces import QosDurability

from hapticmech_ros.bag.reader import BagReader, BagTopic
from hapticmech_ros.errors import BagError, InvalidInputError
from hapticmech_ros.times import NANOSECONDS, nanoseconds

Message = tuple[str, int, bytes]
# A recorder hears latched messages only when discovery is through: until then they count as there
# from the beginning.
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
        duration_s: and what comes so much later than that, s.

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
        raise BagError(f"bag {bag.path}: nothing to play behind {start_offset_s:g} s")
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

    Deadlines are absolute: whatever is late does not delay what comes after it.

    Args:
        bag_ns: time of the bag at the beginning.
        now_ns: steady time then.
        rate: bag seconds per second.

    Raises:
        InvalidInputError: a rate that is not positive.
    """

    def __init__(self, bag_ns: int, now_ns: int, rate: float = 1.0, paused: bool = False) -> None:
        if not rate > 0.0:
            raise InvalidInputError("rate", rate, "must be positive")
        self._rate = rate
        self._bag_ns, self._from_ns = bag_ns, now_ns
        self.paused = paused

    def bag_ns(self, now_ns: int) -> int:
        """Return the bag's time."""
        if self.paused:
            return self._bag_ns
        return self._bag_ns + round((now_ns - self._from_ns) * self._rate)

    def deadline_ns(self, bag_ns: int) -> int:
        """Return when a time of the bag comes, if nobody pauses."""
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
