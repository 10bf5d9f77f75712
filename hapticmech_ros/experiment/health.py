# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Health of a graph of nodes: their last diagnostics in a bag."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hapticmech_ros.bag import BagReader
from hapticmech_ros.bag.metadata import losses_of, read_metadata
from hapticmech_ros.errors import BagError
from hapticmech_ros.wire.topics import DIAGNOSTICS

Figure = int | float | str

LEVELS = {0: "ok", 1: "warning", 2: "error", 3: "stale"}


@dataclass(frozen=True, slots=True)
class NodeHealth:
    """Last status of a node.

    Attributes:
        level: ``ok``, ``warning``, ``error`` or ``stale``.
        message: of the node's diagnostics.
        figures: values by name, as numbers where possible; units are in the names.
    """

    level: str
    message: str
    figures: Mapping[str, Figure]


@dataclass(frozen=True, slots=True)
class GraphHealth:
    """How the run of a graph went.

    Attributes:
        nodes: last status of every node, by its name; empty if the bag has no diagnostics.
        lost: messages that the recorder lost, of each topic that lost any (None: not known); None
            where it has not counted.
        interruptions: how often rendering was interrupted once the hands had started; None: nobody
            has counted.
        reduced_gains: whether a controller had to reduce its gains for a longer delay; None: not
            known.
    """

    nodes: Mapping[str, NodeHealth]
    lost: Mapping[str, int | None] | None = None
    interruptions: int | None = None
    reduced_gains: bool | None = None

    def total(self, figure: str) -> float | None:
        """Return the sum of a figure over the nodes that report it; None if none does."""
        values = [node.figures[figure] for node in self.nodes.values() if figure in node.figures]
        numbers = [value for value in values if not isinstance(value, str)]
        return sum(numbers) if numbers else None

    def one(self, figure: str) -> Figure | None:
        """Return a figure of the first node that reports it; None if none does."""
        for node in self.nodes.values():
            if figure in node.figures:
                return node.figures[figure]
        return None


def health_from_bag(path: str | os.PathLike[str]) -> GraphHealth:
    """Return the last status of every node in the bag at ``path``, and what its recorder lost.

    Raises:
        BagError: no bag, a damaged one, or ``/diagnostics`` of another type.
    """
    last: dict[str, NodeHealth] = {}
    lost = losses_of(read_metadata(Path(path)))
    with BagReader(path) as bag:
        topic = bag.topics.get(DIAGNOSTICS.name)
        if topic is None:
            return GraphHealth({}, lost)
        if topic.type != DIAGNOSTICS.type:
            found = f"{DIAGNOSTICS.name} is {topic.type}, should be {DIAGNOSTICS.type}"
            raise BagError(f"bag {path}: {found}")
        for item in bag.messages(DIAGNOSTICS.name):
            for status in item.message.status:
                last[status.name] = _node(status)
    return GraphHealth(dict(sorted(last.items())), lost)


def _node(status: Any) -> NodeHealth:
    level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
    figures = {pair.key: _figure(pair.value) for pair in status.values}
    return NodeHealth(LEVELS.get(level, str(level)), status.message, figures)


def _figure(text: str) -> Figure:
    for kind in (int, float):
        try:
            value = kind(text)
        except ValueError:
            continue
        # JSON has neither infinity nor NaN.
        return value if abs(value) < float("inf") else text
    return text
