# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Measurements of one run of the experiment, from a session or from a graph of nodes.

Time is in s from when the hand starts to push. Quantities that are sampled together share a time
array; a graph publishes some of them at lower rates than others. All axes are those of ``world``;
wrenches are force (N), then torque (N m).

Orientations are unit quaternions (x, y, z, w), which are interpolated over time.

Health of a graph of nodes: their last diagnostics in a bag.

One run of several users on one mechanism: a record of each, and their effects on each other.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from hapticmech_ros.bag import BagReader
from hapticmech_ros.bag.metadata import losses_of, read_metadata
from hapticmech_ros.device.hand import grasp_schedule_of
from hapticmech_ros.errors import BagError, InvalidInputError, check_one_of
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.numerics import Array
from hapticmech_ros.operational.analysis import coupling
from hapticmech_ros.scene import Scene
from hapticmech_ros.wire.messages import ENERGY_NAMES
from hapticmech_ros.wire.topics import DIAGNOSTICS

# Time between two rows of the users' effects on each other, s: that of topics at view rate.
COUPLING_PERIOD_S = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class SharedRecord:
    """Records of n users of one run, with one time zero: the first push of any of them.

    Attributes:
        users: by operational point, in the order of the scene's ``hands``.
        times: (k,) s, of the rest.
        wrenches: (k, n, 6) F_j, by each user's hand through its controller, on the mechanism, at
            its point, axes of the world, N and N m; they act from that time on.
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
            found = np.shape(getattr(self, name))
            if found != shape:
                raise InvalidInputError(f"shape of {name}", found, f"must be {shape}")
            _freeze(self, name)

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
            InvalidInputError: no user holds the point.
        """
        check_one_of("point", point, self.points)
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


Figure = int | float | str

LEVELS = {0: "ok", 1: "warning", 2: "error", 3: "stale"}


@dataclass(frozen=True, slots=True)
class NodeHealth:
    """Last status of a node.

    Attributes:
        level: ``ok``, ``warning``, ``error`` or ``stale``.
        message: of the node's diagnostics.
        figures: values by name, as numbers where possible; units are in the names.
    """

    level: str
    message: str
    figures: Mapping[str, Figure]


@dataclass(frozen=True, slots=True)
class GraphHealth:
    """How the run of a graph went.

    Attributes:
        nodes: last status of every node, by its name; empty if the bag has no diagnostics.
        lost: messages that the recorder lost, of each topic that lost any (None: not known); None
            if it did not count.
        interruptions: number of interruptions of rendering after the hands' start; None: not
            counted.
        reduced_gains: whether a controller had to reduce its gains for a longer delay; None: not
            known.
        lockstep: whether the graph advanced by messages instead of by time; None: not known.
    """

    nodes: Mapping[str, NodeHealth]
    lost: Mapping[str, int | None] | None = None
    interruptions: int | None = None
    reduced_gains: bool | None = None
    lockstep: bool | None = None

    def total(self, figure: str) -> float | None:
        """Return the sum of a figure over the nodes that report it; None if none does."""
        values = [node.figures[figure] for node in self.nodes.values() if figure in node.figures]
        numbers = [value for value in values if not isinstance(value, str)]
        return sum(numbers) if numbers else None

    def one(self, figure: str) -> Figure | None:
        """Return a figure of the first node that reports it; None if none does."""
        found = (node.figures[figure] for node in self.nodes.values() if figure in node.figures)
        return next(found, None)


def health_from_bag(path: str | os.PathLike[str]) -> GraphHealth:
    """Return the last status of every node in the bag at ``path``, and its recorder's losses.

    Raises:
        BagError: no bag, a damaged one, or ``/diagnostics`` of another type.
    """
    last: dict[str, NodeHealth] = {}
    lost = losses_of(read_metadata(Path(path)))
    with BagReader(path) as bag:
        topic = bag.topics.get(DIAGNOSTICS.name)
        if topic is None:
            return GraphHealth({}, lost)
        if topic.type != DIAGNOSTICS.type:
            found = f"{DIAGNOSTICS.name} is {topic.type}, should be {DIAGNOSTICS.type}"
            raise BagError(f"bag {path}: {found}")
        for item in bag.messages(DIAGNOSTICS.name):
            for status in item.message.status:
                last[status.name] = _node(status)
    return GraphHealth(dict(sorted(last.items())), lost)


def _node(status: Any) -> NodeHealth:
    level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
    figures = {pair.key: _figure(pair.value) for pair in status.values}
    return NodeHealth(LEVELS.get(level, str(level)), status.message, figures)


def _figure(text: str) -> Figure:
    for kind in (int, float):
        try:
            value = kind(text)
        except ValueError:
            continue
        # JSON has neither infinity nor NaN.
        return value if abs(value) < float("inf") else text
    return text


Source = Literal["session", "graph"]

QUATERNION_TOLERANCE = 1e-3

# Time field -> fields sampled at those times, with their number of columns (None: any, 0: one
# number per time).
_GROUPS: dict[str, dict[str, int | None]] = {
    "times": {
        "device_position": 3,
        "device_orientation": 4,
        "point_position": 3,
        "point_orientation": 4,
        "hand_wrench": 6,
    },
    "wrench_times": {"constraint_wrench": 6},
    "analysis_times": {"count": 0, "s": None, "expected_wrench": 6},
    "energy_times": dict.fromkeys(ENERGY_NAMES, 0),
    "joint_times": {"joint_positions": None},
}
_NEEDED = ("times", "wrench_times", "analysis_times")


@dataclass(frozen=True, slots=True, eq=False)
class ExperimentRecord:
    """One run. Arrays are copied, checked and made read-only.

    Attributes:
        scene: name of the scene.
        point: name of the operational point that was held.
        source: ``session`` or ``graph``.
        period: s, nominal sample period.
        times: (n,) of device, operational point and hand.
        device_position: (n, 3) m, point held, as measured.
        device_orientation: (n, 4) unit quaternion x, y, z, w.
        point_position: (n, 3) m, operational point at the same times.
        point_orientation: (n, 4) unit quaternion x, y, z, w.
        hand_wrench: (n, 6) F_h, by the hand, on the device, at the point held.
        wrench_times: (m,)
        constraint_wrench: (m, 6) u_jc, by the joint-constraint controller, on the hand.
        analysis_times: (k,)
        count: (k,) number of joint constraints reported.
        s: (k, t) s of the spectrum, descending.
        expected_wrench: (k, 6) -(1 - β) Π F_h, the wrench with which the joints balance the hand's
            at rest, from the analysis alone; u_jc should approximate it.
        energy_times: (e,)
        kinetic, potential, work_in, damping_loss, latch_loss: (e,) J, of the mechanism.
        closure_error: (e,) largest residual of the closed loops, m or rad.
        surplus: (e,) J, made from nothing by the mechanism's steps, or lost if negative.
        refined, inaccurate: (e,) numbers of steps that were done again in smaller ones or with
            care, and of those that were still inaccurate.
        joint_times: (j,)
        joint_positions: (j, nq) q of the mechanism.
        lockstep: whether the graph advanced by messages instead of by time.

    Raises:
        InvalidInputError: wrong shapes, non-finite values, times that do not increase, or no data.
    """

    scene: str
    point: str
    source: Source
    period: float
    times: Array
    device_position: Array
    device_orientation: Array
    point_position: Array
    point_orientation: Array
    hand_wrench: Array
    wrench_times: Array
    constraint_wrench: Array
    analysis_times: Array
    count: Array
    s: Array
    expected_wrench: Array
    energy_times: Array
    kinetic: Array
    potential: Array
    work_in: Array
    damping_loss: Array
    latch_loss: Array
    closure_error: Array
    surplus: Array
    refined: Array
    inaccurate: Array
    joint_times: Array
    joint_positions: Array
    lockstep: bool = False

    def __post_init__(self) -> None:
        for time_name, fields in _GROUPS.items():
            times = self._set(time_name, ndim=1)
            if time_name in _NEEDED and times.size == 0:
                raise InvalidInputError(time_name, 0, "must hold at least one time")
            if not (np.diff(times) > 0.0).all():
                late = int(np.flatnonzero(np.diff(times) <= 0.0)[0]) + 1
                raise InvalidInputError(f"{time_name}[{late}]", times[late], "must increase")
            for name, columns in fields.items():
                values = self._set(name, ndim=1 if columns == 0 else 2)
                if values.shape[0] != times.size:
                    rule = f"must have a row for each of the {times.size} {time_name}"
                    raise InvalidInputError(f"rows of {name}", values.shape[0], rule)
                if columns and values.shape[1] != columns:
                    rule = f"must be {columns}"
                    raise InvalidInputError(f"columns of {name}", values.shape[1], rule)
        for name in ("device_orientation", "point_orientation"):
            lengths = np.linalg.norm(getattr(self, name), axis=1)
            wrong = np.flatnonzero(np.abs(lengths - 1.0) > QUATERNION_TOLERANCE)
            if wrong.size:
                what = f"length of {name}[{wrong[0]}]"
                raise InvalidInputError(what, lengths[wrong[0]], "must be 1")

    @property
    def energy_balance(self) -> Array:
        """Return (e,) J: stored energy minus work in plus losses; constant if energy balances."""
        held = self.kinetic + self.potential
        return np.asarray(held - self.work_in + self.damping_loss + self.latch_loss)

    def _set(self, name: str, ndim: int) -> Array:
        found = np.ndim(getattr(self, name))
        if found != ndim:
            raise InvalidInputError(f"dimensions of {name}", found, f"must be {ndim}")
        return _freeze(self, name, int if name == "count" else float)


def _freeze(record: object, name: str, kind: type = float) -> Array:
    """Copy an array of a record, and make the copy read-only.

    Args:
        record: whose attribute is replaced by the copy.
        name: of the attribute.
        kind: of the numbers.

    Returns:
        The copy.

    Raises:
        InvalidInputError: a number that is not finite.
    """
    array: Array = np.array(getattr(record, name), dtype=kind)
    if not np.isfinite(array).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise InvalidInputError(f"{name}{list(where)}", array[where], "must be finite")
    array.flags.writeable = False
    object.__setattr__(record, name, array)
    return array


def first_push(hand_wrench: Array) -> int | None:
    """Return the index of the first sample in which the hand pushes; None if there is none.

    Args:
        hand_wrench: (n, 6) N and N m.
    """
    pushing = np.flatnonzero(np.any(hand_wrench != 0.0, axis=1))
    return int(pushing[0]) if pushing.size else None


def angle_between(a: Array, b: Array) -> Array:
    """Return the angles (n,) in rad, 0 to pi, between orientations (n, 4) of either sign.

    Args:
        a: (n, 4) unit quaternions.
        b: (n, 4) unit quaternions.
    """
    return np.asarray((Rotation.from_quat(a).inv() * Rotation.from_quat(b)).magnitude())


def slerp(at: Array, times: Array, orientations: Array) -> Array:
    """Return orientations (m, 4) at times ``at`` (m,), on the shortest arc between neighbours.

    Args:
        at: (m,) s, within the span of ``times``; beyond it the first or last orientation holds.
        times: (n,) s, increasing.
        orientations: (n, 4) unit quaternions; at ``times`` they are returned unchanged.
    """
    if times.size == 1:
        return np.repeat(orientations, at.size, axis=0)
    inside = np.clip(at, times[0], times[-1])
    found = np.asarray(Slerp(times, Rotation.from_quat(orientations))(inside).as_quat())
    following = np.searchsorted(times, inside)
    known = times[following] == inside
    found[known] = orientations[following[known]]
    return found
