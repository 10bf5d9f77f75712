# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Flat arrays of numbers as named fields, one after the other: what messages and kernels hand on.

A layout is written down once. Where a field is, how long the array is, what labels a message has
and how large each number may be all follow from that.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

SECONDS = ("seconds", "nanoseconds")
TWIST = ("linear_velocity",) * 3 + ("angular_velocity",) * 3
WRENCH = ("force",) * 3 + ("torque",) * 3
# Of a number that may be anything finite.
ANY = "finite number"


class Field(NamedTuple):
    """Some numbers of a layout.

    Attributes:
        size: how many.
        quantities: what they are, over and over; see :mod:`~hapticmech_ros.wire.bounds`.
    """

    size: int
    quantities: tuple[str, ...] = (ANY,)


class Layout(Mapping[str, int]):
    """Fields by name, in order; as a mapping, from each name to its size.

    Args:
        fields: name -> field.

    Attributes:
        fields: these.
        size: of the whole array.
    """

    def __init__(self, fields: Mapping[str, Field]) -> None:
        self.fields = dict(fields)
        self._starts: dict[str, int] = {}
        self.size = 0
        for name, field in self.fields.items():
            self._starts[name] = self.size
            self.size += field.size

    def __getitem__(self, name: str) -> int:
        return self.fields[name].size

    def __iter__(self) -> Iterator[str]:
        return iter(self.fields)

    def __len__(self) -> int:
        return len(self.fields)

    def start(self, name: str) -> int:
        """Return the index of a field's first number."""
        return self._starts[name]

    def starts(self, *names: str) -> tuple[int, ...]:
        """Return the indices of several fields' first numbers."""
        return tuple(map(self.start, names))

    def slice(self, first: str, last: str = "") -> slice:
        """Return where a field is, or all fields from one to another, both included."""
        end = last or first
        return slice(self._starts[first], self._starts[end] + self.fields[end].size)

    def quantities(self) -> Iterator[str]:
        """Return what each number of the array is."""
        for field in self.fields.values():
            for index in range(field.size):
                yield field.quantities[index % len(field.quantities)]


# What a device measures: where the point held is, how it moves, and F_h.
DEVICE_SAMPLE = Layout(
    {
        "position": Field(3, ("position",)),
        "quaternion": Field(4, ("quaternion",)),
        "twist": Field(6, TWIST),
        "hand_wrench": Field(6, WRENCH),
    }
)
# What rendering needs of an operational point: s, X, P_c, Π and a_0, its pose and twist, and F_c.
# Matrices go row by row; of s and of rows that the task space does not have, the rest is zero.
OPERATIONAL_MODEL = Layout(
    {
        "s": Field(6, ("ratio",)),
        "inverse_inertia": Field(36, ("inverse_inertia",)),
        "constraint_projector": Field(36, ("ratio",)),
        "wrench_projector": Field(36, ("ratio",)),
        "free_acceleration": Field(6, ("acceleration",)),
        "position": Field(3, ("position",)),
        "quaternion": Field(4, ("quaternion",)),
        "twist": Field(6, TWIST),
        "contact": Field(6, WRENCH),
    }
)
