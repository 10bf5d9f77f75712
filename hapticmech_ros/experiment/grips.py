# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Spans of an experiment of several users, in which the same hands hold."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from hapticmech_ros.device.hand import grasp_schedule_of
from hapticmech_ros.scene import Scene


@dataclass(frozen=True, slots=True)
class Grips:
    """A span of time.

    Attributes:
        begin, end: s since the first hand's start.
        holding: operational points whose hands hold.
    """

    begin: float
    end: float
    holding: tuple[str, ...]


def grips_of(scene: Scene, end: float) -> list[Grips]:
    """Return the spans from the first hand's start until a time, s after it.

    Args:
        scene: with several ``hands``.
        end: s.
    """
    plans = {point: grasp_schedule_of(scene.held_at(point).hand) for point in scene.held_points}
    first = min(plan.start for plan in plans.values())
    switches = {
        point: [plan.start - first + time for time in plan.switches]
        for point, plan in plans.items()
    }
    starts = {plan.start - first for plan in plans.values()}
    bounds = sorted({0.0, end, *starts, *(time for times in switches.values() for time in times)})
    bounds = [time for time in bounds if time <= end]
    found = []
    for begin, until in pairwise(bounds):
        holding = tuple(
            point
            for point, plan in plans.items()
            if begin >= plan.start - first
            and plan.holds_first == (sum(time <= begin for time in switches[point]) % 2 == 0)
        )
        found.append(Grips(begin, until, holding))
    return found
