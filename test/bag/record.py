# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of messages that tests have made."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from hapticmech_ros.bag import BagWriter

Bytes = Callable[[int, float], bytes]
WRENCH = "geometry_msgs/msg/WrenchStamped"
MS = 1_000_000


def metadata(bag: Path) -> dict[str, Any]:
    """Return a bag's metadata as another reader of YAML has them."""
    text = (bag / "metadata.yaml").read_text(encoding="utf-8")
    found: dict[str, Any] = YAML(typ="safe").load(text)["rosbag2_bagfile_information"]
    return found


def record(
    path: Path,
    messages: Iterable[tuple[str, int, bytes]],
    storage: str = "mcap",
    msgtype: str = WRENCH,
    qos: str = "stream",
    split_ns: int | None = None,
) -> Path:
    """Write topics, times of reception (ns) and serialized messages; return the bag's path."""
    with BagWriter(path, storage, split_ns=split_ns) as bag:
        for name, time_ns, data in messages:
            if name not in bag.counts:
                bag.add_topic(name, msgtype, qos)
            bag.write(name, time_ns, data)
    return path
