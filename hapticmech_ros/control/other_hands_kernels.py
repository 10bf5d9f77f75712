# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels that correct a device's commands for other hands, whose samples they remember.

For the equations see :mod:`~hapticmech_ros.control.other_hands`.
"""

from __future__ import annotations

from hapticmech_ros.compilation import (
    Part,
    RecordPart,
    Structure,
    inner,
    kernel,
    local,
    put,
    shaped,
)
from hapticmech_ros.compilation.records import Record, Whole
from hapticmech_ros.control.account_kernels import MOST, change_of_mean, remember
from hapticmech_ros.control.loop_layout import HandMemory, HandsCorrection, MeanChange
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import dot

# After so many periods without a hand's sample nothing is corrected for it; and a period may begin
# at most so many periods after the sample from which its wrench is extrapolated.
SILENT, FARTHEST = 12, 1.0
# Numbers of a matrix H_j.
SQUARE = 36


class HandsNotes(Record):
    """Whole numbers about other hands; times are ns.

    Attributes:
        period: T.
        coupled: when the present matrices H_j arrived.
        corrected: commands that were corrected for other hands.
        uncorrected: commands that were not, because a hand's wrench, or H_j, was not received.
    """

    dtype = int
    period = Whole()
    coupled = Whole()
    corrected = Whole()
    uncorrected = Whole()


class HandsData(Structure):
    """Samples of other hands, k of them, and how a command depends on these.

    Attributes:
        notes: whole numbers.
        counts: (k,) how many samples of each so far, overwritten ones included.
        holding: (k,) 1 if H_j is known: the hand holds the mechanism.
        stamps: (k, n) of the samples, ns; ring buffers.
        wrenches: (k n, 6) F_j, by the hands, N and N m, world axes at their points.
        gains: (k, 36) H_j, 1, m and 1/m, world axes.
    """

    notes = RecordPart(HandsNotes, whole=True)
    counts, holding = Part(1, whole=True), Part(1, whole=True)
    stamps = Part(2, whole=True)
    wrenches, gains = Part(2), Part(2)


@kernel("void(HandsData, int64, int64, Array(float64, 1, 'C', readonly=True))")
def remember_hand(hands: HandsData, hand: int, stamp: int, wrench: Array) -> None:
    """Remember a hand's sample, unless it is no newer than the last one.

    Args:
        hands: changed.
        hand: its number.
        stamp: ns.
        wrench: (6,) F_j, N and N m, world axes at its point.
    """
    stamps, count = hands.stamps[hand], hands.counts[hand]
    rows = stamps.size
    if count > 0 and stamp <= stamps[(count - 1) % rows]:
        return
    row = count % rows
    stamps[row] = stamp
    put(hands.wrenches[hand * rows + row], wrench)
    hands.counts[hand] = count + 1


@inner
def newest_sample(hands: HandsData, hand: int, time: int) -> int:
    """Return the number of a hand's newest sample at a time (ns); -1 if it is silent then."""
    stamps, count = hands.stamps[hand], hands.counts[hand]
    rows, number = stamps.size, count - 1
    first = max(count - rows, 0)
    while number >= first and stamps[number % rows] > time:
        number -= 1
    if number < first or time - stamps[number % rows] > SILENT * hands.notes.period:
        return -1
    return int(number)


@inner
def nearest_sample(stamps: Array, count: int, newest: int, time: int) -> int:
    """Return the number of the sample, of those up to ``newest``, that is nearest to a time.

    Args:
        stamps: (n,) ns, a ring buffer.
        count: number of samples so far, overwritten ones included.
        newest: number of a sample.
        time: ns.
    """
    rows, number, first = stamps.size, newest, max(count - stamps.size, 0)
    while number > first:
        before, apart = stamps[(number - 1) % rows], stamps[number % rows] - time
        if abs(before - time) > abs(apart):
            break
        number -= 1
    return int(number)


@inner
def find_changes(
    hands: HandsData, hand: int, answered: int, now: int, change: Array, mean: MeanChange
) -> bool:
    """Fill F_j(t) - F_j(t' - T), F'_j and F''_j of a hand; return whether it is not silent.

    Args:
        hands: their samples.
        hand: its number.
        answered: t', ns.
        now: t, ns.
        change: (6,) to fill, N and N m.
        mean: to fill.
    """
    newest = newest_sample(hands, hand, now)
    if newest < 0:
        return False
    stamps, count, period = hands.stamps[hand], hands.counts[hand], hands.notes.period
    rows = stamps.size
    wrenches = hands.wrenches[hand * rows : (hand + 1) * rows]
    then = wrenches[nearest_sample(stamps, count, newest, answered - period) % rows]
    for i in range(6):
        change[i] = wrenches[newest % rows, i] - then[i]
    memory = HandMemory()
    first = max(newest + 1 - MOST, count - rows, 0)
    before = stamps[first % rows]
    for number in range(first, newest + 1):
        known = stamps[number % rows]
        remember(memory, (known - before) / 1e9, wrenches[number % rows])
        before = known
    since = min(float(now - before), FARTHEST * period)
    change_of_mean(memory, since / 1e9, period / 1e9, mean)
    return True


@kernel("void(HandsData, int64, int64, HandsCorrection)")
def correct_for_hands(hands: HandsData, answered: int, now: int, found: HandsCorrection) -> None:
    """Fill a command's correction for the hands that hold the mechanism, and count the command.

    Args:
        hands: their samples and H_j.
        answered: t', stamp of the sample that the command answers, ns.
        now: t, from which it is held, ns.
        found: to fill; world axes at the own point.
    """
    found.values[:] = 0.0
    change, mean, silent = local(6), MeanChange(), 0
    for hand in range(hands.counts.size):
        if hands.holding[hand] == 0:
            continue
        found.hands += 1.0
        if not find_changes(hands, hand, answered, now, change, mean):
            silent += 1
            continue
        gain = shaped(hands.gains[hand], (6, 6))
        for i in range(6):
            found.change[i] += dot(gain[i], change)
            found.line[i] += dot(gain[i], mean.line)
            found.bend[i] += dot(gain[i], mean.bend)
    notes = hands.notes
    if silent > 0:
        notes.uncorrected += 1
    elif found.hands > 0.0:
        notes.corrected += 1
