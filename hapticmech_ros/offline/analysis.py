# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Λ_h⁻¹, its spectrum and the count of joint constraints at many states of a mechanism."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hapticmech_ros.bag.recorded_states import RecordedStates
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import Active, flat_grasp, grasp_of
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import OperationalModelSample
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.observation import ConstraintCounter

# Number of states between reports of progress.
TOLD = 1000

Show = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class FeltStates:
    """Operational analysis of a point at each of n states.

    Attributes:
        s: (n, t) √μ of each direction of the task space, descending; 0 is rigid.
        wrenches: (n, 6, t) columns n_i of these directions, axes of the world at the point, scaled
            by the link's inertia; the last ones, as many as joint constraints are felt, are the
            constraint wrenches.
        inverse_inertia: (n, 6, 6) X = Λ_h⁻¹, axes of the world, 1/kg, 1/(kg m) and 1/(kg m²).
        constraint_projector: (n, 6, 6) P_c, whose range is spanned by the constraint wrenches.
        wrench_projector: (n, 6, 6) Π.
        free_acceleration: (n, 6) a_0, m/s² and rad/s².
        position: (n, 3) of the point, m.
        quaternion: (n, 4) x, y, z, w.
        twist: (n, 6) m/s and rad/s.
    """

    s: Array
    wrenches: Array
    inverse_inertia: Array
    constraint_projector: Array
    wrench_projector: Array
    free_acceleration: Array
    position: Array
    quaternion: Array
    twist: Array

    def arrays(self) -> dict[str, Any]:
        """Return all arrays by their names."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write all arrays under their names as a NumPy archive.

        Returns:
            Its path.
        """
        target = Path(path)
        with target.open("wb") as file:
            np.savez(file, **self.arrays())
        return target


@dataclass(frozen=True, slots=True)
class AnalysedStates(FeltStates):
    """Operational analysis over a recording.

    Attributes:
        stamps_ns: (n,) stamps of the states, ns.
        times: (n,) since the first state, s.
        count: (n,) joint constraints reported, with hysteresis and dwell as in the analyser node.
    """

    stamps_ns: npt.NDArray[np.int64]
    times: Array
    count: npt.NDArray[np.int64]


def felt_states(
    mechanism: Mechanism,
    q: Array,
    v: Array,
    active: Sequence[Active],
    point: str = "",
    show: Show = lambda done, total: None,
    grasps: Array | None = None,
) -> FeltStates:
    """Analyse an operational point at n states.

    Args:
        mechanism: to analyse; its operational points are restored afterwards.
        q: (n, nq) configurations.
        v: (n, nv) rates.
        active: for each state, which closures are closed.
        point: name of the operational point; the scene's first one if empty.
        show: called with the number of states done and their total.
        grasps: (n, points, 7) of each operational point: index of its link among the scene's, xyz
            (m) and rpy (rad) in the link's frame; the scene's if None.

    Returns:
        The analysis of every state.

    Raises:
        InvalidInputError: no such point, or a point on an unknown link.
        HapticMechError: a state that cannot be analysed, with its index.
    """
    analyser = Analyser(mechanism, point)
    total, t = len(active), analyser.rows.size
    seen, wrenches = np.empty((total, OperationalModelSample.layout.size)), np.empty((total, t, t))
    places = None if grasps is None else grasps[:, analyser.index]
    start = analyser.point
    place = flat_grasp(mechanism.scene, start)
    try:
        for index in range(total):
            if places is not None and (places[index] != place).any():
                place = places[index]
                mechanism.set_operational_point(grasp_of(mechanism.scene, start.name, place))
                analyser = Analyser(mechanism, start.name)
            try:
                found = analyser.observe(q[index], v[index], active[index])
                seen[index] = found.model
                wrenches[index] = found.analysis.spectrum.wrenches
            except HapticMechError as error:
                raise HapticMechError(f"state {index} of {total}: {error}") from error
            if (index + 1) % TOLD == 0:
                show(index + 1, total)
    finally:
        mechanism.set_operational_point(start)
    show(total, total)

    def part(name: str) -> Array:
        return seen[:, OperationalModelSample.layout.slice(name)].copy()

    full = np.zeros((total, 6, t))
    full[:, analyser.rows] = wrenches
    return FeltStates(
        s=part("s")[:, :t].copy(),
        wrenches=full,
        inverse_inertia=part("inverse_inertia").reshape(total, 6, 6),
        constraint_projector=part("constraint_projector").reshape(total, 6, 6),
        wrench_projector=part("wrench_projector").reshape(total, 6, 6),
        free_acceleration=part("free_acceleration"),
        position=part("position"),
        quaternion=part("quaternion"),
        twist=part("twist"),
    )


def analyse_states(
    mechanism: Mechanism,
    states: RecordedStates,
    point: str = "",
    show: Show = lambda done, total: None,
) -> AnalysedStates:
    """Analyse an operational point at every recorded state; see :func:`felt_states`.

    Returns:
        The analysis of every state, with times and counts.
    """
    active = [tuple(row) for row in states.active.tolist()]
    felt = felt_states(mechanism, states.q, states.v, active, point, show, states.grasps)
    times = (states.stamps_ns - states.stamps_ns[:1]) / NANOSECONDS
    count = _counts(mechanism, felt.s, times)
    return AnalysedStates(**felt.arrays(), stamps_ns=states.stamps_ns, times=times, count=count)


def _counts(mechanism: Mechanism, s: Array, times: Array) -> npt.NDArray[np.int64]:
    counter = ConstraintCounter(mechanism.scene.perception)
    pairs = zip(s, times.tolist(), strict=True)
    return np.array([counter.update(row, time) for row, time in pairs], dtype=np.int64)
