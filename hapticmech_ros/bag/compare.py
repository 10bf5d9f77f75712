# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compares two bags: what came out with what was recorded."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from hapticmech_ros.bag.deviations import Deviations, FieldDeviation
from hapticmech_ros.bag.matching import Pairs, by_nearest, by_order, by_stamp
from hapticmech_ros.bag.reader import BagReader
from hapticmech_ros.errors import BagError, InvalidInputError

Align = Literal["stamp", "nearest", "start"]


@dataclass(frozen=True, slots=True)
class TopicComparison:
    """One topic in two bags.

    Attributes:
        name: of the topic.
        type: of its messages.
        matched_by: ``stamp``, or ``order`` for messages without stamps.
        matched: pairs of messages.
        missing: messages of the first bag that have none in the second.
        extra: messages of the second bag that have none in the first.
        equal: pairs whose values are the same to the last bit; stamps are what matches them.
        fields: deviations of every field, in the order of the message.
    """

    name: str
    type: str
    matched_by: str
    matched: int
    missing: int
    extra: int
    equal: int
    fields: tuple[FieldDeviation, ...]

    @property
    def worst(self) -> FieldDeviation | None:
        """The field that deviates most; None if no messages were matched."""
        return max(self.fields, key=lambda field: field.largest, default=None)

    @property
    def largest(self) -> float:
        """Largest deviation of any field, in the field's own unit."""
        return self.worst.largest if self.worst else 0.0


@dataclass(frozen=True, slots=True)
class BagComparison:
    """Two bags, topic by topic.

    Attributes:
        expected: the first bag: what was recorded.
        actual: the second: what came out.
        align: ``stamp``, ``nearest`` or ``start``.
        topics: those in both bags.
        missing_topics: with messages in the first bag, and not in the second at all.
        extra_topics: the other way round.
    """

    expected: Path
    actual: Path
    align: Align
    topics: tuple[TopicComparison, ...]
    missing_topics: tuple[str, ...]
    extra_topics: tuple[str, ...]

    @property
    def largest(self) -> float:
        """Largest deviation of any field of any topic, each in its own unit."""
        return max((topic.largest for topic in self.topics), default=0.0)

    @property
    def is_exact(self) -> bool:
        """Whether no message is missing and every one that was matched is the same bit for bit."""
        return not self.missing_topics and all(
            topic.missing == 0 and topic.equal == topic.matched for topic in self.topics
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the report for JSON; an infinite deviation is the text ``inf``."""
        return {
            "expected": str(self.expected),
            "actual": str(self.actual),
            "align": self.align,
            "exact": self.is_exact,
            "largest": _number(self.largest),
            "missing_topics": list(self.missing_topics),
            "extra_topics": list(self.extra_topics),
            "topics": {
                topic.name: {
                    "type": topic.type,
                    "matched_by": topic.matched_by,
                    "matched": topic.matched,
                    "missing": topic.missing,
                    "extra": topic.extra,
                    "equal": topic.equal,
                    "fields": {
                        field.name: {
                            "largest": _number(field.largest),
                            "rms": _number(field.rms),
                            "worst_at_ns": field.worst_at_ns,
                        }
                        for field in topic.fields
                    },
                }
                for topic in self.topics
            },
        }


class _Recording:
    """The messages of one bag by topic; read in one pass and kept, as bytes."""

    def __init__(self, bag: BagReader, topics: Sequence[str]) -> None:
        self.bag = bag
        self.messages: dict[str, list[bytes]] = {name: [] for name in topics}
        self.times: dict[str, list[int]] = {name: [] for name in topics}
        self.stamps: dict[str, list[int]] = {}
        for name, time_ns, data in bag.serialized(*topics) if topics else ():
            self.messages[name].append(data)
            self.times[name].append(time_ns)
        for name in topics:
            read = bag.stamps_of(name)
            stamps = [read(data) for data in self.messages[name]] if read else []
            # A zero is a stamp that nobody filled in.
            known = [stamp for stamp in stamps if stamp]
            if known and len(known) == len(stamps):
                self.stamps[name] = known

    @property
    def first_stamp(self) -> int:
        """Earliest stamp of any topic, ns."""
        return min((min(stamps) for stamps in self.stamps.values()), default=0)


def compare(
    expected: str | os.PathLike[str],
    actual: str | os.PathLike[str],
    topics: Sequence[str] = (),
    align: Align = "stamp",
) -> BagComparison:
    """Compare two bags message by message; return what differs.

    Messages are matched by the senders' stamps (``header.stamp``, or the ``stamp`` of this
    package's flat arrays); those of topics without stamps by their order.

    Args:
        expected: what was recorded.
        actual: what came out.
        topics: names; all if empty.
        align: ``stamp`` asks for the same stamps; ``nearest`` takes the nearest, half a period away
            at most; ``start`` does so too, counting from the earliest stamp of each bag: for two
            runs of the same thing.

    Raises:
        BagError: no bag, damaged, a topic that is in neither, or one of different types.
        InvalidInputError: another ``align``.
    """
    if align not in get_args(Align):
        raise InvalidInputError("align", align, f"must be one of {', '.join(get_args(Align))}")
    with BagReader(expected) as first, BagReader(actual) as second:
        in_first, in_second = _chosen(first, topics), _chosen(second, topics)
        unknown = [name for name in topics if name not in in_first | in_second]
        if unknown:
            raise BagError(f"neither {first.path} nor {second.path}: topic {', '.join(unknown)}")
        both = sorted(in_first & in_second)
        for name in both:
            types = first.topics[name].type, second.topics[name].type
            if types[0] != types[1]:
                raise BagError(f"topic {name}: {types[0]} in one bag, {types[1]} in the other")
        a, b = _Recording(first, both), _Recording(second, both)
        shift = a.first_stamp - b.first_stamp if align == "start" else 0
        return BagComparison(
            first.path,
            second.path,
            align,
            tuple(_topic(name, a, b, shift, align) for name in both),
            tuple(sorted(n for n in in_first - in_second if first.topics[n].count)),
            tuple(sorted(n for n in in_second - in_first if second.topics[n].count)),
        )


def _chosen(bag: BagReader, topics: Sequence[str]) -> set[str]:
    return {name for name in bag.topics if not topics or name in topics}


def _topic(name: str, a: _Recording, b: _Recording, shift: int, align: Align) -> TopicComparison:
    left, right = a.messages[name], b.messages[name]
    stamped = name in a.stamps and name in b.stamps
    pairs: Pairs
    if not stamped:
        pairs = by_order(len(left), len(right))
    elif align == "stamp":
        pairs = by_stamp(a.stamps[name], b.stamps[name])
    else:
        pairs = by_nearest(a.stamps[name], [stamp + shift for stamp in b.stamps[name]])
    times = a.stamps[name] if stamped else a.times[name]
    deviations = Deviations(_decoder(a, name), _decoder(b, name))
    for i, j in pairs:
        deviations.add(times[i], left[i], right[j])
    return TopicComparison(
        name,
        a.bag.topics[name].type,
        "stamp" if stamped else "order",
        len(pairs),
        len(left) - len(pairs),
        len(right) - len(pairs),
        deviations.equal,
        deviations.fields(),
    )


def _decoder(recording: _Recording, name: str) -> Callable[[bytes], Any]:
    return lambda data: recording.bag.decode(name, data)


def _number(value: float) -> float | str:
    return value if math.isfinite(value) else "inf"
