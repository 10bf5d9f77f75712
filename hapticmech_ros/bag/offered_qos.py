# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What publishers offer, as rosbag2 writes it down: for each topic of this package; read back.

A player gives these profiles to its own publishers, so latched topics stay latched on replay.
"""

from __future__ import annotations

from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.metadata import parse_qos

from hapticmech_ros.errors import BagError, FileError
from hapticmech_ros.yaml_text import read_yaml

# "For ever" as rmw and rosbag2 write it: the largest count of nanoseconds in 64 bits.
INFINITE = QosTime(9223372036, 854775807)
# Of history depths and seconds.
_LARGEST = 2**63 - 1


def _offered(depth: int, durability: QosDurability) -> Qos:
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=depth,
        reliability=QosReliability.RELIABLE,
        durability=durability,
        deadline=INFINITE,
        lifespan=INFINITE,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=INFINITE,
        avoid_ros_namespace_conventions=False,
    )


_STREAM = _offered(10, QosDurability.VOLATILE)

# Names as in wire/topics.py. Every publisher of the graph is reliable, whatever its readers ask.
OFFERED: dict[str, Qos] = {
    "control": _STREAM,
    "stream": _STREAM,
    "command": _STREAM,
    "latched": _offered(1, QosDurability.TRANSIENT_LOCAL),
}


def offered_qos(name: str) -> Qos:
    """Return the profile of a topic's ``qos`` name.

    Raises:
        BagError: unknown name.
    """
    if name not in OFFERED:
        raise BagError(f"quality of service {name!r}: must be one of {sorted(OFFERED)}")
    return OFFERED[name]


def read_offers(said: object) -> tuple[Qos, ...]:
    """Return the profiles that a bag has for a topic.

    Args:
        said: a list of mappings, or text: YAML of such a list.

    Raises:
        ReaderError: not profiles as rosbag2 writes them.
    """
    try:
        items = read_yaml(said, "offered_qos_profiles") if isinstance(said, str) else said
        if items is None:
            return ()
        if not isinstance(items, list):
            raise TypeError("not a list")
        found = tuple(parse_qos(items))
    except (FileError, TypeError, KeyError, AttributeError, ValueError) as error:
        raise ReaderError(f"offered_qos_profiles cannot be read ({error})") from None
    for offer in found:
        times = (offer.deadline, offer.lifespan, offer.liveliness_lease_duration)
        numbers = [offer.depth, *(part for time in times for part in (time.sec, time.nsec))]
        if not all(type(number) is int and 0 <= number <= _LARGEST for number in numbers):
            raise ReaderError(f"offered_qos_profiles have a number out of range ({offer})")
    return found
