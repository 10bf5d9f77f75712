"""The mechanism that runs: :class:`Mechanism` with its terms of Eq. 1 from a few kernels.

Pinocchio computes D, h, joint Jacobians and placements; kernels take them where Pinocchio keeps
them, without copies. Results equal the parent's to rounding, at a quarter of the time.
"""

from __future__ import annotations

from typing import ClassVar, cast

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism.compiled.closure_kernels import KINDS
from hapticmech_ros.mechanism.compiled.kernels import (
    NO_SVD,
    SINGULAR,
    factor_closures,
    solve_motion,
)
from hapticmech_ros.mechanism.compiled.motion_kernels import move_frames
from hapticmech_ros.mechanism.compiled.packed import packed_size
from hapticmech_ros.mechanism.compiled.space import CompiledClosing, CompiledSpace
from hapticmech_ros.mechanism.compiled.tables import Tables, fold
from hapticmech_ros.mechanism.constraint_space import singular_inertia, singular_joint
from hapticmech_ros.mechanism.elements import Elements
from hapticmech_ros.mechanism.evaluation import Active, Closing, Evaluation, PointKinematics
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.model import Array, TreeModel
from hapticmech_ros.scene.document import Scene
from hapticmech_ros.scene.mechanism import Joint

# A pose in memory: the columns of its rotation, then its translation.
_POSE_SIZE = 12
# In these axes ``crba`` leaves joint Jacobians and joints' poses behind as well.
_IN_WORLD = pin.Convention.WORLD


class CompiledEvaluation(Evaluation):
    """All terms of Eq. 1 at one state, solved by a kernel."""

    __slots__ = ()

    def acceleration(self, joint_force: Array) -> tuple[Array, Array]:
        """Solve Eq. 1 for joint forces; see :meth:`Evaluation.acceleration`."""
        bias_force, passive, _, effort, bias, closing, _ = self
        space = cast(CompiledSpace, closing.space)
        nv = bias_force.size
        result = np.empty(nv + bias.size)
        np.add(joint_force, effort, out=result[:nv])
        solve_motion(space.packed, space.rank, bias_force, passive, bias, result)
        return result[:nv], result[nv:]


class Chosen:
    """What a set of active closures fixes.

    Attributes:
        constants: the mechanism's tables with these closures, folded.
        m: number of closure rows.
        size: length of a packed array.
        scratch: a packed array for terms that nobody keeps.
    """

    def __init__(self, tables: Tables) -> None:
        self.constants = fold(tables)
        self.m = tables.m
        self.size = packed_size(tables.nv, tables.m, tables.carriers.size)
        self.scratch = np.empty(self.size)


class CompiledMechanism(Mechanism):
    """A scene's tree, closures and operational points, evaluated at states by kernels.

    Attributes:
        placed: D (lower triangle), joint Jacobians and joints' poses at what :meth:`place` was
            given: views of what Pinocchio computed.
        bias_force: (nv,) view of h after ``nonLinearEffects``.
    """

    compiled: ClassVar[bool] = True

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        model, data, nv = self.model, self.data, self.nv
        # Views of what Pinocchio allocated for the life of ``data``, transposed: rows first.
        self.placed: tuple[Array, Array, Array] = (
            np.reshape(data.M, (nv, nv), order="F").T,
            np.reshape(data.J, (6, nv), order="F").T,
            placement_view(data.oMi),
        )
        self.bias_force: Array = np.reshape(data.nle, nv)
        # Copying a pose is a fifth of making one.
        poses = pin.StdVec_SE3([pin.SE3.Identity()] * len(self.point_names))
        self._point_poses = tuple(poses)
        self._point_places = placement_view(poses)
        self._position, self._rates = np.empty(self.nq), np.empty(nv)
        carriers = np.array([int(frame.parentJoint) for frame in model.frames])
        self._without_closures = Tables(
            self.nq,
            nv,
            0,
            carriers,
            joints=np.array(
                [(int(model.parents[i]), *_rates_of(model, i)) for i in range(model.njoints)]
            ),
            closures=np.zeros((0, 4)),
            points=np.array(self._point_frames),
            damping=np.array(self.tree.damping, dtype=float),
            lengths=np.zeros(0),
            support=np.array([self._moved_by(joint) for joint in carriers.tolist()]),
            placements=self._placements(),
            **_element_tables(self.elements),
        )
        self._sets: dict[Active, Chosen] = {}
        self._single = [self._table([index]) for index in range(len(self.closures))]

    def evaluate(
        self, q: Array, v: Array, active: Active, closing: Closing | None = None
    ) -> CompiledEvaluation:
        """Evaluate every term of Eq. 1; see :meth:`Mechanism.evaluate`."""
        if closing is None:
            closing = self.closing_terms(q, active)
        pin.nonLinearEffects(self.model, self.data, q, v)
        self._position[:] = q
        self._rates[:] = v
        nv, chosen = self.nv, self.chosen(active)
        first = 3 * nv + chosen.m
        each = 6 * nv + 12
        terms = np.empty(first + each * len(self._point_frames))
        packed = cast(CompiledClosing, closing).packed
        state, poses = (self._position, self._rates), self._point_places
        move_frames(*chosen.constants, packed, self.bias_force, *state, terms, poses)
        points = []
        for at, pose in zip(range(first, terms.size, each), self._point_poses, strict=True):
            moving = at + 6 * nv
            jacobian = terms[at:moving].reshape(6, nv)
            twist, drift = terms[moving : moving + 6], terms[moving + 6 : moving + 12]
            points.append(PointKinematics(pose.copy(), jacobian, twist, drift))
        return CompiledEvaluation(
            terms[:nv],
            terms[nv : 2 * nv],
            terms[2 * nv : 3 * nv],
            self.elements.effort,
            terms[3 * nv : first],
            closing,
            tuple(points),
        )

    def closing_terms(self, q: Array, active: Active) -> Closing:
        """Return φ, W and the factorisation at q: what projections need."""
        self.place(q)
        return self._factored(self.chosen(active))

    def distance_of(self, index: int, q: Array, v: Array) -> tuple[float, float]:
        """Return |φ| of closure ``index``, active or not, and the rate at which it grows."""
        self.place(q)
        closing = self._factored(self._single[index])
        residual = closing.residual
        distance = float(np.sqrt(residual @ residual))
        rate = residual @ (closing.jacobian @ v)
        return distance, float(rate) / distance if distance > 0.0 else 0.0

    def place(self, q: Array) -> None:
        """Compute D, joint Jacobians and joints' poses at q."""
        pin.crba(self.model, self.data, q, _IN_WORLD)

    def chosen(self, active: Active) -> Chosen:
        """Return what a set of closures fixes; found once."""
        found = self._sets.get(active)
        if found is None:
            numbered = zip(enumerate(self.closures), active, strict=True)
            found = self._table([index for (index, _), on in numbered if on])
            self._sets[active] = found
        return found

    def _factored(self, chosen: Chosen) -> CompiledClosing:
        packed = np.empty(chosen.size)
        code = factor_closures(*chosen.constants, *self.placed, packed)
        if code < 0:
            raise failure(code, self.tree)
        # Closures are asked for their branch next.
        pin.updateFramePlacements(self.model, self.data)
        return CompiledClosing(packed, self.nv, chosen.m)

    def _table(self, indices: list[int]) -> Chosen:
        table, lengths, first = np.zeros((len(indices), 4), dtype=np.int64), [np.zeros(0)], 0
        for row, index in enumerate(indices):
            loop = self.closures[index]
            table[row] = KINDS[loop.kind], loop.frame_a, loop.frame_b, first
            lengths.append(loop.row_lengths(self.length))
            first += loop.rows
        fixed = self._without_closures
        return Chosen(fixed._replace(m=first, closures=table, lengths=np.concatenate(lengths)))

    def _placements(self) -> Array:
        """Return (frames, 12) frames in their joints; first axes of rods' frames a stretched."""
        placements = np.array([_in_memory(frame.placement) for frame in self.model.frames])
        for loop in self.closures:
            if loop.kind == "rod":
                placements[loop.frame_a, :3] *= loop.rod_length
        return placements

    def _moved_by(self, joint: int) -> Array:
        """Return (nv,) 1 for the rates of a joint and of those before it, 0 for others."""
        moves = np.zeros(self.nv)
        while joint > 0:
            first, count = _rates_of(self.model, joint)
            moves[first : first + count] = 1.0
            joint = int(self.model.parents[joint])
        return moves


def failure(code: int, tree: TreeModel | None = None) -> HapticMechError:
    """Return the error of a kernel's negative code; ``tree`` gives degrees of freedom names."""
    if code == NO_SVD:
        return HapticMechError("SVD of the loop closures did not converge")
    rate = SINGULAR - code
    return singular_inertia(rate) if tree is None else singular_joint(tree, rate)


def placement_view(poses: pin.StdVec_SE3) -> Array:
    """Return (n, 12) a view of poses in Pinocchio's memory: each one's axes, then its origin.

    Raises:
        HapticMechError: this build of Pinocchio keeps poses in another order.
    """
    rotations = [pose.rotation for pose in poses]
    starts = [rotation.__array_interface__["data"][0] for rotation in rotations]
    origins = [pose.translation.__array_interface__["data"][0] for pose in poses]
    stride = 8 * _POSE_SIZE
    even = all(at == starts[0] + i * stride for i, at in enumerate(starts))
    packed = all(at - start == 9 * 8 for at, start in zip(origins, starts, strict=True))
    if not (even and packed and rotations[0].flags.f_contiguous):
        raise HapticMechError("Pinocchio's placements are not one array of rotation, translation")
    shape = (len(starts), _POSE_SIZE)
    return np.lib.stride_tricks.as_strided(rotations[0].T, shape, (stride, 8))


def _element_tables(elements: Elements) -> dict[str, Array]:
    """Return the tables of elements, by name; see :class:`Tables`."""
    return {
        "elements": np.array([(e.rate, e.position) for e in elements.joints]).reshape(-1, 2),
        "springs": np.array([(s.frame_a, s.frame_b) for s in elements.springs]).reshape(-1, 2),
        "effort": elements.effort,
        "element_values": np.array([_joint_values(e.joint) for e in elements.joints]),
        "spring_values": np.array(
            [(s.stiffness, s.damping, s.rest_length, elements.shortest) for s in elements.springs]
        ),
    }


def _joint_values(joint: Joint) -> tuple[float, ...]:
    """Return a joint's row of ``Tables.element_values``; no stop is met at infinity."""
    own = (joint.stiffness, joint.rest, joint.friction, joint.friction_speed)
    stop = joint.limits
    if stop is None:
        return (*own, -np.inf, np.inf, 0.0, 0.0, 1.0)
    return (*own, stop.lower, stop.upper, stop.stiffness, stop.damping, stop.depth)


def _in_memory(pose: pin.SE3) -> Array:
    """Return (12,) a pose as Pinocchio keeps it."""
    return np.concatenate((pose.rotation.T.ravel(), pose.translation))


def _rates_of(model: pin.Model, joint: int) -> tuple[int, int]:
    """Return the first rate of a joint and their number; none for the world."""
    return (int(model.idx_vs[joint]), int(model.nvs[joint])) if joint > 0 else (0, 0)
