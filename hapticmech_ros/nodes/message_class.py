# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Classes of message types by name."""

from __future__ import annotations

import importlib
from typing import Any

from hapticmech_ros.errors import BagError


def message_class(msgtype: str) -> Any:
    """Return the Python class of a message type.

    Raises:
        BagError: its package is not installed, or has no such message.
    """
    package, _, kind = msgtype.partition("/msg/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), kind)
    except (ImportError, AttributeError, ValueError):
        raise BagError(f"message type {msgtype!r}: its package is not installed") from None
