"""The mechanism that runs: :class:`Mechanism` with its terms of Eq. 1 from a few kernels.

Pinocchio computes D, h, joint Jacobians and placements; kernels take them where Pinocchio keeps
them, without copies. Results equal the parent's to rounding, at a quarter of the time.
"""

from __future__ import annotations

from typing import ClassVar, cast

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism.closure_kernels import KINDS
from hapticmech_ros.mechanism.compiled_space import CompiledSpace
from hapticmech_ros.mechanism.constraint_space import singular_inertia
from hapticmech_ros.mechanism.kernels import factor_closures, solve_motion
from hapticmech_ros.mechanism.mechanism import (
    Active,
    Closing,
    Evaluation,
    Mechanism,
    PointKinematics,
)
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.mechanism.motion_kernels import move_frames
from hapticmech_ros.scene.document import Scene

# A pose in memory: the columns of its rotation, then its translation.
_POSE_SIZE = 12


class CompiledEvaluation(Evaluation):
    """All terms of Eq. 1 at one state, solved by a kernel."""

    __slots__ = ()

    def acceleration(self, joint_force: Array) -> tuple[Array, Array]:
        """Solve Eq. 1 for joint forces; see :meth:`Evaluation.acceleration`."""
        bias_force, passive, _, _, bias, _, _ = self
        space = cast(CompiledSpace, self.space)
        nv = bias_force.size
        result = np.empty(nv + bias.size)
        result[:nv] = joint_force
        solve_motion(space.packed, space.rank, bias_force, passive, bias, result)
        return result[:nv], result[nv:]


class CompiledClosing(Closing):
    """φ, W and what kernels made of them."""

    __slots__ = ()

    @property
    def error(self) -> float:
        """Largest |φ|, m or rad; 0 without closures."""
        return float(cast(CompiledSpace, self.space).packed[-1])


class _Chosen:
    """What a set of active closures fixes: their table, row units, and places in a packed space."""

    def __init__(self, closures: Array, lengths: Array, nv: int) -> None:
        self.closures = closures
        self.lengths = lengths
        self.rows = m = lengths.size
        factor = nv * nv
        self.residual = slice(factor, factor + m)
        self.jacobian = slice(factor + m, factor + m + m * nv)
        self.size = factor + m * (nv + 1) + min(m, nv) * (nv + m + 1) + 1
        self.bias = slice(2 * nv, 2 * nv + m)


class CompiledMechanism(Mechanism):
    """A scene's tree, closures and operational points, evaluated at states by kernels."""

    compiled: ClassVar[bool] = True

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        model, data, nv = self.model, self.data, self.nv
        # Views of what Pinocchio allocated for the life of ``data``, transposed: rows first.
        self._inertia = np.reshape(data.M, (nv, nv), order="F").T
        self._joint_jacobian = np.reshape(data.J, (6, nv), order="F").T
        self._bias_force = np.reshape(data.nle, nv)
        self._poses = placement_view(data)
        self._point_poses = tuple(data.oMf[frame] for frame in self._point_frames)
        self._rates = np.empty(nv)
        self._damping = np.array(self.tree.damping, dtype=float)
        self._carriers = np.array([int(frame.parentJoint) for frame in model.frames])
        self._points = np.array(self._point_frames, dtype=np.int64)
        self._joints = np.array(
            [(int(model.parents[i]), *_rates_of(model, i)) for i in range(model.njoints)]
        )
        self._support = np.array([self._moved_by(joint) for joint in self._carriers.tolist()])
        self._sets: dict[Active, _Chosen] = {}
        self._single = [self._table([index]) for index in range(len(self.closures))]
        self._passive = slice(nv, 2 * nv)

    def evaluate(
        self, q: Array, v: Array, active: Active, closing: Closing | None = None
    ) -> CompiledEvaluation:
        """Evaluate every term of Eq. 1; see :meth:`Mechanism.evaluate`."""
        if closing is None:
            closing = self.closing_terms(q, active)
        else:
            self._place(q)
        pin.nonLinearEffects(self.model, self.data, q, v)
        self._rates[:] = v
        nv, chosen = self.nv, self._set(active)
        forces = np.empty(2 * nv + chosen.rows)
        count = len(self._point_poses)
        jacobians, motions = np.empty((count, 6, nv)), np.empty((count, 2, 6))
        move_frames(
            self._bias_force,
            self._damping,
            self._rates,
            self._joint_jacobian,
            self._poses,
            self._support,
            self._carriers,
            self._joints,
            chosen.closures,
            self._points,
            forces,
            jacobians,
            motions,
        )
        points = []
        for index, pose in enumerate(self._point_poses):
            twist, drift = motions[index]
            points.append(PointKinematics(pose.copy(), jacobians[index], twist, drift))
        residual, jacobian, space = closing
        return CompiledEvaluation(
            forces[:nv],
            forces[self._passive],
            residual,
            jacobian,
            forces[chosen.bias],
            space,
            tuple(points),
        )

    def closing_terms(self, q: Array, active: Active) -> Closing:
        """Return φ, W and the factorisation at q: what projections need."""
        pin.crba(self.model, self.data, q)
        self._place(q)
        return self._factored(self._set(active))

    def distance_of(self, index: int, q: Array, v: Array) -> tuple[float, float]:
        """Return |φ| of closure ``index``, active or not, and the rate at which it grows."""
        residual, jacobian, _ = self._closing_of(index, q)
        distance = float(np.sqrt(residual @ residual))
        rate = residual @ (jacobian @ v)
        return distance, float(rate) / distance if distance > 0.0 else 0.0

    def _closing_of(self, index: int, q: Array) -> Closing:
        pin.crba(self.model, self.data, q)
        self._place(q)
        return self._factored(self._single[index])

    def _place(self, q: Array) -> None:
        """Compute joint Jacobians and placements of joints and frames."""
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)

    def _factored(self, chosen: _Chosen) -> Closing:
        packed = np.empty(chosen.size)
        rank = factor_closures(
            self._inertia,
            self._joint_jacobian,
            self._poses,
            self._support,
            chosen.closures,
            chosen.lengths,
            packed,
        )
        if rank < 0:
            if rank == -1:
                raise HapticMechError("SVD of the loop closures did not converge")
            raise singular_inertia(-2 - rank)
        nv, m = self.nv, chosen.rows
        space = CompiledSpace(packed, nv, m, rank)
        residual, jacobian = packed[chosen.residual], packed[chosen.jacobian].reshape(m, nv)
        return CompiledClosing(residual, jacobian, space)

    def _set(self, active: Active) -> _Chosen:
        found = self._sets.get(active)
        if found is None:
            found = self._table([i for i, on in self._numbered(active) if on])
            self._sets[active] = found
        return found

    def _numbered(self, active: Active) -> list[tuple[int, bool]]:
        return [(i, on) for (i, _), on in zip(enumerate(self.closures), active, strict=True)]

    def _table(self, indices: list[int]) -> _Chosen:
        table, lengths, first = np.zeros((len(indices), 4), dtype=np.int64), [np.zeros(0)], 0
        for row, index in enumerate(indices):
            loop = self.closures[index]
            table[row] = KINDS[loop.kind], loop.frame_a, loop.frame_b, first
            lengths.append(loop.row_lengths(self.length))
            first += loop.rows
        return _Chosen(table, np.concatenate(lengths), self.nv)

    def _moved_by(self, joint: int) -> Array:
        """Return (nv,) 1 for the rates of a joint and of those before it, 0 for others."""
        moves = np.zeros(self.nv)
        while joint > 0:
            first, count = _rates_of(self.model, joint)
            moves[first : first + count] = 1.0
            joint = int(self.model.parents[joint])
        return moves


def placement_view(data: pin.Data) -> Array:
    """Return (frames, 12) a view of ``data.oMf``: each frame's axes, then its origin.

    Raises:
        HapticMechError: this build of Pinocchio keeps poses in another order.
    """
    rotations = [pose.rotation for pose in data.oMf]
    starts = [rotation.__array_interface__["data"][0] for rotation in rotations]
    origins = [pose.translation.__array_interface__["data"][0] for pose in data.oMf]
    stride = starts[1] - starts[0]
    even = all(at == starts[0] + i * stride for i, at in enumerate(starts))
    packed = all(at - start == 9 * 8 for at, start in zip(origins, starts, strict=True))
    if not (even and packed and stride == 8 * _POSE_SIZE and rotations[0].flags.f_contiguous):
        raise HapticMechError("Pinocchio's placements are not one array of rotation, translation")
    shape = (len(starts), _POSE_SIZE)
    return np.lib.stride_tricks.as_strided(rotations[0].T, shape, (stride, 8))


def _rates_of(model: pin.Model, joint: int) -> tuple[int, int]:
    """Return the first rate of a joint and their number; none for the world."""
    return (int(model.idx_vs[joint]), int(model.nvs[joint])) if joint > 0 else (0, 0)
