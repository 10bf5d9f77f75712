# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a run's bag tells: hops as the recorder saw them, messages lost, and their sizes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.graph.statuses import Figures, latency_of
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
# Hop -> from which message to which; None: from the deadline, which is the message's stamp.
HOPS: dict[str, tuple[Topic | None, Topic]] = {
    "device's deadline → device/state": (None, DEVICE_STATE),
    "device/state → servo_cf": (DEVICE_STATE, DEVICE_COMMAND),
    RECORDED_TRIP: (None, DEVICE_COMMAND),
    "mechanism's deadline → mechanism/state": (None, STATE),
    "mechanism/state → operational_model": (STATE, POINT_MODEL),
    "mechanism's deadline → operational_model": (None, POINT_MODEL),
}
# What is answered, by what.
ANSWERED = {
    "device/state → servo_cf": (DEVICE_STATE, DEVICE_COMMAND),
    "device/state → mechanism's servo_cf": (DEVICE_STATE, POINT_COMMAND),
    "mechanism/state → operational_model": (STATE, POINT_MODEL),
}
# Names of figures, behind what is answered by what.
ASKED, LOST, UNSEEN = "messages", "lost", "lost by the recorder"


@dataclass(frozen=True, slots=True)
class Recorded:
    """A bag, evaluated.

    Attributes:
        figures: latencies by hop, by the recorder's times, and what was lost, in the window.
        published: messages of the window by topic.
        sizes: bytes of the smallest message by topic, of the whole bag.
    """

    figures: Figures
    published: Mapping[str, int]
    sizes: Mapping[str, int]


def recorded(bag: Path, point: str, window: tuple[int, int]) -> Recorded:
    """Return what a bag tells of a window (ns, of stamps and of reception alike).

    Raises:
        BagError: no bag, or damaged.
    """
    names = {full_name(topic, point): topic for topic in WATCHED}
    # Of each topic, stamp -> time of reception, ns.
    arrivals: dict[Topic, dict[int, int]] = {topic: {} for topic in WATCHED}
    published: Counter[str] = Counter()
    sizes: dict[str, int] = {}
    with BagReader(bag) as reader:
        for name, time_ns, data in reader.serialized():
            sizes[name] = min(len(data), sizes.get(name, len(data)))
            published[name] += window[0] <= time_ns < window[1]
            if (topic := names.get(name)) is not None:
                stamp_ns = array_stamp(data) if topic.type == ARRAY else header_stamp(data)
                arrivals[topic].setdefault(stamp_ns, time_ns)
    figures: Figures = {}
    for hop, (before, after) in HOPS.items():
        asked = arrivals[after] if before is None else arrivals[before]
        since = {stamp: stamp for stamp in asked} if before is None else asked
        figures |= latency_of(hop, waits_us(since, arrivals[after], window))
    for name, (question, answer) in ANSWERED.items():
        figures |= losses(name, arrivals[question], arrivals[answer], window)
    return Recorded(figures, +published, sizes)


def steady_topics(point: str) -> set[str]:
    """Return the full names of topics that are published all the time, at one size or more."""
    return {
        full_name(topic, point)
        for topic in TOPICS
        if topic.publisher != "any" and topic.rate in ("control", "view")
    }


def losses(
    name: str, asked: Collection[int], answers: Collection[int], window: tuple[int, int]
) -> Figures:
    """Return what was lost between stamps of ``window``, first included and last not.

    Args:
        name: of what is answered by what.
        asked: stamps of the messages to be answered, ns.
        answers: stamps of the answers, ns.
        window: ns; to end a little before recording does, or the last answers are missing.
    """
    first, last = window
    questions = {stamp for stamp in asked if first <= stamp < last}
    found = {stamp for stamp in answers if first <= stamp < last}
    return {
        f"{name}: {ASKED}": len(questions),
        f"{name}: {LOST}": len(questions - found),
        # Answers to messages that are not there: the recorder lost those, not the node.
        f"{name}: {UNSEEN}": len(found - questions),
    }


def waits_us(
    before: Mapping[int, int], after: Mapping[int, int], window: tuple[int, int]
) -> np.ndarray:
    """Return how much later messages came than those that they answer, (n,) µs.

    Args:
        before: stamp -> time of reception, ns.
        after: the same, of the answers.
        window: of stamps, ns.
    """
    first, last = window
    waits = [after[s] - time for s, time in before.items() if first <= s < last and s in after]
    return np.array(waits, dtype=float) / 1000.0
