# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Quality of service between a graph and a bag: what to ask for, what to offer."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.duration import Duration, Infinite
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from hapticmech_ros.bag.metadata import INFINITE
from hapticmech_ros.times import NANOSECONDS

# A bag may be busy for a while: at 2 kHz this is half a second of one topic.
RECORDED_DEPTH = 1000
# History of a player's publisher: what it sends in one burst after a stall stays in it.
PLAYED_DEPTH = 1000
# Of a latched one, if the bag does not know: whoever comes late gets no more than this.
LATCHED_DEPTH = 10


def as_recorded(profile: QoSProfile) -> Qos:
    """Return a publisher's profile as it goes into a bag; discovery knows no history with DDS."""
    return Qos(
        history=QosHistory(int(profile.history)),
        depth=int(profile.depth),
        reliability=QosReliability(int(profile.reliability)),
        durability=QosDurability(int(profile.durability)),
        deadline=_time(profile.deadline),
        lifespan=_time(profile.lifespan),
        liveliness=QosLiveliness(int(profile.liveliness)),
        liveliness_lease_duration=_time(profile.liveliness_lease_duration),
        avoid_ros_namespace_conventions=bool(profile.avoid_ros_namespace_conventions),
    )


def adapted_request(offered: Sequence[QoSProfile]) -> QoSProfile:
    """Return the most that a subscriber may ask for and still hear every one of the publishers.

    Reliable if all are, and latched messages if all keep them; deadlines and the like are not
    asked for.
    """
    reliable = all(o.reliability == ReliabilityPolicy.RELIABLE for o in offered)
    latched = all(o.durability == DurabilityPolicy.TRANSIENT_LOCAL for o in offered)
    return _profile(RECORDED_DEPTH, reliable, latched and bool(offered))


def adapted_offer(recorded: Sequence[Qos]) -> QoSProfile:
    """Return an offer that every subscriber takes which one of the recorded publishers suited.

    Without recorded profiles it is reliable and volatile.
    """
    reliable = QosReliability.BEST_EFFORT not in {r.reliability for r in recorded} or any(
        r.reliability is QosReliability.RELIABLE for r in recorded
    )
    latched = [r for r in recorded if r.durability is QosDurability.TRANSIENT_LOCAL]
    depth = PLAYED_DEPTH
    if latched:
        known = [r.depth for r in latched if r.history is QosHistory.KEEP_LAST and r.depth > 0]
        depth = max(known, default=LATCHED_DEPTH)
    return _profile(depth, reliable, bool(latched))


def _profile(depth: int, reliable: bool, latched: bool) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def _time(duration: Duration) -> QosTime:
    nanoseconds = duration.nanoseconds
    if nanoseconds <= 0 or duration == Infinite:
        return INFINITE
    return QosTime(*divmod(nanoseconds, NANOSECONDS))
