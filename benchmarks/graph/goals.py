# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The graph's goals, and whether they are met."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.goals import Verdict, unknown, verdict
from benchmarks.graph.comparison import Comparison
from benchmarks.graph.plan import Configuration, Layout
from benchmarks.graph.recorded import RECORDED_TRIP
from benchmarks.graph.statuses import ROUND_TRIP
from hapticmech_ros.wire.topics import DEVICE

# Of the rate wanted; 1000 ± 1 Hz.
RATE_TOLERANCE = 1e-3
MISSED_LIMIT = 0.005
RATIO_LIMITS = {"p50": 0.4, "p99": 0.6}
CPU_LIMIT = 0.70
SEPARATE_HZ, COMPOSED_HZ = 1000.0, 2000.0


def verdicts(comparisons: Sequence[Comparison]) -> tuple[Verdict, ...]:
    """Return a verdict for each goal; one that no run is about is ``not measured``."""
    return (*_separate(comparisons), *_composed(comparisons))


def _separate(comparisons: Sequence[Comparison]) -> list[Verdict]:
    where = f"separate, {SEPARATE_HZ:g} Hz, recording"
    found = _find(comparisons, SEPARATE_HZ, "separate", True)
    sound = _sound(found, where)
    lost = f"{where}: no control message lost"
    if found is None or not found.real.losses:
        verdicts = [unknown(lost)]
    else:
        parts = found.real.losses.values()
        unseen = sum(part.strays for part in parts)
        seen = f"{sum(part.lost for part in parts)} of {sum(part.asked for part in parts)} lost"
        seen += f"; the recorder itself lost {unseen}" if unseen else ""
        verdicts = [verdict(lost, seen, all(part.lost == 0 for part in parts))]
    verdicts += _kept(found, SEPARATE_HZ, where)
    latency = None if found is None else found.latency(ROUND_TRIP)
    beside = None if found is None else found.latency(RECORDED_TRIP)
    for share, limit in RATIO_LIMITS.items():
        goal = f"{where}: {share} of {ROUND_TRIP} at most {limit:g} x bare"
        ratio = None if latency is None else latency.ratio.get(share)
        if ratio is None:
            verdicts.append(unknown(goal))
        else:
            seen = f"{ratio:.2f} x"
            if beside is not None and share in beside.ratio:
                seen += f"; {RECORDED_TRIP} at the recorder {beside.ratio[share]:.2f} x"
            verdicts.append(verdict(goal, seen, ratio <= limit))
    return [sound, *verdicts]


def _composed(comparisons: Sequence[Comparison]) -> list[Verdict]:
    # What a recorder needs besides is its own; with it if it was never left out.
    found = _find(comparisons, COMPOSED_HZ, "composed", False)
    recording = "no recording"
    if found is None and (found := _find(comparisons, COMPOSED_HZ, "composed", True)) is not None:
        recording = "recording"
    where = f"composed, {COMPOSED_HZ:g} Hz, {recording}"
    goal = f"{where}: at most {CPU_LIMIT:.0%} of one core"
    cpu = None if found is None else found.real.cpu.get("composed")
    share = unknown(goal) if cpu is None else verdict(goal, f"{cpu:.1%}", cpu <= CPU_LIMIT)
    return [_sound(found, where), *_kept(found, COMPOSED_HZ, where), share]


def _kept(found: Comparison | None, rate_hz: float, where: str) -> list[Verdict]:
    tolerance = RATE_TOLERANCE * rate_hz
    rate = f"{where}: device at {rate_hz:g} ± {tolerance:g} Hz in every run"
    missed = f"{where}: at most {MISSED_LIMIT:.1%} of the device's deadlines missed"
    kept = None if found is None else found.real.kept.get(DEVICE)
    if kept is None:
        return [unknown(goal) for goal in (rate, missed)]
    held = abs(kept.worst_hz - rate_hz) <= tolerance
    return [
        verdict(rate, f"{kept.worst_hz:.2f} Hz", held),
        verdict(missed, f"{kept.missed_share:.3%}", kept.missed_share <= MISSED_LIMIT),
    ]


def _sound(found: Comparison | None, where: str) -> Verdict:
    goal = f"{where}: every run passes its checks"
    if found is None:
        return unknown(goal)
    broken = [*found.real.failures, *(f"bare, {reason}" for reason in found.bare.failures)]
    if found.alike is not None and not found.alike.held:
        broken.append(found.alike.seen)
    return verdict(goal, broken[0] if broken else "all", not broken)


def _find(
    comparisons: Sequence[Comparison], rate_hz: float, layout: Layout, recorded: bool
) -> Comparison | None:
    for one in comparisons:
        # As shipped: other transports and settings are for comparison.
        if one.configuration == Configuration(rate_hz, layout, recorded):
            return one
    return None
