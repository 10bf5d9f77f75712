# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Configurations in which a scene's loops are closed, sought from many starts."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import pinocchio as pin
from scipy.optimize import least_squares

from hapticmech_ros.errors import ClosureError, InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.model import authored_state
from hapticmech_ros.mechanism.projection import assemble
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Joint
from hapticmech_ros.system.workers import answers

# Of these many starts in one process most mechanisms close some; only then others help.
FIRST_STARTS = 16
# Starts in one task of a process.
CHUNK = 8
# Configurations nearer than this to one another are the same, rad, or m per length.
SAME = 1e-6

Show = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class LoopResidual:
    """How far a loop is open.

    Attributes:
        name: of the closure or coupling.
        kind: in the scene.
        distance: largest of the rows of points, m; None without any.
        angle: largest of the rows of axes, rad to first order; None without any.
    """

    name: str
    kind: str
    distance: float | None
    angle: float | None


@dataclass(frozen=True, slots=True)
class Assembled:
    """A configuration in which all loops are closed.

    Attributes:
        q: (nq,) configuration.
        moved: largest change of a coordinate from the scene's own start, rad, or m per length.
        beyond: names of the joints that are beyond their stops.
        least: relative σ_min of the closures: small next to a singular position.
    """

    q: Array
    moved: float
    beyond: tuple[str, ...]
    least: float


@dataclass(frozen=True, slots=True)
class AssemblySearch:
    """Result of a search.

    Attributes:
        written: how far each loop is open at the start as it is written.
        found: configurations that close all loops, within stops first, then the nearest first.
        open_q: (nq,) the configuration in which the loops are least open; closed if one was found.
        residuals: how far each loop is open there.
        starts: how many were tried.
        closed: how many of them led to a closed configuration.
    """

    written: tuple[LoopResidual, ...]
    found: tuple[Assembled, ...]
    open_q: Array
    residuals: tuple[LoopResidual, ...]
    starts: int
    closed: int


@dataclass(frozen=True, slots=True)
class _Attempt:
    """Where a start led: a configuration, and the largest residual in it, m per length or rad."""

    q: Array
    worst: float


def search_assemblies(
    scene: Scene,
    starts: int = 200,
    processes: int | None = None,
    seed: int = 0,
    show: Show = lambda done, closed: None,
) -> AssemblySearch:
    """Close a scene's loops from its start as written, and from random ones.

    Each start is closed by Gauss-Newton in the mass metric with short steps, as a scene's own is;
    one that does not close is led to the least sum of squared residuals by a trust region, and
    tried once more from there. Angles are drawn from -π to π, or between a joint's stops; distances
    between stops, or within the mechanism's length. The same seed gives the same result, with any
    number of processes.

    Args:
        scene: with closures that are closed at its start.
        starts: how many to try, the scene's own included; if one of the first sixteen closes, no
            others are tried.
        processes: that share the others; one for each core if None.
        seed: of the random starts.
        show: called with the numbers of starts tried and closed.

    Returns:
        The closed configurations that were found, and how far loops are open.

    Raises:
        InvalidInputError: no start, or no closure to close.
        LostError: the process of some starts was ended, twice.
    """
    if starts < 1:
        raise InvalidInputError("starts", starts, "must be 1 or more")
    seeker = _Seeker(scene, seed)
    if not any(seeker.active):
        raise InvalidInputError("scene", scene.name, "has no closed loop to assemble")
    attempts = seeker.attempts(range(min(starts, FIRST_STARTS)))
    show(len(attempts), seeker.closed(attempts))
    rest = range(len(attempts), starts)
    if rest and not seeker.closed(attempts):
        chunks = [rest[at : at + CHUNK] for at in range(0, len(rest), CHUNK)]
        for more in answers(partial(_attempts, scene, seed), chunks, processes):
            attempts += more
            show(len(attempts), seeker.closed(attempts))
    best = min(attempts, key=lambda attempt: attempt.worst)
    found = seeker.assembled(attempts)
    open_q = found[0].q if found else best.q
    return AssemblySearch(
        seeker.residuals(seeker.written),
        found,
        open_q,
        seeker.residuals(open_q),
        len(attempts),
        seeker.closed(attempts),
    )


def initial_state(scene: Scene, q: Array) -> str:
    """Return a configuration as a scene's ``initial_state``, JSON, which is YAML too.

    Velocities, and positions of joints that are locked, are the scene's own.

    Args:
        scene: whose joints.
        q: (nq,) configuration.
    """
    tree = Mechanism(scene).tree
    positions: dict[str, object] = dict(scene.initial_state.q)
    for index, name in enumerate(tree.joint_names):
        part = q[tree.position_slice(index)].tolist()
        positions[name] = part[0] if len(part) == 1 else part
    return json.dumps({"q": positions, "v": dict(scene.initial_state.v)}, ensure_ascii=False)


def _attempts(scene: Scene, seed: int, starts: Sequence[int]) -> list[_Attempt]:
    return _Seeker(scene, seed).attempts(starts)


class _Seeker:
    """Closes one scene's loops from numbered starts; number 0 is the scene's own."""

    def __init__(self, scene: Scene, seed: int) -> None:
        self._mechanism = Mechanism(scene)
        self._seed = seed
        self.active: Active = self._mechanism.initially_active
        self.written, _ = authored_state(scene, self._mechanism.tree)
        geared = {name for gear in scene.couplings for name in (gear.joint, gear.leader)}
        # Angles that may change by whole turns: nothing but the loops depends on them.
        self._turning = [
            self._mechanism.tree.position_slice(index).start
            for index, joint in enumerate(self._mechanism.tree.joints)
            if joint.type == "revolute"
            and joint.limits is None
            and not joint.stiffness
            and joint.name not in geared
        ]

    def attempts(self, starts: Sequence[int]) -> list[_Attempt]:
        """Return where each start led."""
        return [self._attempt(start) for start in starts]

    def closed(self, attempts: Sequence[_Attempt]) -> int:
        """Return how many led to closed loops."""
        return sum(attempt.worst == 0.0 for attempt in attempts)

    def assembled(self, attempts: Sequence[_Attempt]) -> tuple[Assembled, ...]:
        """Return the configurations that close the loops, each once, the best first."""
        found: list[Assembled] = []
        for attempt in attempts:
            if attempt.worst > 0.0:
                continue
            q = self._unwound(attempt.q)
            if all(self._away(q, other.q) > SAME for other in found):
                least = self._mechanism.closing_terms(q, self.active).least
                found.append(Assembled(q, self._away(self.written, q), self._beyond(q), least))
        return tuple(sorted(found, key=lambda one: (len(one.beyond), one.moved)))

    def residuals(self, q: Array) -> tuple[LoopResidual, ...]:
        """Return how far each loop is open at q (nq,)."""
        mechanism = self._mechanism
        rows = np.abs(mechanism.closing_terms(q, self.active).residual)
        found, at = [], 0
        for closure, on in zip(mechanism.closures, self.active, strict=True):
            if on:
                points, axes = np.split(rows[at : at + closure.rows], [closure.point_rows])
                distance = float(points.max()) if points.size else None
                angle = float(axes.max()) if axes.size else None
                found.append(LoopResidual(closure.name, closure.kind, distance, angle))
                at += closure.rows
        return tuple(found)

    def _attempt(self, number: int) -> _Attempt:
        q = self.written if number == 0 else self._random(number)
        for _ in range(2):
            try:
                return _Attempt(self._close(q), 0.0)
            except ClosureError:
                q = self._nearest(q)
        # A closure whose axes are reversed has no residual either.
        worst = max(float(np.abs(self._scaled(q)).max()), np.finfo(float).tiny)
        return _Attempt(q, worst)

    def _close(self, q: Array) -> Array:
        mechanism = self._mechanism
        return assemble(mechanism, q, np.zeros(mechanism.nv), self.active)[0]

    def _nearest(self, start: Array) -> Array:
        """Return the configuration of least squared residuals that is reached from a start."""
        mechanism = self._mechanism

        def residual(change: Array) -> Array:
            return self._scaled(mechanism.integrate(start, change))

        found = least_squares(residual, np.zeros(mechanism.nv), max_nfev=200)
        return np.asarray(mechanism.integrate(start, found.x))

    def _scaled(self, q: Array) -> Array:
        """Return the residual (m,), points per length of the mechanism."""
        mechanism = self._mechanism
        lengths = [
            closure.row_lengths(mechanism.length)
            for closure, on in zip(mechanism.closures, self.active, strict=True)
            if on
        ]
        residual = mechanism.closing_terms(q, self.active).residual
        return np.asarray(residual / np.concatenate(lengths))

    def _random(self, number: int) -> Array:
        random = np.random.default_rng((self._seed, number))
        tree, q = self._mechanism.tree, self.written.copy()
        for index, joint in enumerate(tree.joints):
            q[tree.position_slice(index)] = self._position(joint, random)
        return q

    def _position(self, joint: Joint, random: np.random.Generator) -> Array:
        length = self._mechanism.length
        if joint.limits is not None:
            return random.uniform(joint.limits.lower, joint.limits.upper, 1)
        if joint.type == "revolute":
            return random.uniform(-np.pi, np.pi, 1)
        if joint.type == "prismatic":
            return random.uniform(-length, length, 1)
        if joint.type == "planar":
            angle = random.uniform(-np.pi, np.pi)
            place = random.uniform(-length, length, 2)
            return np.array([*place, np.cos(angle), np.sin(angle)])
        turn = random.normal(size=4)
        quaternion = turn / np.linalg.norm(turn)
        if joint.type == "spherical":
            return quaternion
        return np.concatenate((random.uniform(-length, length, 3), quaternion))

    def _unwound(self, q: Array) -> Array:
        """Return the same configuration with angles within half a turn of those written."""
        q = q.copy()
        away = q[self._turning] - self.written[self._turning]
        q[self._turning] -= 2.0 * np.pi * np.round(away / (2.0 * np.pi))
        return q

    def _away(self, one: Array, other: Array) -> float:
        change = np.abs(pin.difference(self._mechanism.model, one, other))
        tree, length = self._mechanism.tree, self._mechanism.length
        for index, joint in enumerate(tree.joints):
            at = tree.velocity_slice(index)
            linear = {"prismatic": 1, "planar": 2, "free": 3}.get(joint.type, 0)
            change[at.start : at.start + linear] /= length
        return float(change.max(initial=0.0))

    def _beyond(self, q: Array) -> tuple[str, ...]:
        tree = self._mechanism.tree
        names = []
        for index, joint in enumerate(tree.joints):
            limits = joint.limits
            if limits is not None:
                at = float(q[tree.position_slice(index)][0])
                if not limits.lower <= at <= limits.upper:
                    names.append(joint.name)
        return tuple(names)
