"""What a publisher offers, as rosbag2 writes it down, for each kind of topic of this package.

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

from hapticmech_ros.errors import BagError

# "For ever" as rmw and rosbag2 write it: the largest count of nanoseconds in 64 bits.
INFINITE = QosTime(9223372036, 854775807)


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
