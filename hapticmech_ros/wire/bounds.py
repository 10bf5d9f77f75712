# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bounds of the numbers in messages, by the quantity of each.

A layout defines each number's quantity; a scene's ``limits`` its largest size. Received and sent
messages are checked against the same bounds, by one comparison of all numbers, which no NaN and no
infinity passes.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hapticmech_ros.compilation.records import ANY, Layout
from hapticmech_ros.errors import InvalidInputError, OutputError
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene.document import Limits
from hapticmech_ros.wire.kernels import QUATERNION_TOLERANCE, UNSOUND, sound_stamp
from hapticmech_ros.wire.messages import Kind, Message
from hapticmech_ros.wire.stamped import LAST_SECOND, stamp_of

# Quantities without limits in scenes.
FIXED: dict[str, float] = {
    "seconds": float(LAST_SECOND),
    "nanoseconds": 999_999_999.0,
    "quaternion": sys.float_info.max,  # its length is checked
    "duration": 3600.0,
    "count": 6.0,
    "flags": 1.0,
    "link": 1e6,
    "angle": 1e6,
}


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """Bounds of a flat message, which begins with its stamp.

    Attributes:
        what: the message's name, for errors.
        quantities: of each of its n numbers.
        most: (n,) their largest sizes.
        quaternion: index of the first of a quaternion's numbers; -1 for none.
    """

    what: str
    quantities: tuple[str, ...]
    most: Array
    quaternion: int

    def stamp(self, values: Array) -> int:
        """Return the stamp (ns) of a message's data that keeps every rule.

        Args:
            values: (n,) the data, float64 in C order: the kernel does not check that.

        Raises:
            InvalidInputError: wrong length, a number beyond its bound or not finite, a quaternion
                off unit length, or a stamp that is none.
        """
        if values.shape == self.most.shape:
            stamp = sound_stamp(values, self.most, self.quaternion, QUATERNION_TOLERANCE)
            if stamp != UNSOUND:
                return stamp
        return self._refusal(values)

    def checked(self, data: object) -> tuple[int, Array]:
        """Return the stamp (ns) of a message's data, and the data as an array of their own (n,).

        Raises:
            InvalidInputError: as :meth:`stamp`.
        """
        # Numbers inside a message's bytes need not lie as kernels expect.
        values = np.array(data, dtype=float)
        return self.stamp(values), values

    def check_output(self, values: Array) -> None:
        """Check a message to be sent by the same rules.

        Args:
            values: (n,) the data.

        Raises:
            OutputError: as :meth:`stamp`.
        """
        try:
            self.stamp(values)
        except InvalidInputError as error:
            raise OutputError(error.what, error.value, error.rule) from None

    def keeps(self, rows: Array) -> npt.NDArray[np.bool_]:
        """Return which of n messages' data (n, size) are certain to keep bounds and stamps (n,).

        A quaternion's length is not checked.

        Args:
            rows: (n, size) data of messages.
        """
        with np.errstate(invalid="ignore"):
            within = (np.abs(rows) <= self.most).all(axis=1)
            stamps = rows[:, :2]
            stamped = (stamps >= 0.0) & (stamps == np.floor(stamps))
            return np.asarray(within & stamped.all(axis=1))

    def _refusal(self, values: Array) -> int:
        """Return the stamp, or name the rule that is broken."""
        if values.shape != self.most.shape:
            rule = f"must hold {self.most.size} numbers"
            raise InvalidInputError(f"{self.what} message", values.size, rule)
        wrong = np.flatnonzero(~np.isfinite(values))
        if wrong.size:
            where = f"{self.what} message[{wrong[0]}]"
            raise InvalidInputError(where, float(values[wrong[0]]), "must be finite")
        stamp = stamp_of(float(values[0]), float(values[1]))
        wrong = np.flatnonzero(np.abs(values) > self.most)
        if wrong.size:
            at = int(wrong[0])
            where = f"{self.what} message[{at}]"
            rule = _rule(self.quantities[at], self.most[at])
            raise InvalidInputError(where, float(values[at]), rule)
        if self.quaternion >= 0:
            check_unit(values[self.quaternion : self.quaternion + 4])
        return stamp


@dataclass(frozen=True, slots=True)
class SixBounds:
    """Bounds of a wrench or twist: three numbers of one quantity and three of another.

    Attributes:
        what: its name, for errors.
        quantities: of the first and the last three.
        first, last: their largest sizes.
    """

    what: str
    quantities: tuple[str, str] = (ANY, ANY)
    first: float = sys.float_info.max
    last: float = sys.float_info.max

    def check(self, six: Sequence[float]) -> None:
        """Refuse six numbers if one is too large, or not finite.

        Raises:
            InvalidInputError: a number beyond its bound, or not finite.
        """
        x, y, z, a, b, c = six
        f, t = self.first, self.last
        if not (
            -f <= x <= f
            and -f <= y <= f
            and -f <= z <= f
            and -t <= a <= t
            and -t <= b <= t
            and -t <= c <= t
        ):
            self._refusal(six)

    def check_output(self, six: Sequence[float]) -> None:
        """Check a message to be sent by the same rules.

        Raises:
            OutputError: as :meth:`check`.
        """
        try:
            self.check(six)
        except InvalidInputError as error:
            raise OutputError(error.what, error.value, error.rule) from None

    def _refusal(self, six: Sequence[float]) -> None:
        if not np.isfinite(six).all():
            raise InvalidInputError(self.what, list(six), "must be finite")
        at, most = (0, self.first) if max(map(abs, six[:3])) > self.first else (1, self.last)
        raise InvalidInputError(self.what, list(six), _rule(self.quantities[at], most))


ANY_WRENCH = SixBounds("wrench")


def wrench_bounds(limits: Limits) -> SixBounds:
    """Return the bounds of a wrench in a scene's messages."""
    return SixBounds("wrench", ("force", "torque"), limits.force, limits.torque)


def twist_bounds(limits: Limits) -> SixBounds:
    """Return the bounds of a twist in a scene's messages."""
    quantities = ("linear_velocity", "angular_velocity")
    return SixBounds("twist", quantities, limits.linear_velocity, limits.angular_velocity)


def pose_bounds(limits: Limits) -> SixBounds:
    """Return the bounds of a position and of a quaternion's x, y and z; not of its length."""
    return SixBounds("pose", ("position", ANY), limits.position)


def bounds_of(what: str, layout: Layout, limits: Limits | None = None) -> Bounds:
    """Return the bounds of a flat message.

    Args:
        what: its name, for errors.
        layout: its fields, the stamp first.
        limits: of the scene; None, for an unknown scene, bounds only stamps, flags and counts.
    """
    quantities = tuple(layout.quantities())
    most = np.array([_most(quantity, limits) for quantity in quantities])
    most.flags.writeable = False
    quaternion = quantities.index("quaternion") if "quaternion" in quantities else -1
    return Bounds(what, quantities, most, quaternion)


def message_bounds(kind: type[Message], limits: Limits | None = None) -> Bounds:
    """Return the bounds of a kind of message; see :func:`bounds_of`."""
    return bounds_of(kind.what, kind.layout, limits)


# Where no scene is known.
_any_bounds: dict[type[Message], Bounds] = {}


def read(kind: type[Kind], data: object, bounds: Bounds | None = None) -> Kind:
    """Return a message that keeps every rule; a copy.

    Args:
        kind: of the message.
        data: (n,) its numbers.
        bounds: of the message; None, where no scene is known: those of :func:`message_bounds`.

    Raises:
        InvalidInputError: as :meth:`Bounds.stamp`.
    """
    whole = kind.completed(np.asarray(data, dtype=float))
    if bounds is None and kind not in _any_bounds:
        _any_bounds[kind] = message_bounds(kind)
    _, values = (bounds or _any_bounds[kind]).checked(whole)
    return kind(values)


def check_unit(quaternion: Array) -> None:
    """Refuse a quaternion that is no rotation.

    Args:
        quaternion: (4,) x, y, z, w.

    Raises:
        InvalidInputError: off unit length by more than 1e-3.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        length = float(np.sqrt(quaternion @ quaternion))
    if not abs(length - 1.0) <= QUATERNION_TOLERANCE:
        rule = f"quaternion must have unit length within {QUATERNION_TOLERANCE:g}"
        raise InvalidInputError("length of quaternion", length, rule)


def _most(quantity: str, limits: Limits | None) -> float:
    if quantity in FIXED:
        return FIXED[quantity]
    if limits is None or quantity == ANY:
        return sys.float_info.max
    return float(getattr(limits, quantity))


def _rule(quantity: str, most: float) -> str:
    whose = quantity if quantity in FIXED else f"limits.{quantity} of the scene"
    return f"must be at most {most:g} in size ({whose})"
