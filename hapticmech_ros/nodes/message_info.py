# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Callbacks that get a message and what the middleware says of it, with any executor.

rclpy looks at a callback's signature to see whether it takes one argument or two. For a callback of
two, the events executor of ROS 2 Jazzy hands both over as one tuple, and ends in a SystemError.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

Info = Mapping[str, Any]
_POSITIONAL = inspect.Parameter.POSITIONAL_ONLY


class WithInfo:
    """Passes messages on to ``function(message, info)``, whichever way they are handed over.

    ``info`` has ``source_timestamp`` and ``received_timestamp`` (ns, by the machines' clocks) and
    ``publication_sequence_number``, which each publisher counts up by one.
    """

    # What rclpy sees: two arguments. What may come: a message and its info, or a pair of them.
    __signature__ = inspect.Signature(
        [inspect.Parameter(name, _POSITIONAL) for name in ("message", "info")]
    )

    def __init__(self, function: Callable[[Any, Info], None]) -> None:
        self._function = function

    def __call__(self, *arguments: Any) -> None:
        """Hand over one message."""
        message, info = arguments if len(arguments) == 2 else arguments[0]
        self._function(message, info)
