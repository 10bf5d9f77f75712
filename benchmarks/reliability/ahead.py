"""Processes that stand for hardware or measure come before the nodes, as hardware does."""

from __future__ import annotations

from hapticmech_ros.nodes.parameters import NodeParameters
from hapticmech_ros.nodes.scheduling import ask_for_real_time

BY = 10


def run_ahead_of_nodes() -> None:
    """Ask for a real-time priority above the nodes', which they have where this is granted."""
    ask_for_real_time(NodeParameters.model_fields["thread_priority"].default + BY)
