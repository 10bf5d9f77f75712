# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One run of several users on one mechanism: a record of each, and what each does to the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.device.hand import grasp_schedule_of
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.experiment.record import ExperimentRecord, Source
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.operational.coupling import coupling
from hapticmech_ros.scene import Scene

# Time between two rows of what the users do to each other, s: that of topics at view rate.
COUPLING_PERIOD_S = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class SharedRecord:
    """Records of n users of one run, with one time zero: the first push of any of them.

    Attributes:
        users: by operational point, in the order of the scene's ``hands``.
        times: (k,) s, of the rest.
        wrenches: (k, n, 6) F_j, by each user's hand through its controller, on the mechanism, at
            its point, axes of the world, N and N m: what acts from that time on.
        felt: (k, n, 6) F_c at each user's point, likewise: the others' part of what it feels.
        coupling: (k, n, n, 6, 6) X_ij, 1/kg, 1/(kg m) and 1/(kg m²): a wrench F_j at point j
            accelerates point i by X_ij F_j.

    Raises:
        InvalidInputError: no users, wrong shapes, or values that are not finite.
    """

    users: Mapping[str, ExperimentRecord]
    times: Array
    wrenches: Array
    felt: Array
    coupling: Array

    def __post_init__(self) -> None:
        n, k = len(self.users), np.shape(self.times)[0]
        if n == 0 or k == 0:
            raise InvalidInputError("users and times", (n, k), "must be at least one of each")
        shapes = {"times": (k,), "wrenches": (k, n, 6), "felt": (k, n, 6)}
        for name, shape in {**shapes, "coupling": (k, n, n, 6, 6)}.items():
            array = np.array(getattr(self, name), dtype=float)
            if array.shape != shape:
                raise InvalidInputError(f"shape of {name}", array.shape, f"must be {shape}")
            if not np.isfinite(array).all():
                raise InvalidInputError(name, "NaN or infinity", "must be finite")
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def points(self) -> tuple[str, ...]:
        """Operational points that the users hold."""
        return tuple(self.users)

    @property
    def first(self) -> ExperimentRecord:
        """Record of the first user."""
        return next(iter(self.users.values()))

    @property
    def scene(self) -> str:
        """Name of the scene."""
        return self.first.scene

    @property
    def source(self) -> Source:
        """``session`` or ``graph``."""
        return self.first.source

    def accelerations(self, point: str) -> Array:
        """Return (k, n, 6) X_ij F_j of one point i, by each user j, m/s² and rad/s².

        Raises:
            InvalidInputError: nobody holds the point.
        """
        if point not in self.users:
            rule = f"must be one of {list(self.points)}"
            raise InvalidInputError("point", point, rule)
        rows = self.coupling[:, self.points.index(point)]
        return np.asarray(np.einsum("kjab,kjb->kja", rows, self.wrenches))


def couplings(
    mechanism: Mechanism, points: Sequence[str], q: Array, active: Sequence[Active]
) -> Array:
    """Return X_ij (k, n, n, 6, 6) at k states, 1/kg, 1/(kg m) and 1/(kg m²).

    Args:
        mechanism: whose.
        points: names of n of its operational points.
        q: (k, nq) configurations.
        active: which closures are closed, at each.
    """
    index, rest = [mechanism.point_index(point) for point in points], np.zeros(mechanism.nv)
    chosen = np.ix_(index, index)
    return np.array(
        [
            coupling(mechanism.evaluate(at, rest, closed))[chosen]
            for at, closed in zip(q, active, strict=True)
        ]
    )


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
