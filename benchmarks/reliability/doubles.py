# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Part ``doubles``: a second node of each kind, which joins before the graph's own or after it.

The one who joins last is the newcomer. Within 20 ms of its first message there is to be no force,
for as long as both are there; a sentence names both; and when the double has left, the device
renders again. Doubles leave in order, and by SIGKILL.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.children import BenchError, ReportingProcess, wait_until
from benchmarks.reliability.figure import Figure
from benchmarks.reliability.rig import POINT, Rig, pushing
from benchmarks.reliability.sample import COMMAND, DEVICE, MECHANISM, POINT_MODEL
from benchmarks.reliability.trial import (
    Fault,
    Trial,
    carried_out,
    observe,
    report_delays,
)
from hapticmech_ros.wire import topics
from hapticmech_ros.wire.topics import ANALYSER, CONTROLLER
from hapticmech_ros.wire.topics import DEVICE as DEVICE_NODE
from hapticmech_ros.wire.topics import MECHANISM as MECHANISM_NODE

TRIALS, QUICK_TRIALS = 50, 2
STAYS_S, JOINS_WITHIN_S = 1.5, 20.0
# Beside other programs a process may take half a minute to start. One that has been up for so long,
# and has said nothing where it is watched, is silent because it saw the other one first.
STARTS_WITHIN_S, SILENT_FOR_S = 90.0, 5.0
# A log line is with the watcher by then, ns; and what it says of two.
LOGGED_NS = 2_000_000
# What was told of two so long before one was met is about another, which has left since.
SETTLED_NS = 300_000_000
SECOND = "more than one publisher"
# A publisher counts its messages up, and reliable subscribers get them in order.
NEWER_BY = 16
# Two shares of a processor, each over 2 s, differ by a fifth.
MOST_GROWN = 1.5
# N and N m, far from what the scene's gains command. A commander that is alone holds the device:
# else the hand pushes it away, and is braked when the graph takes hold of it again.
PUSH = ("4.0", "0", "0", "0", "0", "0")
FOREIGN = "foreign_"
DRIVER, COMMANDER, GAIN = (FOREIGN + kind for kind in ("driver", "commander", "gain"))


@dataclass(frozen=True, slots=True)
class Kind:
    """What is doubled.

    Attributes:
        name: of the double's node.
        original: the node of the graph that it doubles.
        topic: of the original, as it is watched; foreign drivers, and who only tells gains, do not
            speak on it.
        speaks_on: the double's own topic.
        outputs: topics whose force is to be zero.
    """

    name: str
    original: str
    topic: int
    speaks_on: str
    outputs: tuple[int, ...] = (DEVICE,)


KINDS = (
    Kind(f"second_{DEVICE_NODE}", DEVICE_NODE, DEVICE, topics.DEVICE_STATE.name),
    Kind(f"second_{MECHANISM_NODE}", MECHANISM_NODE, MECHANISM, topics.STATE.name),
    Kind(f"second_{ANALYSER}", ANALYSER, POINT_MODEL, topics.POINT_MODEL.of(POINT)),
    Kind(f"second_{CONTROLLER}", CONTROLLER, COMMAND, topics.DEVICE_COMMAND.name),
    # What is commanded is what its actuators would do.
    Kind(DRIVER, DEVICE_NODE, DEVICE, topics.DEVICE_POSE.name, (DEVICE, COMMAND)),
    Kind(COMMANDER, CONTROLLER, COMMAND, topics.DEVICE_COMMAND.name),
    Kind(GAIN, CONTROLLER, COMMAND, topics.DEVICE_GAIN.name),
)


class Double:
    """A process that plays a part which is taken."""

    def __init__(self, rig: Rig, kind: Kind, alone: bool) -> None:
        self._watch, self._topic = rig.watch, kind.speaks_on
        self.teller: ReportingProcess | None = None
        self._stop: Callable[[], object]
        if kind.name.startswith(FOREIGN):
            pushes = kind.name == COMMANDER and not alone
            arguments = (kind.name.removeprefix(FOREIGN), *(PUSH if pushes else ()))
            environment = rig.environment_of(kind.original)
            self.teller = rig.start("foreigner", *arguments, environment=environment)
            self._process, self._stop = self.teller.process, self.teller.stop
        else:
            graph = rig.another(kind.original)
            self._process, self._stop = graph.processes[kind.original], graph.stop

    def leave(self, killed: bool) -> int:
        """End it; return when it could speak no more, ns of the monotonic clock.

        Its publisher goes before its process, which may take a second more: about as long as the
        graph waits for a publisher that is silent.
        """
        asked_ns = time.monotonic_ns()
        if killed:
            self._process.kill()
            self._process.wait()
        else:
            self._stop()
        return silent_from(self._watch.of("publishers"), self._topic, asked_ns, time.monotonic_ns())


def silent_from(
    counted: Sequence[Mapping[str, Any]], topic: str, asked_ns: int, ended_ns: int
) -> int:
    """Return when a node that was asked to end could speak no more, ns.

    Args:
        counted: what the watcher told of the numbers of publishers.
        topic: that the node speaks on.
        asked_ns: when it was asked.
        ended_ns: when its process had ended.
    """
    fewer = (event for event in counted if event["topic"] == topic and event["fewer"])
    gone = (int(event["at_ns"]) for event in fewer)
    return min((at_ns for at_ns in gone if asked_ns <= at_ns < ended_ns), default=ended_ns)


def run(quick: bool, out: Path) -> list[Figure]:
    """Let every kind of double join 50 times (quick: twice), half of them before the original."""
    number = QUICK_TRIALS if quick else TRIALS
    with Rig(out, "doubles", all_topics=True) as rig:
        figures = report_delays(rig)
        for kind in KINDS:
            shares = rig.shares()
            ways = [(index % 2 == 0, index % 4 >= 2) for index in range(number)]
            doubles = ((kind.name, partial(try_double, rig, kind, *way)) for way in ways)
            figures += carried_out(rig, doubles)
            rig.ready()
            figures.append(grown(kind.name, shares, rig.shares()))
    return figures


def grown(kind: str, before: Mapping[int, float], after: Mapping[int, float]) -> Figure:
    """Return how much more of a processor nodes take that were there all the while.

    Args:
        kind: of the double.
        before: share by process, %, before its trials.
        after: the same after them.
    """
    ratios = [after[one] / before[one] for one in before if one in after]
    return Figure(
        f"{kind}: processor time of nodes that stayed, largest, of before",
        max(ratios, default=math.nan),
        most=MOST_GROWN,
        trials=len(ratios),
    )


def try_double(rig: Rig, kind: Kind, before: bool, killed: bool = False) -> Trial:
    """Let a double join before or after the original, and leave; return what the device did.

    Args:
        rig: with all topics watched.
        kind: of the double.
        before: it takes the original's place first, and then the original joins.
        killed: it leaves by SIGKILL.
    """
    order = f"{kind.name} {'before' if before else 'after'} {kind.original}"
    since = rig.ready()
    if before:
        rig.graph_of(kind.original).kill(kind.original)
    asked_ns = time.monotonic_ns()
    with ExitStack() as stack:
        joined = Double(rig, kind, alone=before)
        # It has left at the end, whatever happens.
        stack.callback(joined.leave, killed=True)
        if before:
            _wait_alone(rig, kind, joined)
            since, asked_ns = rig.ring.count, time.monotonic_ns()
            rig.restart(kind.original)
        newcomer, teller = (kind.original, None) if before else (kind.name, joined.teller)
        first_ns = _first(rig, kind, since, asked_ns, newcomer, teller)
        time.sleep(STAYS_S)
        left_ns = joined.leave(killed)
        cause_ns = _cause(rig, kind, since, asked_ns, first_ns)
        order += ", killed" if killed else ""
        fault = Fault(order, since, cause_ns, left_ns, topics=kind.outputs)

        def names_both(text: str) -> bool:
            # A double's name holds the original's.
            return kind.name in text and kind.original in text.replace(kind.name, "")

        return observe(rig, fault, names_both)


def _wait_alone(rig: Rig, kind: Kind, joined: Double) -> None:
    """Wait until the double plays its part: without the original the graph may not render."""
    begun = rig.ring.count

    def plays() -> bool:
        if joined.teller is not None:
            return bool(joined.teller.of("first"))
        return len(rig.samples(begun, kind.topic)) > 100

    wait_until(plays, JOINS_WITHIN_S, f"{kind.name} to begin", rig.watch.check)
    time.sleep(0.5)


def _first(
    rig: Rig,
    kind: Kind,
    since: int,
    asked_ns: int,
    newcomer: str,
    teller: ReportingProcess | None,
) -> int | None:
    """Wait for the newcomer's first message, and return when that was; None if it never says any.

    One that is silent because it saw the other first is none the worse for it. One that cannot tell
    is known by the numbers of its messages: the other counted further.
    """

    def told() -> int | None:
        found = rig.samples(since, kind.topic)
        found = found[found["arrived_ns"] > asked_ns]
        if teller is not None:
            firsts = [int(event["at_ns"]) for event in teller.of("first")]
            if kind.name == COMMANDER:
                return _to_the_device(firsts, found[found["stamp_ns"] == 0]["arrived_ns"])
            return firsts[0] if firsts else None
        if kind.name in (DRIVER, GAIN):
            # It says nothing on this topic: whoever does is the newcomer.
            return int(found["arrived_ns"][0]) if found.size else None
        newer = found["number"] < np.maximum.accumulate(found["number"]) - NEWER_BY
        return int(found["arrived_ns"][int(np.argmax(newer))]) if newer.any() else None

    def silent() -> bool:
        up = [event["at_ns"] for event in rig.said(asked_ns) if event["node"] == newcomer]
        return bool(up) and time.monotonic_ns() - up[0] > SILENT_FOR_S * 1e9

    if teller is None:
        what = f"{newcomer} to be up"
        wait_until(lambda: told() is not None or silent(), STARTS_WITHIN_S, what, rig.watch.check)
    else:
        with suppress(BenchError):
            wait_until(lambda: told() is not None, JOINS_WITHIN_S, f"{newcomer} to speak")
    return told()


def _to_the_device(firsts: Sequence[int], received_ns: np.ndarray) -> int | None:
    """Return when a foreign command first went to the device, ns.

    Device and watcher meet a publisher up to a second apart, in either order. Of its two first
    messages, the watcher's is the one that came when the watcher heard it.

    Args:
        firsts: when it first published to one more, ns.
        received_ns: when the watcher heard its messages.
    """
    if len(firsts) < 2 or not len(received_ns):
        return None
    watchers = min(firsts, key=lambda at_ns: abs(at_ns - int(received_ns[0])))
    return next((at_ns for at_ns in firsts if at_ns != watchers), watchers)


def _cause(rig: Rig, kind: Kind, since: int, asked_ns: int, first_ns: int | None) -> int:
    """Return when the newcomer was first heard; if never, when force ended, or it was asked."""
    # The middleware may not know the newcomer's name yet.
    told = [
        event["at_ns"] - LOGGED_NS
        for event in rig.said(asked_ns)
        if event["by"] == "log" and SECOND in event["text"]
    ]
    found = rig.samples(since, *kind.outputs)
    found = found[found["arrived_ns"] > asked_ns]
    return first_heard(first_ns, told, found["arrived_ns"], pushing(found), asked_ns)


def first_heard(
    first_ns: int | None, told: Sequence[int], arrived: np.ndarray, on: np.ndarray, asked_ns: int
) -> int:
    """Return when the node that has to act first heard a newcomer, ns.

    It may meet the newcomer up to a second after the watcher did, and says so in the callback of
    the first message that it hears; until then there may be force, or it may begin: where the other
    one had doubled somebody before, who was killed. What was told well before the watcher met the
    newcomer was about that one; what was told right before is that it was heard already.

    Args:
        first_ns: when the watcher met it; None if it never did.
        told: when nodes said that there are two.
        arrived: (n,) when the device's outputs arrived.
        on: (n,) whether they have force.
        asked_ns: when the newcomer was started.
    """
    if first_ns is not None:
        known_ns = first_ns - SETTLED_NS
        received = min((at_ns for at_ns in told if at_ns > known_ns), default=first_ns)
        # The output before that counts as well: it stands until the next one.
        begun = max(int(np.searchsorted(arrived, first_ns)) - 1, 0)
        pushed = bool(on[begun : np.searchsorted(arrived, received)].any())
        return received if pushed else first_ns
    if told:
        return min(told)
    # The start of a process may have interrupted rendering before.
    last = arrived[:-1][~on[1:] & on[:-1]]
    return int(last[-1]) if last.size else asked_ns
