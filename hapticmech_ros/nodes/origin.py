# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whom a message comes from, as far as a subscriber can know."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

# By the middleware, which does not tell which publisher sent a message.
MIDDLEWARE = 0
# From a node of this process.
WITHIN = -1
# Of what stands for a publisher on the lane, the part that is its number in its process; the rest
# is its process's connection.
OUTLETS = (1 << 32) - 1


class Origin(NamedTuple):
    """The way of a message, and its publisher where that is known.

    Attributes:
        via: :data:`MIDDLEWARE`, :data:`WITHIN`, or the one publisher on the lane that this stands
            for in this process.
        number: by which its publisher counts what it sends through the middleware.
        sent: by which it counts what it sends over the lane; 0: it came another way.
        sent_ns: when it was sent, ns of the sending machine's clock; 0: that is not known.
    """

    via: int
    number: int
    sent: int = 0
    sent_ns: int = 0


INSIDE = Origin(WITHIN, 0)

Listener = Callable[[bytes, Origin], None]
# Of a topic's messages that came together, in the order in which they were sent.
Batch = list[tuple[bytes, Origin]]
BatchListener = Callable[[Batch], None]
