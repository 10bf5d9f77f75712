# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A mechanism: its model as constants for kernels, and its terms of Eq. 1 from a few of them.

Pinocchio builds the model; kernels evaluate it.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import Closing, factored
from hapticmech_ros.mechanism.evaluation import Evaluation, PointKinematics
from hapticmech_ros.mechanism.fitting import Fit, fitted
from hapticmech_ros.mechanism.kernels.active_set import ActiveSet
from hapticmech_ros.mechanism.kernels.closure_kernels import KINDS
from hapticmech_ros.mechanism.kernels.layout import sparse_or_dense
from hapticmech_ros.mechanism.kernels.model import DENSE, JOINT_COLUMNS, Constants
from hapticmech_ros.mechanism.kernels.motion_kernels import move_frames
from hapticmech_ros.mechanism.kernels.tree_kernels import JOINT_KINDS, joint_row
from hapticmech_ros.mechanism.model import authored_state
from hapticmech_ros.mechanism.multibody import MultibodyModel
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Joint, OperationalPoint

# A pose in memory: the columns of its rotation, then its translation.
_POSE_SIZE = 12


class Mechanism(MultibodyModel):
    """A scene's tree, closures and operational points, evaluated at states.

    Every result is an array of its own.

    Args:
        scene: what to model.
        fit: whether frames of loops that are written with about seven digits are fitted.

    Attributes:
        needs_matrix: whether the scene's integrator needs D as a matrix, as implicit ones do.
        fit: how frames of the scene's loops were moved; None if they are as written.

    Raises:
        SingularInertiaError: a joint moves no mass.
    """

    def __init__(self, scene: Scene, fit: bool = True) -> None:
        self.fit: Fit | None = fitted(scene, _as_written) if fit else None
        if self.fit is not None:
            scene = self.fit.scene
        super().__init__(scene)
        # Copying a pose is a fifth of making one.
        poses = pin.StdVec_SE3([pin.SE3.Identity()] * len(self.point_names))
        self._point_poses = tuple(poses)
        self._point_places = placement_view(poses)
        self._all_placements = self._placements()
        self._carriers = np.array([int(frame.parentJoint) for frame in self.model.frames])
        self._joint_rows = np.zeros((self.model.njoints, JOINT_COLUMNS))
        for index, joint in enumerate(self.tree.joints, 1):
            axis = np.array(joint.axis) / np.linalg.norm(joint.axis)
            placement = self.model.jointPlacements[index]
            inertia = self.model.inertias[index]
            row = joint_row(placement, axis, inertia, joint.armature, self.tree.carried[index])
            self._joint_rows[index] = row
        self._sets: dict[Active, ActiveSet] = {}
        self.needs_matrix: bool = SCHEMES[self.scene.simulation.integrator].implicit
        self._authored, _ = authored_state(scene, self.tree)
        self._single = [self._choose([index]) for index in range(len(self.closures))]

    def set_operational_point(self, point: OperationalPoint) -> None:
        """Put an operational point elsewhere; see :meth:`MultibodyModel.set_operational_point`."""
        super().set_operational_point(point)
        index = self.point_index(point.name)
        at = self._point_frames[index]
        frame = self.model.frames[at]
        self._carriers[at], self._all_placements[at] = (
            frame.parentJoint,
            _in_memory(frame.placement),
        )
        for active_set in {*self._sets.values(), *self._single}:
            for model in (active_set.model, active_set.dense.model):
                place = model.points[index]
                model.carriers[place] = self._carriers[at]
                model.placements[place] = self._all_placements[at]

    def evaluate(
        self, q: Array, v: Array, active: Active, closing: Closing | None = None
    ) -> Evaluation:
        """Return every term of Eq. 1 at a state, with the given closures active.

        Args:
            q: (nq,) configuration.
            v: (nv,) rates, rad/s or m/s.
            active: which closures are closed.
            closing: what :meth:`closing_terms` gave at the same q and closures, to save time.

        Raises:
            SingularInertiaError: D is not positive definite.
            HapticMechError: the SVD of the closures did not converge.
        """
        if closing is None:
            closing = self.closing_terms(q, active)
        nv, active_set = self.nv, closing.active_set
        first = 3 * nv + active_set.m
        each = 6 * nv + 12
        terms = np.empty(first + each * len(self._point_frames))
        state = np.array(q, dtype=float), np.array(v, dtype=float)
        move_frames(*active_set.constants, closing.packed, *state, terms, self._point_places)
        points = []
        for at, pose in zip(range(first, terms.size, each), self._point_poses, strict=True):
            moving = at + 6 * nv
            jacobian = terms[at:moving].reshape(6, nv)
            twist, drift = terms[moving : moving + 6], terms[moving + 6 : moving + 12]
            points.append(PointKinematics(pose.copy(), jacobian, twist, drift))
        return Evaluation(
            terms[:nv],
            terms[nv : 2 * nv],
            terms[2 * nv : 3 * nv],
            self.elements.effort,
            terms[3 * nv : first],
            closing,
            tuple(points),
            state[1],
        )

    def closing_terms(self, q: Array, active: Active) -> Closing:
        """Return φ, W and the factorisation at q: what projections need.

        Args:
            q: (nq,) configuration.
            active: per closure, whether it is closed.

        Raises:
            SingularInertiaError: D is not positive definite at q.
            HapticMechError: the SVD of the closures did not converge.
        """
        return factored(self.tree, self.active_set(active), q)

    def distance_of(self, index: int, q: Array, v: Array) -> tuple[float, float]:
        """Return |φ| of closure ``index``, active or not, and d|φ|/dt; m and rad, per s.

        Rows in m and in rad count alike. At φ = 0 the rate is 0.

        Args:
            index: of the closure.
            q: (nq,) configuration.
            v: (nv,) rates, rad/s or m/s.

        Raises:
            HapticMechError: as :meth:`closing_terms`.
        """
        closing = factored(self.tree, self._single[index], q)
        residual = closing.residual
        distance = float(np.sqrt(residual @ residual))
        rate = residual @ (closing.jacobian @ v)
        return distance, float(rate) / distance if distance > 0.0 else 0.0

    def active_set(self, active: Active) -> ActiveSet:
        """Return what a set of closures fixes; found once."""
        found = self._sets.get(active)
        if found is None:
            numbered = zip(enumerate(self.closures), active, strict=True)
            found = self._choose([index for (index, _), on in numbered if on])
            if not self.needs_matrix:
                found = sparse_or_dense(found, self._authored)
            self._sets[active] = found
        return found

    def take(self, active: Active, active_set: ActiveSet) -> None:
        """Use this factorisation for a set of closures, be it the quicker one or not."""
        self._sets[active] = active_set

    def _choose(self, indices: list[int]) -> ActiveSet:
        """Return the constants of some closures, with the frames that anything needs."""
        loops = [self.closures[index] for index in indices]
        springs = self.elements.springs
        used = [*self._point_frames, *(f for s in springs for f in (s.frame_a, s.frame_b))]
        used += [frame for loop in loops for frame in (loop.frame_a, loop.frame_b)]
        place = {frame: at for at, frame in enumerate(dict.fromkeys(used))}
        rows = np.array([0, *(loop.rows for loop in loops)], dtype=np.int64).cumsum()
        closures = [
            (KINDS[loop.kind], place[loop.frame_a], place[loop.frame_b], first)
            for loop, first in zip(loops, rows[:-1].tolist(), strict=True)
        ]
        lengths = [np.zeros(0), *(loop.row_lengths(self.length) for loop in loops)]
        frames = list(place)
        model = self.model
        return ActiveSet(
            Constants(
                self.nq,
                self.nv,
                int(rows[-1]),
                DENSE,
                width=0,
                border=0,
                independent=-1,
                carriers=self._carriers[frames],
                joints=np.array([self._joint_numbers(i) for i in range(model.njoints)]),
                closures=np.array(closures, dtype=np.int64).reshape(-1, 4),
                points=np.array([place[frame] for frame in self._point_frames]),
                elements=np.array([(e.rate, e.position) for e in self.elements.joints]),
                springs=np.array([(place[s.frame_a], place[s.frame_b]) for s in springs]),
                order=np.zeros(0, dtype=np.int64),
                sequence=np.zeros((0, 5), dtype=np.int64),
                damping=np.array(self.tree.damping, dtype=float),
                lengths=np.concatenate(lengths),
                units=self.row_units(indices),
                rounding=np.array([self.rounding(indices)]),
                placements=self._all_placements[frames],
                effort=self.elements.effort,
                element_values=np.array([_joint_values(e.joint) for e in self.elements.joints]),
                spring_values=np.array(
                    [
                        (s.stiffness, s.damping, s.rest_length, self.elements.shortest)
                        for s in springs
                    ]
                ),
                joint_values=self._joint_rows,
                gravity=np.array(model.gravity.linear),
            )
        )

    def _joint_numbers(self, joint: int) -> tuple[int, int, int, int, int]:
        """Return a joint's row of ``Model.joints``; the world's has no rates."""
        if joint == 0:
            return (0, 0, 0, 0, 0)
        model, kind = self.model, JOINT_KINDS[self.tree.joint_types[joint - 1]]
        first, count, position = model.idx_vs[joint], model.nvs[joint], model.idx_qs[joint]
        return (int(model.parents[joint]), int(first), int(count), kind, int(position))

    def _placements(self) -> Array:
        """Return (frames, 12) frames in their joints; first axes of rods' frames a stretched."""
        placements = np.array([_in_memory(frame.placement) for frame in self.model.frames])
        for loop in self.closures:
            if loop.kind == "rod":
                placements[loop.frame_a, :3] *= loop.rod_length
            elif loop.kind == "coupling":
                placements[loop.frame_a, :5] = loop.gear
        return placements


def _as_written(scene: Scene) -> Mechanism:
    return Mechanism(scene, fit=False)


def placement_view(poses: pin.StdVec_SE3) -> Array:
    """Return (n, 12) a view of poses in Pinocchio's memory: each one's axes, then origin, m.

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


def _joint_values(joint: Joint) -> tuple[float, ...]:
    """Return a joint's row of ``Model.element_values``; no stop is met at infinity."""
    own = (joint.stiffness, joint.rest, joint.friction, joint.friction_speed)
    stop = joint.limits
    if stop is None:
        return (*own, -np.inf, np.inf, 0.0, 0.0, 1.0)
    return (*own, stop.lower, stop.upper, stop.stiffness, stop.damping, stop.depth)


def _in_memory(pose: pin.SE3) -> Array:
    """Return (12,) a pose as Pinocchio keeps it."""
    return np.concatenate((pose.rotation.T.ravel(), pose.translation))
