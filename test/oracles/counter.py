# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Number of joint constraints a user is told of: a Schmitt trigger with dwell on each s_i."""

from __future__ import annotations

from dataclasses import dataclass

from hapticmech_ros.arrays import Array
from hapticmech_ros.scene.controller import Perception


@dataclass(frozen=True, slots=True)
class CountState:
    """Per direction (s descending): reported as rigid or not, and since when s disagrees (s)."""

    rigid: tuple[bool, ...]
    disagrees_since: tuple[float | None, ...]

    @property
    def count(self) -> int:
        """Number of directions reported as rigid."""
        return sum(self.rigid)


def first_count(s: Array, perception: Perception) -> CountState:
    """Return the state at the start: rigid where s is at most s_on."""
    return CountState(tuple(bool(value <= perception.s_on) for value in s), (None,) * len(s))


def next_count(state: CountState, s: Array, time: float, perception: Perception) -> CountState:
    """Return the state after seeing s at ``time`` (s).

    A direction turns rigid once s has stayed at or below s_on for the dwell time, and free once it
    has stayed at or above s_off for it; in between nothing changes.
    """
    rigid: list[bool] = []
    since: list[float | None] = []
    on, off = perception.s_on, perception.s_off
    # Half a nanosecond absorbs the rounding of times that are sums of periods.
    dwell = perception.dwell - 5e-10
    directions = zip(state.rigid, state.disagrees_since, s.tolist(), strict=True)
    for was_rigid, start, value in directions:
        disagrees = value >= off if was_rigid else value <= on
        begun = (time if start is None else start) if disagrees else None
        if begun is not None and time - begun >= dwell:
            rigid.append(not was_rigid)
            since.append(None)
        else:
            rigid.append(was_rigid)
            since.append(begun)
    return CountState(tuple(rigid), tuple(since))
