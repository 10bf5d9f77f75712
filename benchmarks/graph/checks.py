# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What must hold of a run before its times mean anything."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from benchmarks.graph.recorded import Recorded, steady_topics
from benchmarks.graph.statuses import ANSWERS, RATE, Ends, Figures, Status, gained
from hapticmech_ros.experiment.from_bag import full_name
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Session
from hapticmech_ros.wire.topics import (
    ANALYSER,
    CONSTRAINT_WRENCHES,
    CONTROLLER,
    DEVICE,
    DEVICE_STATE,
    MECHANISM,
    STATE,
)

ENGAGED = "engaged"
# Closed loops are solved to 1e-12 m; this far off they are not closed.
CLOSURE_LIMIT = 1e-9
# The graph engages when it likes: a change of count this close to the end may still be to come.
UNSURE_S = 1.0
# Of what was published, by rates that are known to a sample or two.
HEARD_SHARE = 0.98


@dataclass(frozen=True, slots=True)
class Check:
    """A rule, whether it held, and what was seen."""

    rule: str
    held: bool
    seen: str


@dataclass(frozen=True, slots=True)
class Expected:
    """What the same scene does in the session, without ROS.

    Attributes:
        counts: numbers of joint constraints felt, in order.
        closed: names of closed loops, in order.
        settled: whether the last of both had come well before the end.
    """

    counts: tuple[int, ...]
    closed: tuple[tuple[str, ...], ...]
    settled: bool


def expected(scene: Scene, seconds: float) -> Expected:
    """Return what a session of ``seconds`` does."""
    session = Session(scene)
    counts: list[int] = []
    closed: list[tuple[str, ...]] = []
    changed_s = 0.0
    for _ in range(max(1, round(seconds / session.period))):
        sample = session.tick()
        loops = tuple(session.simulator.mechanism.names_of(sample.mechanism.active))
        if [sample.count] != counts[-1:] or [loops] != closed[-1:]:
            counts.append(sample.count)
            closed.append(loops)
            changed_s = sample.time
    return Expected(tuple(counts), tuple(closed), changed_s < seconds - UNSURE_S)


def check_run(
    kind: str,
    ends: Ends,
    within: Sequence[Status],
    session: Expected,
) -> tuple[Check, ...]:
    """Return the checks of a run.

    Args:
        kind: ``real`` or ``bare``.
        ends: of each node, the statuses around the window.
        within: statuses from the first of these to the last.
        session: what the real graph should do.
    """
    right = _right(ends, within, session) if kind == "real" else ()
    return (*_passing_messages(ends, within), *right)


def check_sizes(real: Mapping[str, int], bare: Mapping[str, int], point: str) -> Check:
    """Return whether both graphs had the same topics with messages of the same size.

    Args:
        real: bytes of its messages, by topic.
        bare: the same.
        point: operational point that is held.
    """
    steady = steady_topics(point)
    # A column for each constraint: one more or less with the count.
    varying = full_name(CONSTRAINT_WRENCHES, point)
    one, other = (
        {name: 0 if name == varying else size for name, size in sizes.items() if name in steady}
        for sizes in (real, bare)
    )
    differing = sorted(n for n in one.keys() | other.keys() if one.get(n) != other.get(n))
    seen = ", ".join(f"{n}: {one.get(n, 'none')} and {other.get(n, 'none')}" for n in differing)
    rule = "real and bare graph publish the same topics with messages of the same size"
    return Check(rule, not differing and bool(one), seen or f"{len(one)} topics alike")


def check_recording(found: Recorded, figures: Figures, window_s: float, point: str) -> Check:
    """Return whether the recorder heard device and mechanism all through the window.

    Args:
        found: what the bag tells.
        figures: of the run, by the nodes' own counts.
        window_s: length of the window, s.
        point: operational point that is held.
    """
    shares = {
        node: found.published.get(full_name(topic, point), 0)
        / max(figures[f"{node}: {RATE}"] * window_s, 1.0)
        for node, topic in ((DEVICE, DEVICE_STATE), (MECHANISM, STATE))
    }
    return Check(
        "the recorder hears device and mechanism all through the window",
        min(shares.values()) >= HEARD_SHARE,
        ", ".join(f"{node} {share:.1%}" for node, share in shares.items()),
    )


def _passing_messages(ends: Ends, within: Sequence[Status]) -> tuple[Check, ...]:
    lapses = [
        status.message
        for status in within
        if status.node == CONTROLLER and status.message != ENGAGED
    ]
    anew = gained(ends[CONTROLLER], "engagements")
    answers = {node: gained(ends[node], counter) for node, (counter, _) in ANSWERS.items()}
    samples = {
        node: gained(ends[node], "periods") - gained(ends[node], "missed_deadlines")
        for node in (DEVICE, MECHANISM)
    }
    refused = sum(gained(pair, "refused_messages") for pair in ends.values())
    return (
        Check(
            "the controller is engaged all the time",
            not lapses and anew == 0,
            f"engaged anew {anew:.0f} times; {'; '.join(sorted(set(lapses))) or 'no lapse said'}",
        ),
        Check(
            "device and mechanism publish, analyser and controller answer",
            all(count > 0 for count in (*answers.values(), *samples.values())),
            ", ".join(f"{node} {count:.0f}" for node, count in {**samples, **answers}.items()),
        ),
        Check("no message is refused", refused == 0, f"{refused:.0f} refused"),
    )


def _right(ends: Ends, within: Sequence[Status], session: Expected) -> tuple[Check, ...]:
    felt = (s.message for s in within if s.node == ANALYSER)
    counts = [int(word) for message in felt for word in re.findall(r"\d+", message)]
    closed = [_listed(s.message) for s in within if s.node == MECHANISM]
    errors = [s.figures.get("closure_error", 0.0) for s in within if s.node == MECHANISM]
    failures = ends[MECHANISM][1].figures.get("failures", 0.0)
    as_there = set(counts) <= set(session.counts) and bool(counts)
    loops_as_there = set(closed) <= set(session.closed) and bool(closed)
    if session.settled:
        as_there = as_there and counts[-1] == session.counts[-1]
        loops_as_there = loops_as_there and closed[-1] == session.closed[-1]
    return (
        Check("the mechanism never fails", failures == 0, f"{failures:.0f} failures"),
        Check(
            "as many joint constraints are felt as in the session",
            as_there,
            f"{sorted(set(counts))}, in the session {sorted(set(session.counts))}",
        ),
        Check(
            "the loops are closed that are closed in the session",
            loops_as_there,
            f"{sorted(set(closed))}, in the session {sorted(set(session.closed))}",
        ),
        Check(
            f"closed loops stay closed to {CLOSURE_LIMIT:g} m",
            max(errors, default=0.0) <= CLOSURE_LIMIT,
            f"{max(errors, default=0.0):.1e} m",
        ),
    )


def _listed(text: str) -> tuple[str, ...]:
    """Return the names behind a sentence's colon."""
    names = text.partition(":")[2].strip()
    return () if names in ("", "none") else tuple(name.strip() for name in names.split(","))
