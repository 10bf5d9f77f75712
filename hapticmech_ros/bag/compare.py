# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compares two bags: a replay with its recording.

Messages of a topic are paired by their stamps, or the nearest ones, and compared field by field, as
named rows of numbers whatever their type.
"""

from __future__ import annotations

import math
import os
from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from hapticmech_ros.bag.reader import BagReader, flat_fields
from hapticmech_ros.errors import BagError, check_one_of
from hapticmech_ros.numerics import Array

Row = Array | str


def rows_of(message: Any) -> dict[str, Row]:
    """Return name -> numbers (n,), or text, of every field but the stamp.

    Names are joined by dots, such as ``wrench.force.x``. The data of a flat array have the names of
    its label.
    """
    if type(message).__name__.endswith("Float64MultiArray"):
        found = _labelled(message)
        if found:
            return found
    return dict(_walk(message, ""))


def deviation(a: Row, b: Row) -> Array:
    """Return absolute differences (n,) of two rows.

    Infinite where one is not a number and the other is, and (1,) infinite for rows of different
    length or different texts. NaN equals NaN, infinity equals itself.
    """
    if isinstance(a, str) or isinstance(b, str):
        same = isinstance(a, str) and isinstance(b, str) and a == b
        return np.array([0.0 if same else np.inf])
    if a.shape != b.shape:
        return np.array([np.inf])
    with np.errstate(invalid="ignore"):
        difference: Array = np.abs(a - b)
    difference[(a == b) | (np.isnan(a) & np.isnan(b))] = 0.0
    difference[np.isnan(difference)] = np.inf
    return difference


def _labelled(message: Any) -> dict[str, Row]:
    dimensions = message.layout.dim
    data = np.asarray(message.data, dtype=float)
    if len(dimensions) != 1:
        return {}
    sizes = flat_fields(dimensions[0].label)
    if not sizes or sum(sizes.values()) != data.size:
        return {}
    parts = np.split(data, np.cumsum(list(sizes.values())))
    return {name: part for name, part in zip(sizes, parts, strict=False) if name != "stamp"}


def _walk(value: Any, name: str) -> Iterator[tuple[str, Row]]:
    if is_dataclass(value) and not isinstance(value, type):
        for item in fields(value):
            is_stamp = item.name == "stamp" and name in ("", "header")
            # Names of rosbags' own.
            if is_stamp or item.name.startswith("__"):
                continue
            path = f"{name}.{item.name}" if name else item.name
            yield from _walk(getattr(value, item.name), path)
    elif isinstance(value, str):
        yield name, value
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        yield name, np.array(value, dtype=float).ravel()
    elif isinstance(value, (list, tuple, np.ndarray)):
        # Lists of different lengths then differ in ``.size``.
        yield f"{name}.size", np.array([float(len(value))])
        for index, item in enumerate(value):
            yield from _walk(item, f"{name}[{index}]")
    else:
        yield name, np.array([float(value)])


Pairs = list[tuple[int, int]]


def by_stamp(a: Sequence[int], b: Sequence[int]) -> Pairs:
    """Return pairs of equal stamps; of several with the same stamp first with first."""
    places: dict[int, deque[int]] = defaultdict(deque)
    for index, stamp in enumerate(b):
        places[stamp].append(index)
    return [(i, places[stamp].popleft()) for i, stamp in enumerate(a) if places.get(stamp)]


def by_nearest(a: Sequence[int], b: Sequence[int]) -> Pairs:
    """Return pairs of nearest stamps, no further apart than half the median period of ``a``.

    For runs whose clocks have nothing to do with each other. No message is in two pairs.
    """
    if not a or not b:
        return []
    left, right = np.asarray(a), np.asarray(b)
    a_order, b_order = np.argsort(left, kind="stable"), np.argsort(right, kind="stable")
    left, right = left[a_order], right[b_order]
    reach = float(np.median(np.diff(left))) / 2 if left.size > 1 else 0.0
    pairs: Pairs = []
    free = 0
    for index, stamp in enumerate(left):
        at = max(int(np.searchsorted(right, stamp)), free)
        near = [k for k in (at - 1, at) if free <= k < right.size]
        best = min(near, key=lambda k: abs(int(right[k]) - int(stamp)), default=None)
        if best is not None and abs(int(right[best]) - int(stamp)) <= reach:
            pairs.append((int(a_order[index]), int(b_order[best])))
            free = best + 1
    return sorted(pairs)


@dataclass(frozen=True, slots=True)
class FieldDeviation:
    """Deviations of one number, or text, of a message.

    Attributes:
        name: such as ``wrench.force.x``, or ``position[0]``.
        largest: absolute, in the field's own unit; infinite for different texts or sizes, and where
            only one is a number.
        rms: root of the mean square over all pairs.
        worst_at_ns: stamp of the message that deviates most (time of reception without stamps); 0
            if none deviates.
    """

    name: str
    largest: float
    rms: float
    worst_at_ns: int


class _Field:
    """Sums of one row of numbers."""

    def __init__(self, size: int) -> None:
        self.largest: Array = np.zeros(size)
        self.squares: Array = np.zeros(size)
        self.worst_at: NDArray[np.int64] = np.zeros(size, dtype=np.int64)

    def add(self, time_ns: int, difference: Array) -> None:
        if difference.size != self.largest.size:
            # Rows of other lengths than the first differ as a whole, unless both do and are equal.
            difference = np.full(self.largest.size, float(difference.max(initial=0.0)))
        worse = difference > self.largest
        self.largest[worse] = difference[worse]
        self.worst_at[worse] = time_ns
        self.squares += np.square(difference)


class Deviations:
    """Gathers pairs of serialized messages; equal bytes are not decoded.

    Args:
        decode_first: turns bytes of the first recording into a message.
        decode_second: the same for the second recording.

    Attributes:
        pairs: gathered so far.
        equal: those among them whose values, but for stamps, are the same bit for bit.
    """

    def __init__(
        self, decode_first: Callable[[bytes], Any], decode_second: Callable[[bytes], Any]
    ) -> None:
        self._decode_first, self._decode_second = decode_first, decode_second
        self._fields: dict[str, _Field] = {}
        self.pairs = 0
        self.equal = 0

    def add(self, time_ns: int, first: bytes, second: bytes) -> None:
        """Compare one pair.

        Raises:
            BagError: bytes that cannot be decoded.
        """
        self.pairs += 1
        if first == second:
            self.equal += 1
            if self._fields:
                return
        a = rows_of(self._decode_first(first))
        b = a if first == second else rows_of(self._decode_second(second))
        # Padding between values is not compared; rclpy leaves old bytes in it.
        self.equal += first != second and _bits(a) == _bits(b)
        for name in [*a, *(name for name in b if name not in a)]:
            self._add(name, time_ns, a.get(name), b.get(name))

    def _add(self, name: str, time_ns: int, a: Row | None, b: Row | None) -> None:
        difference = np.array([np.inf]) if a is None or b is None else deviation(a, b)
        if name not in self._fields:
            known = a if a is not None else b
            size = known.size if isinstance(known, np.ndarray) else 1
            self._fields[name] = _Field(max(size, 1))
        self._fields[name].add(time_ns, difference)

    def fields(self) -> tuple[FieldDeviation, ...]:
        """Return the deviations of every field over all pairs."""
        return tuple(
            FieldDeviation(
                name if field.largest.size == 1 else f"{name}[{index}]",
                float(field.largest[index]),
                float(np.sqrt(field.squares[index] / self.pairs)),
                int(field.worst_at[index]),
            )
            for name, field in self._fields.items()
            for index in range(field.largest.size)
        )


def _bits(rows: Mapping[str, Row]) -> dict[str, object]:
    return {
        name: (row.shape, row.tobytes()) if isinstance(row, np.ndarray) else row
        for name, row in rows.items()
    }


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
        equal: pairs whose values are the same to the last bit; stamps match pairs.
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
        expected: the first bag: the recording.
        actual: the second: the replay.
        align: ``stamp``, ``nearest`` or ``start``.
        topics: those in both bags.
        missing_topics: with messages in the first bag, and not in the second at all.
        extra_topics: with messages in the second only.
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
            # A zero is a stamp that was never set.
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
    """Compare two bags message by message; return the differences.

    Messages are matched by the senders' stamps (``header.stamp``, or the ``stamp`` of this
    package's flat arrays); those of topics without stamps by their order.

    Args:
        expected: the recording.
        actual: the replay.
        topics: names; all if empty.
        align: ``stamp`` requires the same stamps; ``nearest`` takes the nearest, half a period away
            at most; ``start`` does too, relative to the earliest stamp of each bag: for two similar
            runs.

    Raises:
        BagError: no bag, damaged, a topic that is in neither, or one of different types.
        InvalidInputError: another ``align``.
    """
    check_one_of("align", align, get_args(Align))
    with BagReader(expected) as first, BagReader(actual) as second:
        in_first, in_second = (
            set(topics or bag.topics) & set(bag.topics) for bag in (first, second)
        )
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


def _topic(name: str, a: _Recording, b: _Recording, shift: int, align: Align) -> TopicComparison:
    left, right = a.messages[name], b.messages[name]
    stamped = name in a.stamps and name in b.stamps
    pairs: Pairs
    if not stamped:
        pairs = [(i, i) for i in range(min(len(left), len(right)))]
    elif align == "stamp":
        pairs = by_stamp(a.stamps[name], b.stamps[name])
    else:
        pairs = by_nearest(a.stamps[name], [stamp + shift for stamp in b.stamps[name]])
    times = a.stamps[name] if stamped else a.times[name]
    deviations = Deviations(partial(a.bag.decode, name), partial(b.bag.decode, name))
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


def _number(value: float) -> float | str:
    return value if math.isfinite(value) else "inf"
