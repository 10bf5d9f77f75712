# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a recording can feed into a graph in lockstep."""

from __future__ import annotations

from collections.abc import Sequence

from hapticmech_ros.errors import InvalidInputError

FEEDS = ("hand", "device", "external")


def check_feeds(kinds: Sequence[str]) -> None:
    """Refuse what cannot be fed.

    Raises:
        InvalidInputError: not one of :data:`FEEDS`.
    """
    for kind in kinds:
        if kind not in FEEDS:
            raise InvalidInputError("feed", kind, f"must be one of {', '.join(FEEDS)}")
