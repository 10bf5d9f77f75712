# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Durations as people write them."""

from __future__ import annotations

import re

from hapticmech_ros.errors import InvalidInputError

_UNITS = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6}


def seconds_of(option: str, text: str) -> float:
    """Return a duration in s: ``50ms``, ``0.05s``, or a bare number of seconds.

    Args:
        option: that the text was given to.
        text: a number that is not negative, and a unit.

    Raises:
        InvalidInputError: it is no duration.
    """
    found = re.fullmatch(r"([0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?)\s*(s|ms|us|)", text.strip())
    if found is None:
        raise InvalidInputError(option, text, "must be a duration such as 50ms or 0.05s")
    return float(found[1]) * _UNITS[found[2]]
