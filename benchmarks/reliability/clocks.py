# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Part ``clocks``: steps of the machine's clock, of one host's clock, and of /clock."""

from __future__ import annotations

import re
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

from benchmarks.reliability.emergency import summarised_stops, try_stop
from benchmarks.reliability.figure import Figure, unmeasured
from benchmarks.reliability.rig import Rig
from benchmarks.reliability.stepped_clock import NoCompilerError, SteppedClock, compiler
from benchmarks.reliability.trial import (
    Fault,
    Trial,
    carried_out,
    observe,
    report_delays,
)
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.wire.topics import DEVICE

PART = "clocks"
TRIALS, QUICK_TRIALS = 50, 2
# NTP's daily bread, and a machine whose battery was empty; a simulator that is reset.
STEPS_S, SIMULATED_STEPS_S = (5.0, 600.0), (8.0,)
# Of the graph by /clock, Hz: Python handles all its messages; at 1 kHz one process is at its limit.
RATE = 250.0
# A host whose clock is wrong has it so for this long.
WRONG_S = 1.0
_STEPPED = re.compile(r"\b(step|jump|went|go|moved|back|forward|ahead|set|changed)", re.IGNORECASE)


def run(quick: bool, out: Path) -> list[Figure]:
    """Step every clock 50 times each way (quick: twice)."""
    try:
        compiler()
    except NoCompilerError as error:
        return [unmeasured(PART, "steps of clocks", str(error))]
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
    pair = index // 2
    return (index + pair + pair // 2) % 2 == 0


def try_step(rig: Rig, clock: SteppedClock, seconds: float, words: str) -> Trial:
    """Step a clock that the device lives by, and return what the device did."""
    since = rig.ready()
    stepped_ns = clock.step(seconds)
    fault = Fault(f"{words} {seconds:+g} s", since, stepped_ns, stepped_ns)
    return observe(rig, fault, about_clock)


def try_wrong_host(
    rig: Rig, clock: SteppedClock, seconds: float, has_device: bool, words: str
) -> Trial:
    """Step the clock of one host for a second, and put it right again.

    Hosts whose clocks disagree cannot tell how old a message is: the hand is to be left alone until
    they agree again.
    """
    since = rig.ready()
    stepped_ns = clock.step(seconds)
    offset_ns = clock.offset_ns if has_device else rig.offset_ns
    time.sleep(WRONG_S)
    righted_ns = clock.step(-seconds)
    kind = f"{words} {seconds:+g} s for {WRONG_S:g} s"
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
        figures = report_delays(PART, rig) + _each_size(rig, clock, sizes, "machine's clock")
        stops = []
        for index, seconds in enumerate(sizes):
            stops.append(try_stop(rig, clock, seconds, at_once=_by_turns(index)))
            print(stops[-1].line)
    return figures + summarised_stops(PART, stops)


def _each_size(rig: Rig, clock: SteppedClock, sizes: Sequence[float], words: str) -> list[Figure]:
    faults = ((words, partial(try_step, rig, clock, size, words)) for size in sizes)
    return carried_out(PART, rig, faults)


def _one_host(number: int, out: Path) -> list[Figure]:
    rest = tuple(name for name in NODES if name != DEVICE)
    with (
        _stepped("near", "far") as (near, far),
        Rig(out, "clocks_host", [((DEVICE,), near), (rest, far)]) as rig,
    ):

        def wrong(index: int, seconds: float) -> Trial:
            at_device = _by_turns(index)
            clock, words = (near, "device's host") if at_device else (far, "other host")
            return try_wrong_host(rig, clock, seconds, at_device, words)

        sizes = enumerate(steps(number, STEPS_S))
        return carried_out(PART, rig, (("one host's clock", partial(wrong, *one)) for one in sizes))


def _simulated(number: int, out: Path) -> list[Figure]:
    given = {"use_sim_time": True}
    with (
        _stepped("day") as (clock,),
        Rig(out, "clocks_sim", parameters=given, clock=clock, composed=True, rate=RATE) as rig,
    ):
        return _each_size(rig, clock, steps(number, SIMULATED_STEPS_S), "/clock")
