# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a run's bag tells: hops as the recorder saw them, messages lost, and their sizes."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.graph.statuses import Percentiles, percentiles_of
from hapticmech_ros.bag import BagReader
from hapticmech_ros.experiment.from_bag import full_name
from hapticmech_ros.wire.cdr import array_stamp, header_stamp
from hapticmech_ros.wire.topics import (
    ARRAY,
    DEVICE_COMMAND,
    DEVICE_STATE,
    POINT_COMMAND,
    POINT_MODEL,
    STATE,
    TOPICS,
    Topic,
)

WATCHED = (DEVICE_STATE, DEVICE_COMMAND, POINT_COMMAND, STATE, POINT_MODEL)
RECORDED_TRIP = "device's deadline → servo_cf"
# Loss -> what is answered, by what.
ANSWERED = {
    "device/state → servo_cf": (DEVICE_STATE, DEVICE_COMMAND),
    "device/state → mechanism's servo_cf": (DEVICE_STATE, POINT_COMMAND),
    "mechanism/state → operational_model": (STATE, POINT_MODEL),
}


@dataclass(frozen=True, slots=True)
class Recorded:
    """A bag, evaluated.

    Attributes:
        hops: latencies by hop, of the window's messages; times are the recorder's.
        losses: what was not answered, by loss.
        published: messages of the window by topic.
        sizes: bytes of the smallest message by topic, of the whole bag.
    """

    hops: Mapping[str, Percentiles]
    losses: Mapping[str, Losses]
    published: Mapping[str, int]
    sizes: Mapping[str, int]


def recorded(bag: Path, point: str, window: tuple[int, int]) -> Recorded:
    """Return what a bag tells of a window (ns, of stamps and of reception alike).

    Raises:
        BagError: no bag, or damaged.
    """
    arrivals: dict[str, dict[int, int]] = {full_name(topic, point): {} for topic in WATCHED}
    readers = {
        full_name(topic, point): array_stamp if topic.type == ARRAY else header_stamp
        for topic in WATCHED
    }
    published: dict[str, int] = {}
    sizes: dict[str, int] = {}
    with BagReader(bag) as reader:
        for name, time_ns, data in reader.serialized():
            sizes[name] = min(len(data), sizes.get(name, len(data)))
            if window[0] <= time_ns < window[1]:
                published[name] = published.get(name, 0) + 1
            if name in arrivals:
                arrivals[name].setdefault(readers[name](data), time_ns)
    by_topic = {topic: arrivals[full_name(topic, point)] for topic in WATCHED}
    return Recorded(
        _hops(by_topic, window),
        {
            name: losses(by_topic[asked], by_topic[answer], window)
            for name, (asked, answer) in ANSWERED.items()
        },
        published,
        sizes,
    )


def steady_topics(point: str) -> set[str]:
    """Return the full names of topics that are published all the time, at one size or more."""
    return {
        full_name(topic, point)
        for topic in TOPICS
        if topic.publisher != "any" and topic.rate in ("control", "view")
    }


def _hops(
    arrivals: Mapping[Topic, Mapping[int, int]], window: tuple[int, int]
) -> dict[str, Percentiles]:
    device, command = arrivals[DEVICE_STATE], arrivals[DEVICE_COMMAND]
    state, rendering = arrivals[STATE], arrivals[POINT_MODEL]
    found = {
        "device's deadline → device/state": delay(device, window),
        "device/state → servo_cf": hop(device, command, window),
        RECORDED_TRIP: delay(command, window),
        "mechanism's deadline → mechanism/state": delay(state, window),
        "mechanism/state → operational_model": hop(state, rendering, window),
        "mechanism's deadline → operational_model": delay(rendering, window),
    }
    return {name: latency for name, latency in found.items() if latency is not None}


@dataclass(frozen=True, slots=True)
class Losses:
    """Questions and answers of one node within a window, in a bag.

    Attributes:
        asked: messages that were to be answered.
        answered: those whose answer is there.
        strays: answers to messages that are not there: the recorder lost those, not the node.
    """

    asked: int
    answered: int
    strays: int

    @property
    def lost(self) -> int:
        """Messages without an answer."""
        return self.asked - self.answered


def losses(asked: Collection[int], answers: Collection[int], window: tuple[int, int]) -> Losses:
    """Return what was lost between stamps of ``window``, first included and last not.

    Args:
        asked: stamps of the messages to be answered, ns.
        answers: stamps of the answers, ns.
        window: ns; to end a little before recording does, or the last answers are missing.
    """
    first, last = window
    questions = {stamp for stamp in asked if first <= stamp < last}
    found = {stamp for stamp in answers if first <= stamp < last}
    return Losses(len(questions), len(questions & found), len(found - questions))


def total(parts: Collection[Losses]) -> Losses:
    """Return the sum of several."""
    return Losses(
        sum(part.asked for part in parts),
        sum(part.answered for part in parts),
        sum(part.strays for part in parts),
    )


def hop(
    before: Mapping[int, int], after: Mapping[int, int], window: tuple[int, int]
) -> Percentiles | None:
    """Return how much later messages came than those they answer.

    Args:
        before: stamp -> time of reception, ns.
        after: the same, of the answers.
        window: of stamps, ns.
    """
    first, last = window
    waits = [after[s] - time for s, time in before.items() if first <= s < last and s in after]
    return percentiles_of(np.array(waits, dtype=float) / 1000.0)


def delay(received: Mapping[int, int], window: tuple[int, int]) -> Percentiles | None:
    """Return how long after its stamp each message came.

    Args:
        received: stamp -> time of reception, ns.
        window: of stamps, ns.
    """
    return hop({stamp: stamp for stamp in received}, received, window)
