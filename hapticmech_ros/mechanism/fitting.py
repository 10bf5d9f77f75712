# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Loops that are written with about seven digits, fitted: they move as they were meant to.

Where a loop has more rows than its motion needs, as a planar loop in space or Bricard's linkage,
frames that are off by 1e-7 leave rows that nearly follow from others: the loop cannot be closed, or
is closed and stuck. The least change of the frames in the loops is looked for with which these rows
follow from the others all along the motion. With N the directions of rows that joints cannot move
(left singular vectors of W below ``FIT_TOLERANCE``), it is the solution of least norm of

Nᵀ(q_k) φ(q_k, p) = 0                                                                        (T20)

at configurations q_k along the motion, by Gauss-Newton in the frames' displacements p.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
import pinocchio as pin

from hapticmech_ros.mechanism.closures import Active, LoopClosure, origin_of
from hapticmech_ros.mechanism.constraint_space import Closing
from hapticmech_ros.mechanism.inertia import SingularInertiaError
from hapticmech_ros.mechanism.model import TreeModel, authored_state, se3
from hapticmech_ros.mechanism.tolerances import RESOLVED, SOLVER_RANK_TOLERANCE
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Joint, LinkFrame

# No frame is moved by more: a fraction of the mechanism's length, or rad. Rows this close to
# following from others are taken as redundant, if they stay so along the motion.
FIT_TOLERANCE = 1e-5
# Residuals (of the length, or rad) that are left where nothing has to be fitted. Rows follow from
# others if they add only rounding; a tenth of an independent row's threshold is accepted.
_CLOSED, _FOLLOWS = 1e-12, 0.1 * SOLVER_RANK_TOLERANCE
# Configurations along the motion, how many in one direction, and how far these are apart: rad, or
# m over the length.
_SAMPLES, _STRETCH, _APART = 48, 8, 0.15
# Of Gauss-Newton in the joints.
_STEPS, _STEP_LIMIT, _SMALL_STEP = 60, 0.1, 1e-13
# Of that in the frames; singular values below this share of the largest are the rounding of files.
_ROUNDS, _DETERMINED = 8, 1e-5


Displaced = TypeVar("Displaced", Joint, LinkFrame)


class _Fittable(Protocol):
    """The part of :class:`~hapticmech_ros.mechanism.mechanism.Mechanism` used here; see there."""

    scene: Scene
    tree: TreeModel
    model: pin.Model
    data: pin.Data
    closures: tuple[LoopClosure, ...]
    length: float
    nv: int
    initially_active: Active

    def closing_terms(self, q: Array, active: Active) -> Closing: ...

    def row_units(self, indices: Sequence[int]) -> Array: ...

    def span(self, change: Array) -> float: ...

    def integrate(self, q: Array, change: Array) -> Array: ...

    def difference(self, start: Array, end: Array) -> Array: ...


@dataclass(frozen=True, slots=True)
class Fit:
    """Loops whose frames were moved, and how far.

    Attributes:
        scene: with the frames that were fitted.
        closures: names of those that are closed at the start.
        residual: largest one before that no motion of the joints removes, m over the length, or
            rad.
        moved_m: largest displacement of a joint's or closure's frame, or change of a rod's length.
        moved_rad: largest turn of one.
        mobility: that the closures leave, before and after the fit.
    """

    scene: Scene
    closures: tuple[str, ...]
    residual: float
    moved_m: float
    moved_rad: float
    mobility: tuple[int, int]

    def __str__(self) -> str:
        before, now = self.mobility
        return (
            f"{', '.join(self.closures)}: frames were moved by up to {self.moved_m:.1e} m and"
            f" {self.moved_rad:.1e} rad, so that loops close (before: to {self.residual:.1e}) and"
            f" move with mobility {now} (before: {before})"
        )


class _At(NamedTuple):
    """Closures at a configuration.

    Attributes:
        q: (nq,) configuration.
        opened: largest residual, m over the length, or rad.
        residual: (m,) φ in the rows' units.
        factor: (nv, nv) L, of D.
        sigma: (k,) singular values of W L⁻ᵀ in these units.
        left: (m, m) directions of rows, those of ``sigma`` first.
        right: (nv, k) directions of rates in the mass metric.
        by_frames: (m, p) derivatives of φ by displacements of frames, in these units.
    """

    q: Array
    opened: float
    residual: Array
    factor: Array
    sigma: Array
    left: Array
    right: Array
    by_frames: Array

    @property
    def rank(self) -> int:
        """Number of rows that are independent by more than the fit's tolerance."""
        return int(np.sum(self.sigma > FIT_TOLERANCE * self.sigma[0]))

    def rates(self, lifted: Array) -> Array:
        """Return (nv,) rates from coordinates of the mass metric."""
        return np.asarray(np.linalg.solve(self.factor.T, lifted))

    def free(self, change: Array) -> Array:
        """Return the part (nv,) of a change that the independent rows leave."""
        kept = self.right[:, : self.rank]
        lifted = self.factor.T @ change
        return self.rates(lifted - kept @ (kept.T @ lifted))


def fitted(scene: Scene, mechanism_of: Callable[[Scene], _Fittable]) -> Fit | None:
    """Return the loops that are closed at the start with frames fitted; None if none has to be.

    Args:
        scene: as written.
        mechanism_of: returns the mechanism of a scene, its frames as they are there.

    Returns:
        None also where no change within ``FIT_TOLERANCE`` makes rows follow from others: they are
        constraints of their own then, next to a singular position maybe.

    Raises:
        SingularInertiaError: a joint moves no mass.
    """
    if not any(closure.active for closure in scene.closures):
        return None
    mechanism = mechanism_of(scene)
    active, (q, _) = mechanism.initially_active, authored_state(scene, mechanism.tree)
    try:
        closing = mechanism.closing_terms(q, active)
        if closing.error <= _CLOSED * mechanism.length and closing.least > FIT_TOLERANCE:
            return None
        return _Fitting(mechanism, mechanism_of).fit(q)
    except SingularInertiaError:
        return None  # at this configuration, which is reported where the mechanism begins to move


class _Fitting:
    """The conditions of one mechanism's loops, and the frames moved to meet them."""

    def __init__(self, mechanism: _Fittable, mechanism_of: Callable[[Scene], _Fittable]) -> None:
        self._written, self._mechanism_of = mechanism, mechanism_of
        self._active = mechanism.initially_active
        used = [index for index, on in enumerate(self._active) if on]
        self._loops = [mechanism.closures[index] for index in used]
        self._units = mechanism.row_units(used)
        self._length = mechanism.length
        self._lengths = np.concatenate([loop.row_lengths(self._length) for loop in self._loops])
        # Displacements of joints and of the closures' two frames, six each, then lengths of rods.
        self._joints = mechanism.model.njoints - 1
        self._rods = 6 * (self._joints + 2 * len(self._loops))

    def fit(self, q: Array) -> Fit | None:
        """Return the loops fitted, from next to q (nq,) on."""
        first = self._closed(self._written, q)
        if first is None or self._is_met(first, first.rank, RESOLVED):
            return None
        along = self._along(first)
        rank = max(at.rank for at in along)
        along = [at for at in along if at.rank == rank]
        if rank == first.residual.size:
            return None
        if all(self._is_met(at, rank, RESOLVED) for at in along):
            return None
        change, now = np.zeros(self._rods + len(self._loops)), along
        fit = None
        for _ in range(_ROUNDS):
            change += self._step(now, rank)
            if not np.abs(change).max() <= FIT_TOLERANCE:
                break
            scene = self._changed(change)
            mechanism = self._mechanism_of(scene)
            found = [self._closed(mechanism, at.q) for at in along]
            now = [at for at in found if at is not None]
            if len(now) < len(along):
                break
            if all(self._is_met(at, rank, _FOLLOWS) for at in now):
                fit = self._result(scene, change, along, now)
            if all(self._is_met(at, rank, RESOLVED) for at in now):
                break
        return fit

    def _at(self, mechanism: _Fittable, q: Array) -> _At:
        closing = mechanism.closing_terms(q, self._active)
        parts, units = closing.dense.parts, self._units
        # Not by BLAS's trsm: nodes come here as they start, and SciPy takes a tenth of a second.
        columns = np.linalg.solve(parts.factor, (parts.jacobian / units[:, None]).T)
        right, sigma, left = np.linalg.svd(columns)
        return _At(
            q,
            float(np.abs(closing.residual / self._lengths).max()),
            closing.residual / units,
            parts.factor,
            sigma,
            left.T,
            right[:, : sigma.size],
            self._by_frames(mechanism, q, parts.pairs) / units[:, None],
        )

    def _by_frames(self, mechanism: _Fittable, q: Array, pairs: Array) -> Array:
        """Return (m, p) derivatives of φ by displacements of frames in their own axes.

        Translations are in lengths of the mechanism. A row's wrenches are about the world's
        origin: their power on a twist there is the row's rate.
        """
        model, data = mechanism.model, mechanism.data
        pin.forwardKinematics(model, data, q)
        pin.updateFramePlacements(model, data)
        # In the plane: x, y, and the turn about z.
        planar = mechanism.scene.task_space == "planar"
        scale = np.repeat((self._length, 1.0), 3) * (np.array((1, 1, 0, 0, 0, 1)) if planar else 1)
        found = np.zeros((self._lengths.size, self._rods + len(self._loops)))
        first = 0
        for number, loop in enumerate(self._loops):
            rows = slice(first, first + loop.rows)
            first += loop.rows
            if loop.kind == "coupling":
                continue
            for side, index in enumerate((loop.frame_a, loop.frame_b)):
                wrenches = pairs[rows, 6 * side : 6 * side + 6]
                for joint in model.supports[int(model.frames[index].parentJoint)].tolist():
                    if joint > 0:
                        place = data.oMi[model.parents[joint]] * model.jointPlacements[joint]
                        at = 6 * (joint - 1)
                        found[rows, at : at + 6] += wrenches @ place.toActionMatrix() * scale
                at = 6 * (self._joints + 2 * number + side)
                found[rows, at : at + 6] = wrenches @ data.oMf[index].toActionMatrix() * scale
            if loop.kind == "rod":
                found[rows, self._rods + number] = -self._length
        return found

    def _closed(self, mechanism: _Fittable, q: Array) -> _At | None:
        """Return the configuration next to q that closes loops as far as joints can, if close."""
        for _ in range(_STEPS):
            at = self._at(mechanism, q)
            if not at.sigma[0] > 0.0:
                return None
            kept = at.rank
            lifted = at.right[:, :kept] @ ((at.left[:, :kept].T @ at.residual) / at.sigma[:kept])
            step = -at.rates(lifted)
            size = mechanism.span(step)
            if size <= _SMALL_STEP:
                return at if at.opened <= FIT_TOLERANCE else None
            q = mechanism.integrate(q, step * min(1.0, _STEP_LIMIT / size))
        return None

    def _is_met(self, at: _At, rank: int, least: float) -> bool:
        """Return whether loops are closed, and all rows but ``rank`` follow to a relative σ."""
        return at.opened <= _CLOSED and not (at.sigma[rank:] > least * at.sigma[0]).any()

    def _along(self, first: _At) -> list[_At]:
        """Return configurations along the motion, the start first."""
        mechanism, found, here = self._written, [first], first
        towards = np.zeros(mechanism.nv)
        for number in range(_SAMPLES):
            if number % _STRETCH == 0:
                # No mechanism singles these directions out, and they are the same each time.
                towards = np.cos(
                    np.sqrt(2.0) * (number + 1) * np.arange(1.0, mechanism.nv + 1) ** 2
                )
                here = first
            direction = here.free(towards)
            size = mechanism.span(direction)
            if not size > 1e-6 * mechanism.span(towards):
                break
            there = self._closed(
                mechanism, mechanism.integrate(here.q, direction * (_APART / size))
            )
            if there is not None:
                towards = mechanism.difference(here.q, there.q)
                found.append(there)
                here = there
        return found

    def _step(self, along: Sequence[_At], rank: int) -> Array:
        """Return the least change (p,) of the frames that meets the conditions to first order."""
        rows = np.vstack([at.left[:, rank:].T @ at.by_frames for at in along])
        missing = np.concatenate([at.left[:, rank:].T @ at.residual for at in along])
        return np.asarray(-np.linalg.lstsq(rows, missing, rcond=_DETERMINED)[0])

    def _changed(self, change: Array) -> Scene:
        """Return the scene with its frames displaced."""
        scene, tree = self._written.scene, self._written.tree
        scaled = change[: self._rods].reshape(-1, 6) * np.repeat((self._length, 1.0), 3)
        joints = dict(zip(tree.joint_names, scaled, strict=False))
        links = tuple(
            link.model_copy(update={"joint": _displaced(link.joint, joints[link.joint.name])})
            if link.joint.name in joints
            else link
            for link in scene.links
        )
        numbers = {loop.name: number for number, loop in enumerate(self._loops)}
        closures = []
        for written in scene.closures:
            number, closure = numbers.get(written.name), written
            if number is not None:
                at = self._joints + 2 * number
                ends = [
                    _displaced(end, twist)
                    for end, twist in zip((written.a, written.b), scaled[at : at + 2], strict=True)
                ]
                closure = written.model_copy(update={"a": ends[0], "b": ends[1]})
                if written.length is not None:
                    longer = float(change[self._rods + number]) * self._length
                    closure = closure.model_copy(update={"length": written.length + longer})
            closures.append(closure)
        return scene.model_copy(update={"links": links, "closures": tuple(closures)})

    def _result(
        self, scene: Scene, change: Array, before: Sequence[_At], now: Sequence[_At]
    ) -> Fit:
        frames, rods = np.split(np.abs(change), [self._rods])
        frames = frames.reshape(-1, 6)
        lengths = np.concatenate([frames[:, :3].ravel(), rods]) * self._length
        ranks = [
            int(np.sum(at.sigma > SOLVER_RANK_TOLERANCE * at.sigma[0]))
            for at in (before[0], now[0])
        ]
        nv = self._written.nv
        return Fit(
            scene,
            tuple(loop.name for loop in self._loops if loop.kind != "coupling"),
            max(at.opened for at in before),
            float(lengths.max()),
            float(frames[:, 3:].max()),
            (nv - ranks[0], nv - ranks[1]),
        )


def _displaced(part: Displaced, twist: Array) -> Displaced:
    """Return a joint or a closure's end whose origin is moved by a twist (6,), m and rad."""
    if not twist.any():
        return part
    return part.model_copy(update={"origin": origin_of(se3(part.origin) * pin.exp6(twist))})
