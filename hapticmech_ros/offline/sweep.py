# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Operational analysis over a grid of prescribed joint positions, with loops kept closed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
import numpy.typing as npt

from hapticmech_ros.errors import InvalidInputError, check_one_of
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.projection import consistent_initial_state
from hapticmech_ros.numerics import Array
from hapticmech_ros.offline.analysis import FeltStates, felt_states
from hapticmech_ros.operational.observation import rigid_count
from hapticmech_ros.scene import Scene
from hapticmech_ros.system.workers import WorkerPool, Workers

# Longest step of prescribed joints (rad or m) that keeps loops on their branch.
LONGEST_STEP = 0.02
# Largest closure error, as a fraction of the mechanism's length.
CLOSED, ROUNDS = 1e-12, 20

# Number of places nearest to the start that are tried as the first one.
MOST_STARTS = 50
# Least number of places at a time for which further processes save time.
WORTH_SHARING = 16
# Of them in one task.
CHUNK = 16

Show = Callable[[int], None]
Place = tuple[int, ...]
Goal = tuple[Array, list[float]]


@dataclass(frozen=True, slots=True)
class PrescribedJoint:
    """A joint with prescribed coordinates.

    Attributes:
        joint: name of a joint with one degree of freedom.
        values: coordinates to visit, rad or m.
    """

    joint: str
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class SweptStates(FeltStates):
    """Operational analysis at every place of a grid that the mechanism can reach.

    Attributes:
        places: (n, joints) coordinates of the prescribed joints, rad or m.
        grid: (n, joints) index of each place along each joint.
        q: (n, nq) configurations.
        count: (n,) joint constraints felt at rest.
    """

    places: Array
    grid: npt.NDArray[np.int64]
    q: Array
    count: npt.NDArray[np.int64]


def sweep(
    scene: Scene,
    prescribed: Sequence[PrescribedJoint],
    point: str = "",
    workers: Workers = 1,
    show: Show = lambda done: None,
) -> SweptStates:
    """Move joints over a grid from the scene's start, and analyse a point at each place.

    Loops that are closed at the scene's start are kept closed by the joints that are not
    prescribed. The result has every place that can be reached from a neighbour, beginning with the
    place nearest to the start.

    Args:
        scene: of the mechanism.
        prescribed: joints and their values.
        point: name of the operational point; the scene's first one if empty.
        workers: that share the places; the result is the same to the bit. A script that calls this
            with several processes has to guard it by ``if __name__ == "__main__"``.
        show: called with the number of places reached.

    Returns:
        The analysis of every place that was reached, in the grid's order.

    Raises:
        InvalidInputError: no joint, an unknown one, one with several degrees of freedom or named
            twice, no values or non-finite ones, or a grid without a reachable place.
        LostError: the process that moved to some places was ended, twice.
    """
    mechanism = Mechanism(scene)
    columns = _columns(mechanism, prescribed)
    mechanism.point_index(point)
    reached = dict([_first(mechanism, prescribed, columns)])
    front = list(reached)
    with WorkerPool(workers) as pool:
        while front:
            wanted = _beside(front, reached, prescribed)
            goals = [
                (reached[parent], [one.values[k] for one, k in zip(prescribed, place, strict=True)])
                for place, parent in wanted.items()
            ]
            found = zip(wanted, _moved(mechanism, columns, goals, pool), strict=True)
            front = []
            for place, q in found:
                if q is not None:
                    reached[place] = q
                    front.append(place)
            show(len(reached))
    return _felt(mechanism, prescribed, sorted(reached.items(), key=lambda item: item[0]), point)


def _first(
    mechanism: Mechanism, prescribed: Sequence[PrescribedJoint], columns: list[int]
) -> tuple[Place, Array]:
    """Return the place nearest to the scene's start, and the configuration there.

    Raises:
        InvalidInputError: none of the nearest places can be reached.
    """
    q, _ = consistent_initial_state(mechanism)
    here = mechanism.coordinates(q)[columns]
    grids = np.meshgrid(*(one.values for one in prescribed), indexing="ij")
    places = np.stack([grid.ravel() for grid in grids], axis=1)
    shape = tuple(len(one.values) for one in prescribed)
    nearest = np.argsort(np.abs(places - here).max(axis=1), kind="stable")[:MOST_STARTS]
    for index in nearest.tolist():
        there = _move(mechanism, q, columns, places[index].tolist())
        if there is not None:
            return tuple(int(k) for k in np.unravel_index(index, shape)), there
    rule = "must hold a place that the mechanism can reach"
    raise InvalidInputError("prescribed joints", [one.joint for one in prescribed], rule)


def _beside(
    front: list[Place], reached: Mapping[Place, Array], prescribed: Sequence[PrescribedJoint]
) -> dict[Place, Place]:
    """Return the unreached neighbours of the front, each with the place to start from."""
    wanted: dict[Place, Place] = {}
    for place in front:
        for axis, step in itertools.product(range(len(prescribed)), (-1, 1)):
            there = (*place[:axis], place[axis] + step, *place[axis + 1 :])
            if 0 <= there[axis] < len(prescribed[axis].values) and there not in reached:
                wanted.setdefault(there, place)
    return wanted


class _Goals(list[Goal]):
    """Where one process moves to."""

    def __str__(self) -> str:
        return f"{len(self)} places of a sweep"


def _moved(
    mechanism: Mechanism, columns: list[int], goals: list[Goal], pool: WorkerPool
) -> list[Array | None]:
    """Return for each (q, goal) the configuration there, or None.

    Few are moved to here, others by all who work at it.

    Raises:
        LostError: the process of some of them was ended, twice.
    """
    if pool.processes == 1 or len(goals) < WORTH_SHARING:
        return [_move(mechanism, q, columns, goal) for q, goal in goals]
    size = max(1, min(CHUNK, math.ceil(len(goals) / (pool.processes or 1))))
    chunks = [_Goals(goals[at : at + size]) for at in range(0, len(goals), size)]
    work = partial(_move_there, mechanism.scene.model_dump_json(), columns)
    return [q for some in pool.answers(work, chunks) for q in some]


@lru_cache(maxsize=1)
def _mechanism(scene: str) -> Mechanism:
    return Mechanism(Scene.model_validate_json(scene))


def _move_there(scene: str, columns: list[int], goals: list[Goal]) -> list[Array | None]:
    return [_move(_mechanism(scene), q, columns, goal) for q, goal in goals]


def _felt(
    mechanism: Mechanism,
    prescribed: Sequence[PrescribedJoint],
    reached: list[tuple[Place, Array]],
    point: str,
) -> SweptStates:
    grid = np.array([place for place, _ in reached], dtype=np.int64)
    q = np.array([configuration for _, configuration in reached])
    active = [mechanism.initially_active] * len(reached)
    felt = felt_states(mechanism, q, np.zeros((len(reached), mechanism.nv)), active, point)
    places = [
        [joint.values[k] for joint, k in zip(prescribed, row, strict=True)] for row in grid.tolist()
    ]
    perception = mechanism.scene.perception
    count = np.array([rigid_count(s, perception) for s in felt.s], dtype=np.int64)
    return SweptStates(**felt.arrays(), places=np.array(places), grid=grid, q=q, count=count)


def _columns(mechanism: Mechanism, prescribed: Sequence[PrescribedJoint]) -> list[int]:
    """Return the indices in v of the prescribed joints.

    Raises:
        InvalidInputError: as :func:`sweep`.
    """
    tree, columns = mechanism.tree, []
    names = [joint.joint for joint in prescribed]
    if not names or len(set(names)) < len(names):
        raise InvalidInputError("prescribed joints", names, "must be at least one, each named once")
    for joint in prescribed:
        check_one_of("prescribed joint", joint.joint, tree.joint_names)
        part = tree.velocity_slice(tree.joint_names.index(joint.joint))
        if part.stop - part.start != 1:
            raise InvalidInputError(
                "prescribed joint", joint.joint, "must have one degree of freedom"
            )
        if not joint.values or not all(map(math.isfinite, joint.values)):
            rule = "must be at least one number, all finite"
            raise InvalidInputError(f"values of {joint.joint}", joint.values, rule)
        columns.append(part.start)
    return columns


def _move(mechanism: Mechanism, q: Array, columns: list[int], goal: list[float]) -> Array | None:
    """Return q with prescribed joints at ``goal`` and loops closed; None if not reachable."""
    start = mechanism.coordinates(q)[columns]
    way = np.array(goal) - start
    steps = max(1, math.ceil(float(np.abs(way).max(initial=0.0)) / LONGEST_STEP))
    for k in range(1, steps + 1):
        closed = _closed(mechanism, q, columns, start + way * (k / steps))
        if closed is None:
            return None
        q = closed
    return q


def _closed(mechanism: Mechanism, q: Array, columns: list[int], values: Array) -> Array | None:
    """Return q with the prescribed joints at their values and loops closed by Newton's method.

    None if the loops cannot be closed.
    """
    active = mechanism.initially_active
    change = np.zeros(mechanism.nv)
    change[columns] = values - mechanism.coordinates(q)[columns]
    q = mechanism.integrate(q, change)
    others = np.setdiff1d(np.arange(mechanism.nv), columns)
    for _ in range(ROUNDS):
        closing = mechanism.closing_terms(q, active)
        if closing.error <= CLOSED * mechanism.length:
            return q
        rows = closing.jacobian[:, others]
        move, *_ = np.linalg.lstsq(rows, -closing.residual, rcond=1e-10)
        # A much longer move than that of the prescribed joints: the loops cannot be closed here.
        if np.abs(move).max(initial=0.0) > 20.0 * LONGEST_STEP:
            return None
        change[:] = 0.0
        change[others] = move
        q = mechanism.integrate(q, change)
    return None
