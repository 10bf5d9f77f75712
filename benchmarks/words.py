# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Words that a command is given, such as names of scenes: none but those that there are."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from hapticmech_ros.errors import InvalidInputError


def refuse_unknown(what: str, words: Iterable[str], known: Collection[str]) -> None:
    """Refuse words that are not among those that there are.

    Args:
        what: the words are.
        words: that were given.
        known: that there are.

    Raises:
        InvalidInputError: one that is not known.
    """
    for word in words:
        if word not in known:
            raise InvalidInputError(what, word, f"must be one of {', '.join(known)}")
