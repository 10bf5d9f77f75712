# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A process that stands for hardware comes before the nodes, as hardware does."""

from __future__ import annotations

from hapticmech_ros.nodes.realtime import ask_for_real_time

# Above what docs/nodes.md proposes for nodes.
PRIORITY = 60


def run_ahead_of_nodes() -> None:
    """Ask for a real-time priority above the nodes', or what is ordinary."""
    ask_for_real_time(PRIORITY)
