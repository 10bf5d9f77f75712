# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Designs of studies, as tests write them."""

from __future__ import annotations

from typing import Any

from hapticmech_ros.study import Design, Variation


def of(*texts: str, **more: Any) -> Design:
    """Return the design of variations that are written as the command takes them."""
    return Design(tuple(map(Variation.read, texts)), **more)
