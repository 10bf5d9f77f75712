# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How far the messages of one topic deviate, field by field, over pairs of messages."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapticmech_ros.bag.fields import Row, deviation, rows_of


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
        self.largest: NDArray[np.float64] = np.zeros(size)
        self.squares: NDArray[np.float64] = np.zeros(size)
        self.worst_at: NDArray[np.int64] = np.zeros(size, dtype=np.int64)

    def add(self, time_ns: int, difference: NDArray[np.float64]) -> None:
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
        # What aligns one value behind another says nothing; rclpy leaves in it what was there.
        self.equal += first != second and _same_bits(a, b)
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


def _same_bits(a: Mapping[str, Row], b: Mapping[str, Row]) -> bool:
    if a.keys() != b.keys():
        return False
    for name, one in a.items():
        other = b[name]
        if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
            if one.shape != other.shape or one.tobytes() != other.tobytes():
                return False
        elif one is not other and one != other:
            return False
    return True
