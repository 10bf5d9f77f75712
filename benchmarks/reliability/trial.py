# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One fault and what the device did about it, read from what the watcher saw."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.children import BenchError, wait_until
from benchmarks.reliability.figure import Figure, figures_of
from benchmarks.reliability.rig import MS, Rig, pushing
from benchmarks.reliability.sample import DEVICE, Samples
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.nodes.node_time import wall_ahead_ns
from hapticmech_ros.nodes.timeouts import ZERO_FORCE
from hapticmech_ros.numerics.times import nanoseconds

GOAL_BACK_S, GOAL_PEAK = 2.0, 1.2
# How long a fault is waited out, and what is said about it: a message that was lost is sent again
# at a reliable publisher's next heartbeat, 3 s later.
PATIENCE_S, SAID_WITHIN_S = 8.0, 8.0
# A sample that arrives later than this after its stamp was stamped by another clock.
STAMP_TRUSTED_NS = 500 * MS
# Where a device's process had to wait for a processor for more than two periods, shortly before its
# largest force, the hand moved the device meanwhile: what brakes it then answers the machine's
# pause, and not the fault. A longer pause is a step of a clock.
PAUSE_PERIODS, CLOCK_STEP_NS = 2.5, 2_000 * MS
# Of each node, in parts that do something to each.
TRIALS, QUICK_TRIALS = 100, 2
# So many changes of force go into a trace.
MOST_TURNS = 50


@dataclass(frozen=True, slots=True)
class Fault:
    """What was done to a graph, and when.

    Attributes:
        kind: in words.
        since: number in the watcher's ring, before it.
        cause_ns: when, by the monotonic clock.
        released_ns: when it was over, so that the device may push again.
        first_output: the device itself was away: its first output after the end counts, by arrival.
        offset_ns: of the device's clock from then on, to the machine's.
        topics: whose force is looked at.
    """

    kind: str
    since: int
    cause_ns: int
    released_ns: int
    first_output: bool = False
    offset_ns: int = 0
    topics: tuple[int, ...] = (DEVICE,)


@dataclass(frozen=True)
class Seen:
    """What a device did after a fault; times are infinite while it has not.

    Attributes:
        zero_s: from the fault to the device's first output without force, by its own stamps.
        heard_s: the same by the time of arrival at the watcher.
        back_s: from the fault's end to the first output with force after that.
        peak: largest force of any output, N.
        stale: outputs with force before the first one without, of a device that was away.
        pause_s: longest time between the device's samples right before its largest force.
    """

    zero_s: float = math.inf
    heard_s: float = math.inf
    back_s: float = math.inf
    peak: float = 0.0
    stale: int = 0
    pause_s: float = 0.0

    @property
    def came_back(self) -> bool:
        """Whether the device let go, and pushes again."""
        return math.isfinite(self.back_s)


@dataclass(frozen=True, kw_only=True)
class Trial(Seen):
    """What followed.

    Attributes:
        fault: in words.
        said: a sentence that a node said about it; empty if there was none.
        alive: whether all other nodes went on.
        trace: what nodes said meanwhile, and when force came and went.
        period_s: control period of the graph, s.
    """

    fault: str
    said: str
    alive: bool = True
    trace: str = ""
    period_s: float = 0.001

    @property
    def zero_goal_s(self) -> float:
        """Within which (s) there is to be no force."""
        return ZERO_FORCE.at(self.period_s)

    @property
    def paused(self) -> bool:
        """Whether the machine had kept the device waiting before its largest force."""
        return self.pause_s > PAUSE_PERIODS * self.period_s

    @property
    def line(self) -> str:
        """All of it for a log."""
        return (
            f"{self.fault}: zero after {1e3 * self.zero_s:.1f} ms (heard after "
            f"{1e3 * self.heard_s:.1f}), back after {self.back_s:.2f} s, at most {self.peak:.3f} N"
            f"{f' after a pause of {1e3 * self.pause_s:.0f} ms' if self.paused else ''}"
            f"{'' if self.alive else ', ANOTHER NODE ENDED'}; {self.said or 'NOTHING SAID'}"
        )

    def log(self, clean_max: float) -> str:
        """Return all of it, with the trace where a limit is not kept.

        Args:
            clean_max: largest force of a clean run, N.
        """
        in_time = self.zero_s <= self.zero_goal_s and self.back_s <= GOAL_BACK_S
        gentle = self.peak <= GOAL_PEAK * clean_max and not self.stale
        kept = in_time and gentle and self.said and self.alive
        return self.line if kept else f"{self.line}\n{self.trace}"


def observe(rig: Rig, fault: Fault, about: Callable[[str], bool], alive: bool = True) -> Trial:
    """Wait until the device has let go and come back, or has not in 8 s, and return what it did.

    A graph that does not come back is started again.

    Args:
        rig: where it happened.
        fault: what happened.
        about: whether a sentence that a node said when it was not well is about this fault.
        alive: as known so far.
    """
    patience = PATIENCE_S + (fault.released_ns - fault.cause_ns) / 1e9

    def look() -> Seen:
        return seen(rig.samples(fault.since, *fault.topics), fault, rig.period_s)

    # What did not happen in time stays infinite.
    with suppress(BenchError):
        wait_until(lambda: look().came_back, patience, "the device", rig.watch.check)
        rig.settle(fault.released_ns)
    result, said = look(), _said(rig, fault.cause_ns, about)
    trial = Trial(
        **vars(result),
        fault=fault.kind,
        said=said,
        alive=alive and not rig.ended(),
        trace=_trace(rig, fault),
        period_s=rig.period_s,
    )
    if not trial.came_back:
        rig.renew()
    return trial


def carried_out(rig: Rig, faults: Iterable[tuple[str, Callable[[], Trial]]]) -> list[Figure]:
    """Carry out trials, tell of each as it was done, and return the figures of each name.

    Args:
        rig: where they happen.
        faults: name that trials are summarised by, and what does one.
    """
    done: dict[str, list[Trial]] = {}
    for name, fault in faults:
        done.setdefault(name, []).append(fault())
        print(done[name][-1].log(rig.clean_max))
    found = (summarised(name, trials, rig.clean_max) for name, trials in done.items())
    return [figure for figures in found for figure in figures]


def each_node(
    name: str, quick: bool, out: Path, rate: float, try_fault: Callable[[Rig, str], Trial]
) -> list[Figure]:
    """Do something to each node 100 times (quick: twice), in turn, and return the figures.

    Args:
        name: of the log.
        quick: a few trials.
        out: folder for logs.
        rate: control rate, Hz; 0: the scene's.
        try_fault: what is done to a node.
    """
    nodes = list(NODES) * (QUICK_TRIALS if quick else TRIALS)
    with Rig(out, name, rate=rate) as rig:
        figures = carried_out(rig, ((node, partial(try_fault, rig, node)) for node in nodes))
        rig.ready()
        left = Figure("sockets left behind", rig.sockets_left(), most=0.0, trials=1)
        return [*report_delays(rig), left, *figures]


def seen(found: Samples, fault: Fault, period_s: float = 0.001) -> Seen:
    """Return when the device let go for good, and when it came back after the fault's end.

    Args:
        found: samples of the fault's topics since before it.
        fault: what was done.
        period_s: control period of the graph, s.
    """
    arrived, on, cause_ns = found["arrived_ns"], pushing(found), fault.cause_ns
    made = _made_ns(arrived, found["stamp_ns"] - fault.offset_ns, fault.released_ns - cause_ns)
    counts = made >= cause_ns
    if fault.first_output:
        # One that was on its way, or half sent, was made before.
        counts &= arrived >= fault.released_ns
        made = arrived
        cause_ns = int(made[int(np.argmax(counts))]) if counts.any() else fault.released_ns
    peak = float(np.nan_to_num(found["force"][counts], nan=np.inf).max(initial=0.0))
    pause_s = _pause_s(found[counts], nanoseconds(ZERO_FORCE.at(period_s)))
    during = np.flatnonzero(counts & on & (made < fault.released_ns))
    off = counts & ~on
    if during.size:
        off[: during[-1]] = False
    if not off.any():
        return Seen(peak=peak, pause_s=pause_s)
    first = int(np.argmax(off))
    zero, received = (made[first] - cause_ns) / 1e9, (arrived[first] - cause_ns) / 1e9
    stale = int((counts & on)[:first].sum()) if fault.first_output else 0
    again = counts & on & (made >= fault.released_ns)
    again[: first + 1] = False
    back = (made[int(np.argmax(again))] - fault.released_ns) / 1e9 if again.any() else math.inf
    return Seen(float(zero), float(received), float(back), peak, stale, pause_s)


def _pause_s(found: Samples, before_ns: int) -> float:
    """Return the longest time (s) between the device's samples in a time before its most force."""
    if not len(found):
        return 0.0
    most = int(np.argmax(np.nan_to_num(found["force"], nan=np.inf)))
    own = found[: most + 1]
    stamps = own["stamp_ns"][own["topic"] == found["topic"][most]]
    near = stamps[stamps > stamps[-1] - before_ns]
    # The one before them too, so that a pause counts which is longer than all of it.
    apart = np.diff(stamps[-len(near) - 1 :])
    return float(apart[(apart > 0) & (apart < CLOCK_STEP_NS)].max(initial=0) / 1e9)


def _made_ns(arrived: np.ndarray, stamps: np.ndarray, lasted_ns: int) -> np.ndarray:
    """Return when samples were made, by the monotonic clock: by their stamps where these can be."""
    made = stamps - wall_ahead_ns()
    late = arrived - made
    return np.where((late > -MS) & (late < STAMP_TRUSTED_NS + lasted_ns), made, arrived)


def _said(rig: Rig, since_ns: int, about: Callable[[str], bool]) -> str:
    def found() -> str:
        sentences = (event["text"] for event in rig.said(since_ns) if not event["well"])
        return next(filter(about, sentences), "")

    with suppress(BenchError):
        return wait_until(found, SAID_WITHIN_S, "a sentence")
    return ""


def _trace(rig: Rig, fault: Fault) -> str:
    """Return what nodes said since a fault, when force came, went and was largest, ms since it."""

    def since(at_ns: int) -> str:
        return f"{(at_ns - fault.cause_ns) / MS:10.1f} ms"

    found = rig.samples(fault.since, *fault.topics)
    on, arrived = pushing(found), found["arrived_ns"]
    turned = [i + 1 for i in np.flatnonzero(on[1:] != on[:-1])]
    lines = [(int(arrived[i]), "force" if on[i] else "no force") for i in turned[:MOST_TURNS]]
    lines += [
        (e["at_ns"], f"{e['node']}: {e['text']}") for e in rig.said(fault.cause_ns - 5000 * MS)
    ]
    lines.append((fault.released_ns, "the fault's end"))
    after = found[arrived >= fault.cause_ns]
    if len(after):
        force = np.nan_to_num(after["force"], nan=np.inf)
        most = int(np.argmax(force))
        lines.append((int(after["arrived_ns"][most]), f"largest force: {force[most]:.3f} N"))
    return "\n".join(f"{since(at_ns)}  {text}" for at_ns, text in sorted(lines))


def summarised(name: str, trials: Sequence[Trial], clean_max: float) -> list[Figure]:
    """Return the worst of some trials, one or more, as figures, with limits that they are to keep.

    Args:
        name: of what was done in all of them.
        trials: with what followed.
        clean_max: largest force of a clean run, N.
    """
    figure = figures_of(name, len(trials))

    def share(held: Iterable[object]) -> float:
        return 100.0 * float(np.mean(list(map(bool, held))))

    judged, paused = (
        [trial.peak / clean_max for trial in trials if trial.paused is left_out]
        for left_out in (False, True)
    )
    most = max(judged, default=math.nan)
    above = sum(peak > GOAL_PEAK for peak in judged)
    why = "the machine kept the device's process waiting right before"
    return [
        figure(
            "zero force after, by the device's stamps, worst",
            1e3 * max(one.zero_s for one in trials),
            "ms",
            most=1e3 * max(one.zero_goal_s for one in trials),
        ),
        figure(
            "zero force after, by arrival, worst", 1e3 * max(one.heard_s for one in trials), "ms"
        ),
        figure(
            "rendering again after, worst",
            max(one.back_s for one in trials),
            "s",
            most=GOAL_BACK_S,
        ),
        figure("largest force, of a clean run's", most, most=GOAL_PEAK, trials=len(judged)),
        figure(f"trials with more force than {GOAL_PEAK} of that", above),
        figure(
            "the same in trials left out", max(paused, default=0.0), trials=len(paused), note=why
        ),
        figure("said", share(one.said for one in trials), "%", least=100.0),
        figure("all other nodes went on", share(one.alive for one in trials), "%", least=100.0),
        figure(
            "outputs with force before the first zero",
            sum(trial.stale for trial in trials),
            most=0.0,
        ),
    ]


def report_delays(rig: Rig) -> list[Figure]:
    """Return how late the watcher itself is, and what a clean run's force is."""
    late = rig.lateness_ns / MS
    figure = figures_of("watcher", len(late))
    note = "arrival less stamp, of a clean run"
    return [
        Figure("clean run: largest force", rig.clean_max, "N", trials=1),
        figure("lateness, median", float(np.median(late)), "ms", note=note),
        figure("lateness, worst", float(late.max()), "ms", note=note),
    ]
