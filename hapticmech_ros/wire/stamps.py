# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stamps in messages: two numbers, which are looked at before anything is computed of them."""

from __future__ import annotations

from hapticmech_ros.errors import InvalidInputError, OutputError
from hapticmech_ros.times import NANOSECONDS

# builtin_interfaces/Time has seconds in 32 bits with a sign: it ends in January 2038.
LAST_SECOND = 2**31 - 1
LAST_NS = (LAST_SECOND + 1) * NANOSECONDS - 1
_RULE = f"must be whole numbers, seconds from 0 to {LAST_SECOND}, nanoseconds from 0 to 999999999"


def stamp_of(seconds: float, nanoseconds: float) -> int:
    """Return a message's stamp, ns.

    Raises:
        InvalidInputError: negative, no whole number, or beyond what a stamp can hold.
    """
    whole = 0 <= seconds <= LAST_SECOND and 0 <= nanoseconds < NANOSECONDS
    # Only now: what is no number is no whole one, and cannot become one.
    if not whole or seconds != int(seconds) or nanoseconds != int(nanoseconds):
        raise InvalidInputError("stamp, s and ns", (seconds, nanoseconds), _RULE)
    return int(seconds) * NANOSECONDS + int(nanoseconds)


def nearest_stamp(time_ns: int) -> int:
    """Return the time, ns, that a stamp can hold and that is nearest to one that it may not.

    For what must be said at any time: that all is at zero, and what is wrong.
    """
    return min(max(time_ns, 0), LAST_NS)


def seconds_of(time_ns: int) -> tuple[int, int]:
    """Return a time as a stamp has it, in s and ns.

    Raises:
        OutputError: before 1970, or beyond what a stamp can hold.
    """
    if not 0 <= time_ns <= LAST_NS:
        rule = f"seconds must be from 0 to {LAST_SECOND}, as builtin_interfaces/Time has them"
        raise OutputError("stamp, s", time_ns / NANOSECONDS, rule)
    return divmod(time_ns, NANOSECONDS)
