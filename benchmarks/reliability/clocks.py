# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Part ``clocks``: steps of the machine's clock, of one host's clock, and of /clock."""

from __future__ import annotations

import re
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from pathlib import Path

from benchmarks.reliability.caller import Caller
from benchmarks.reliability.emergency import summarised_stops, try_stop
from benchmarks.reliability.figure import Figure
from benchmarks.reliability.rig import Rig
from benchmarks.reliability.stepped_clock import SteppedClock
from benchmarks.reliability.trial import (
    Fault,
    Trial,
    carried_out,
    observe,
    report_delays,
)
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.wire.topics import DEVICE

TRIALS, QUICK_TRIALS = 50, 2
# NTP's daily bread, and a machine whose battery was empty; a simulator that is reset.
STEPS_S, SIMULATED_STEPS_S = (5.0, 600.0), (8.0,)
# Of the graph by /clock, Hz: Python handles all its messages; at 1 kHz one process is at its limit.
RATE = 250.0
# A host whose clock is wrong has it so for this long.
WRONG_S = 1.0
_STEPPED = re.compile(r"\b(step|jump|went|go|moved|back|forward|ahead|set|changed)", re.IGNORECASE)


def run(quick: bool, out: Path) -> list[Figure]:
    """Step every clock 50 times each way (quick: twice).

    Raises:
        NoCompilerError: there is no C compiler.
    """
    number = QUICK_TRIALS if quick else TRIALS
    return [*_machine(number, out), *_one_host(number, out), *_simulated(number, out)]


def about_clock(sentence: str) -> bool:
    """Return whether a sentence says that a clock was stepped; a stale stamp is not enough."""
    about = "clock" in sentence.lower() and bool(_STEPPED.search(sentence))
    return about and "refused" not in sentence


def steps(number: int, sizes: Sequence[float]) -> list[float]:
    """Return steps (s) back and forward, ``number`` each, of all sizes in turn."""
    return [sign * sizes[i % len(sizes)] for i in range(number) for sign in (-1.0, 1.0)]


def _by_turns(index: int) -> bool:
    """Return every other time whether; of steps as :func:`steps` gives them, for each in turn."""
    return (index + index // 2 + index // 4) % 2 == 0


def try_step(
    rig: Rig, clock: SteppedClock, seconds: float, words: str, wrong_s: float = 0.0
) -> Trial:
    """Step a clock, put it right again if it is wrong for a time (s), and return what followed.

    Hosts whose clocks disagree cannot tell how old a message is: the hand is to be left alone until
    they agree again.
    """
    since, kind = rig.ready(), f"{words} {seconds:+g} s"
    stepped_ns = righted_ns = clock.step(seconds)
    offset_ns = rig.offset_ns
    if wrong_s:
        time.sleep(wrong_s)
        righted_ns, kind = clock.step(-seconds), f"{kind} for {wrong_s:g} s"
    fault = Fault(kind, since, stepped_ns, righted_ns, offset_ns=offset_ns)
    return observe(rig, fault, about_clock)


@contextmanager
def _stepped(*names: str) -> Iterator[list[SteppedClock]]:
    """Yield clocks that can be stepped, by name."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        yield [stack.enter_context(SteppedClock(folder, name)) for name in names]


def _machine(number: int, out: Path) -> list[Figure]:
    """Step the clock of all nodes; then also call the emergency stop after it."""
    hosted, sizes = tuple(NODES), steps(number, STEPS_S)
    with _stepped("day") as (clock,), Rig(out, "clocks_machine", [(hosted, clock)]) as rig:
        figures = report_delays(rig) + _each_size(rig, clock, sizes, "machine's clock")
        stops = []
        with closing(Caller(rig.environment)) as caller:
            for index, seconds in enumerate(sizes):
                step, words = partial(clock.step, seconds), f"clock {seconds:+g} s"
                stops.append(try_stop(rig, caller, words, step, _by_turns(index)))
                print(stops[-1])
    return figures + summarised_stops("emergency stop after a step", stops)


def _each_size(rig: Rig, clock: SteppedClock, sizes: Sequence[float], words: str) -> list[Figure]:
    return carried_out(rig, ((words, partial(try_step, rig, clock, s, words)) for s in sizes))


def _one_host(number: int, out: Path) -> list[Figure]:
    rest = tuple(name for name in NODES if name != DEVICE)
    with (
        _stepped("near", "far") as (near, far),
        Rig(out, "clocks_host", [((DEVICE,), near), (rest, far)]) as rig,
    ):

        def wrong(index: int, seconds: float) -> Trial:
            clock, words = (near, "device's host") if _by_turns(index) else (far, "other host")
            return try_step(rig, clock, seconds, words, WRONG_S)

        sizes = enumerate(steps(number, STEPS_S))
        return carried_out(rig, (("one host's clock", partial(wrong, *one)) for one in sizes))


def _simulated(number: int, out: Path) -> list[Figure]:
    with (
        _stepped("day") as (clock,),
        Rig(
            out,
            "clocks_sim",
            parameters={"use_sim_time": True},
            clock=clock,
            composed=True,
            rate=RATE,
        ) as rig,
    ):
        return _each_size(rig, clock, steps(number, SIMULATED_STEPS_S), "/clock")
