# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A mechanism: its model as constants for kernels, and its terms of Eq. 1 from a few of them.

Pinocchio builds the model from a scene's tree, closures, elements and operational points; kernels
evaluate it.

    D(q) v̇ + h(q, v) = τ + Σ Jᵀ F - Wᵀ λ,      W v̇ + Ẇ v = 0

where τ are the forces of springs, dampers, friction, stops and efforts (see :mod:`elements`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import HapticMechError, InvalidInputError, check_one_of
from hapticmech_ros.mechanism.closures import (
    Active,
    LoopClosure,
    bind_closure,
    bind_coupling,
)
from hapticmech_ros.mechanism.constraint_space import Closing, Evaluation, PointKinematics, factored
from hapticmech_ros.mechanism.elements import Elements, bind_spring, chosen_integrator
from hapticmech_ros.mechanism.fitting import Fit, fitted
from hapticmech_ros.mechanism.inertia import ANGULAR, refuse_massless
from hapticmech_ros.mechanism.kernels.closure_kernels import KINDS
from hapticmech_ros.mechanism.kernels.layout import ActiveSet, sparse_or_dense
from hapticmech_ros.mechanism.kernels.model import DENSE, JOINT_COLUMNS
from hapticmech_ros.mechanism.kernels.motion_kernels import move_frames
from hapticmech_ros.mechanism.kernels.tree_kernels import JOINT_KINDS, joint_row
from hapticmech_ros.mechanism.model import TreeModel, authored_state, build_tree
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.mechanism.tolerances import NEAR, RESOLVED
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Joint, OperationalPoint

# A pose in memory: the columns of its rotation, then its translation.
_POSE_SIZE = 12
# Rounding of a closure's row, as a share of its ends' parts: some units of the last place.
_ROUNDING = 16.0 * np.finfo(float).eps


class Mechanism:
    """A scene's tree, closures and operational points, evaluated at states.

    Every result is a new array.

    Args:
        scene: to model.
        fit: whether frames of loops that are written with about seven digits are fitted.

    Attributes:
        scene: the model's, with the integrator that ``auto`` selects.
        fit: how frames of the scene's loops were moved; None if they are as written.
        nv: number of degrees of freedom of the open tree.
        nq: length of the configuration vector.
        length: characteristic length, m; the unit of closures' point rows.
        elements: springs, dampers, friction, stops and efforts.
        initially_active: which closures are closed as the scene starts; couplings always.
        needs_matrix: whether the scene's integrator needs D as a matrix, as implicit ones do.

    Raises:
        SingularInertiaError: a joint moves no mass.
    """

    def __init__(self, scene: Scene, fit: bool = True) -> None:
        self.fit: Fit | None = (
            fitted(scene, lambda written: Mechanism(written, fit=False)) if fit else None
        )
        if self.fit is not None:
            scene = self.fit.scene
        self.scene = scene
        self.tree: TreeModel = build_tree(scene)
        self.closures: tuple[LoopClosure, ...] = (
            *(bind_closure(closure, self.tree) for closure in scene.closures),
            *(bind_coupling(coupling, self.tree) for coupling in scene.couplings),
        )
        self.point_names = tuple(point.name for point in scene.operational_points)
        self._point_frames = tuple(
            self.tree.add_frame(f"point/{point.name}", point.link, point.origin)
            for point in scene.operational_points
        )
        springs = tuple(bind_spring(spring, self.tree) for spring in scene.springs)
        self.model: pin.Model = self.tree.pinocchio
        self.data: pin.Data = self.model.createData()
        self.nv, self.nq = int(self.model.nv), int(self.model.nq)
        self.length = self.tree.extent()
        refuse_massless(self.tree, self.length)
        self.elements = Elements(self.tree, springs, self.length)
        if scene.simulation.integrator == "auto":
            chosen = chosen_integrator(scene, self.tree, springs)
            self.scene = scene.stepped(integrator=chosen)
        self._neutral: Array = np.asarray(pin.neutral(self.model))
        closed = [closure.active for closure in scene.closures]
        self.initially_active: Active = (*closed, *(True for _ in scene.couplings))
        self.needs_matrix: bool = SCHEMES[self.scene.simulation.integrator].implicit
        self._authored, _ = authored_state(scene, self.tree)
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
        self._single = [self._choose([index]) for index in range(len(self.closures))]

    def __repr__(self) -> str:
        closures = ", ".join(closure.name for closure in self.closures) or "no closures"
        points = ", ".join(self.point_names)
        return f"Mechanism of {self.scene.name}: nv {self.nv}; {closures}; held at {points}"

    def row_units(self, indices: Sequence[int]) -> Array:
        """Return (m,) the divisors of closures' rows before they are factored.

        Their length ℓ in m or 1 in rad, times a power of 2 per closure, 1/(√kg m). Closures between
        heavy or light, long or short links then have singular values next to 1, and a small one
        means a singular position.

        Args:
            indices: of the closures.
        """
        units = [
            self.closures[index].row_lengths(self.length) * self._closure_sizes[0][index]
            for index in indices
        ]
        return np.concatenate([np.zeros(0), *units])

    def rounding(self, indices: Sequence[int]) -> float:
        """Return the σ below which all is rounding, of rows over their units, however large others.

        Args:
            indices: of the closures.
        """
        return float(self._closure_sizes[1][list(indices)].max(initial=RESOLVED))

    @cached_property
    def _closure_sizes(self) -> tuple[Array, Array]:
        """Return per closure the power of 2 next to its rows' size, and their rounding beside 1.

        Their size in the mass metric, |L⁻¹ (J_a − J_b)ᵀ| of points over the length, of axes, or of
        both, as the scene starts: 1 where D is singular there. Where both ends' parts nearly
        cancel, that is rounding, and may differ at other configurations: the size is then that of
        the largest other closure, or of one end's part.
        """
        scales, rounding = np.ones(len(self.closures)), np.zeros(len(self.closures))
        # Not the scratch data: this may be called in the middle of an evaluation.
        model, data = self.model, self.model.createData()
        upper = np.triu(pin.crba(model, data, self._authored).reshape(self.nv, self.nv))
        try:
            factor = np.linalg.cholesky(upper + np.triu(upper, 1).T)
        except np.linalg.LinAlgError:
            return scales, rounding
        pin.computeJointJacobians(model, data, self._authored)
        pin.updateFramePlacements(model, data)
        of_ends, lengths = np.zeros(len(self.closures)), np.repeat((self.length, 1.0), 3)[:, None]
        for index, loop in enumerate(self.closures):
            frames = (loop.frame_a, loop.frame_b)
            a, b = (
                pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED).reshape(
                    6, self.nv
                )
                for frame in frames
            )
            used = np.repeat((loop.point_rows > 0, loop.rows > loop.point_rows), 3)
            scales[index], *ends = (
                np.linalg.norm(np.linalg.solve(factor, rows.T))
                for rows in (((a - b) / lengths)[used], a / lengths, b / lengths)
            )
            of_ends[index] = max(ends)
            away = max(float(np.abs(data.oMf[frame].translation).max()) for frame in frames)
            rounding[index] = _ROUNDING * of_ends[index] * (1.0 + away / self.length)
        own = scales > NEAR * of_ends
        scales[~own] = scales[own].max(initial=0.0) or of_ends.max(initial=0.0) or 1.0
        scales = np.exp2(np.round(np.log2(scales)))
        return scales, rounding / scales

    def span(self, change: Array) -> float:
        """Return the largest component of a change, rad; translations over the length.

        Args:
            change: (nv,) rad or m.
        """
        return float(np.abs(change / self._rate_lengths).max(initial=0.0))

    @cached_property
    def _rate_lengths(self) -> Array:
        """Return (nv,) the length for rates in m/s, 1 for those in rad/s."""
        angular = [ANGULAR[kind] for kind in self.tree.joint_types]
        return self.length ** (1.0 - np.concatenate([np.zeros(0), *angular]))

    def rates_in(self, index: int) -> Array:
        """Return (nv,) which coordinates move closure ``index``: of the joints in its loop.

        Args:
            index: of the closure.
        """
        loop, model = self.closures[index], self.model
        joints = [int(model.frames[frame].parentJoint) for frame in (loop.frame_a, loop.frame_b)]
        if loop.kind != "coupling":
            a, b = (set(model.supports[joint]) for joint in joints)
            joints = sorted(a ^ b)
        rates = np.zeros(self.nv, dtype=bool)
        for joint in joints:
            if joint:
                rates[self.tree.velocity_slice(joint - 1)] = True
        return rates

    def local_rates(self, start: Array, q: Array, v: Array) -> Array:
        """Return θ̇ (nv,), rad/s or m/s, with q = start ⊕ θ: J_r(θ)⁻¹ v.

        Args:
            start: (nq,) configuration.
            q: (nq,) likewise.
            v: (nv,) rates at q, rad/s or m/s.
        """
        if self.nq == self.nv:
            return v
        return np.asarray(pin.dDifference(self.model, start, q, pin.ARG1) @ v)

    def set_operational_point(self, point: OperationalPoint) -> None:
        """Put the operational point of that name elsewhere; ``scene`` has it there from now on.

        Earlier terms are for the earlier place. The unit ``length`` does not change.
        """
        index = self.point_index(point.name)
        points = list(self.scene.operational_points)
        points[index] = point
        self.scene = self.scene.model_copy(update={"operational_points": tuple(points)})
        at = self._point_frames[index]
        frame = self.model.frames[at]
        frame.parentJoint, frame.placement = self.tree.place(point.link, point.origin)
        self._carriers[at] = frame.parentJoint
        self._all_placements[at] = _in_memory(frame.placement)
        for active_set in {*self._sets.values(), *self._single}:
            for model in (active_set.model, active_set.dense.model):
                place = model.points[index]
                model.carriers[place] = self._carriers[at]
                model.placements[place] = self._all_placements[at]

    def on_wrong_branch(self, index: int, q: Array) -> bool:
        """Return whether closure ``index`` has axes more than 90° apart at q.

        Args:
            index: of the closure.
            q: (nq,) configuration.
        """
        loop = self.closures[index]
        if loop.kind not in ("revolute", "weld"):
            return False
        pin.framesForwardKinematics(self.model, self.data, q)
        return loop.on_wrong_branch(self.data)

    def link_place(self, link: str) -> tuple[int, pin.SE3]:
        """Return the joint that carries a link, and the link's frame in it.

        Raises:
            InvalidInputError: no such link.
        """
        check_one_of("link", link, self.tree.link_joint)
        return self.tree.link_joint[link]

    def link_jacobian(self, q: Array, link: str) -> Array:
        """Return (6, nv) Jacobian of a link's frame at q, m and 1: world axes, at its origin.

        Args:
            q: (nq,) configuration.
            link: its name.

        Raises:
            InvalidInputError: no such link.
        """
        joint, placement = self.link_place(link)
        pin.computeJointJacobians(self.model, self.data, q)
        jacobian = pin.getJointJacobian(self.model, self.data, joint, pin.LOCAL_WORLD_ALIGNED)
        x, y, z = self.data.oMi[joint].rotation @ placement.translation
        jacobian[:3] -= np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0))) @ jacobian[3:]
        return np.asarray(jacobian)

    def frame_pose(self, q: Array, frame: str) -> pin.SE3:
        """Return the pose in ``world`` of a link, a point, or ``<point>_world`` (world's axes).

        Args:
            q: (nq,) configuration.
            frame: its name.

        Raises:
            InvalidInputError: no such frame.
        """
        pin.forwardKinematics(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        if frame in self.tree.link_joint:
            joint, placement = self.tree.link_joint[frame]
            return self.data.oMi[joint] * placement
        point = frame.removesuffix("_world")
        if point not in self.point_names:
            check_one_of("frame", frame, [*self.tree.link_joint, *self.point_names])
        pose = self.data.oMf[self._point_frames[self.point_names.index(point)]].copy()
        return pose if frame == point else pin.SE3(np.eye(3), pose.translation)

    def names_of(self, active: Active) -> list[str]:
        """Return the names of the active closures."""
        return [c.name for c, on in zip(self.closures, active, strict=True) if on]

    def integrate(self, q: Array, change: Array) -> Array:
        """Return q ⊕ change, (nq,), on the configuration manifold.

        Args:
            q: (nq,) configuration.
            change: (nv,) rad or m.
        """
        return np.asarray(pin.integrate(self.model, q, change))

    def coordinates(self, q: Array) -> Array:
        """Return (nv,) positions of all degrees of freedom, rad or m, from the neutral ones.

        Args:
            q: (nq,) configuration.
        """
        # Where q and v are as long as each other the neutral ones are zero.
        return q if self.nq == self.nv else self.difference(self._neutral, q)

    def configuration(self, coordinates: Array) -> Array:
        """Return q (nq,) of such positions.

        Args:
            coordinates: (nv,) rad or m.
        """
        return coordinates if self.nq == self.nv else self.integrate(self._neutral, coordinates)

    def difference(self, start: Array, end: Array) -> Array:
        """Return the change (nv,), rad or m, that leads from one configuration to another.

        Args:
            start: (nq,) configuration.
            end: (nq,) likewise.
        """
        return np.asarray(pin.difference(self.model, start, end))

    def energy(self, q: Array, v: Array) -> tuple[float, float]:
        """Return kinetic and potential energy, J; the latter with that of springs and stops.

        Args:
            q: (nq,) configuration.
            v: (nv,) rates.
        """
        # computeKineticEnergy of Pinocchio 4.1 leaves the rotors of some kinds of joints out.
        upper = np.triu(pin.crba(self.model, self.data, q).reshape(self.nv, self.nv))
        kinetic = v @ upper @ v - 0.5 * v**2 @ upper.diagonal()
        potential = float(pin.computePotentialEnergy(self.model, self.data, q))
        potential -= self.tree.carried_energy(self.data)
        if self.elements.springs:
            pin.updateFramePlacements(self.model, self.data)
        return float(kinetic), potential + self.elements.energy(self.data, q)

    def point_index(self, name: str = "") -> int:
        """Return the index of an operational point; the first one if ``name`` is empty.

        Raises:
            InvalidInputError: no such point.
        """
        return self.point_names.index(self.scene.operational_point(name).name)

    def joint_slices(self, name: str) -> tuple[slice, slice]:
        """Return where a moving joint is in q and in v.

        Raises:
            InvalidInputError: no such joint, or one that does not move.
        """
        check_one_of("joint", name, self.tree.joint_names)
        index = self.tree.joint_names.index(name)
        return self.tree.position_slice(index), self.tree.velocity_slice(index)

    def joint_index(self, name: str) -> int:
        """Return where a joint with one degree of freedom is in v, and in q if all others are such.

        Raises:
            InvalidInputError: no such joint, or one with several degrees of freedom.
        """
        _, in_v = self.joint_slices(name)
        if in_v.stop - in_v.start != 1:
            rule = "must have one degree of freedom; joint_slices has the places of others"
            raise InvalidInputError("joint", name, rule)
        return int(in_v.start)

    def closure_index(self, name: str) -> int:
        """Return the index of a closure.

        Raises:
            InvalidInputError: no such closure.
        """
        names = [closure.name for closure in self.closures]
        check_one_of("closure", name, names)
        return names.index(name)

    def check_state(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return copies of q (nq,) and v (nv,) after checking sizes and finiteness.

        Args:
            q: (nq,) configuration.
            v: (nv,) rates.

        Raises:
            InvalidInputError: wrong size, NaN or infinity.
        """
        checked = []
        for what, value, size in (("q", q, self.nq), ("v", v, self.nv)):
            array = np.array(value, dtype=float)
            if array.shape != (size,) or not np.isfinite(array).all():
                raise InvalidInputError(what, value, f"must be {size} finite numbers")
            checked.append(array)
        return checked[0], checked[1]

    def evaluate(
        self, q: Array, v: Array, active: Active, closing: Closing | None = None
    ) -> Evaluation:
        """Return every term of Eq. 1 at a state, with the given closures active.

        Args:
            q: (nq,) configuration.
            v: (nv,) rates, rad/s or m/s.
            active: which closures are closed.
            closing: result of :meth:`closing_terms` at the same q and closures, to save time.

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
        move_frames(active_set.model, closing.parts, *state, terms, self._point_places)
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
        """Return φ, W and the factorisation at q, for projections.

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
        """Return the constants of a set of closures; computed once."""
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
        model, elements, shortest = self.model, self.elements.joints, self.elements.shortest
        ends = [(place[s.frame_a], place[s.frame_b]) for s in springs]
        pulls = [(s.stiffness, s.damping, s.rest_length, shortest) for s in springs]
        sizes = {"nq": self.nq, "nv": self.nv, "m": int(rows[-1]), "path": DENSE}
        parts = {
            "carriers": self._carriers[frames],
            "joints": np.array([self._joint_numbers(i) for i in range(model.njoints)]),
            "closures": np.array(closures).reshape(-1, 4),
            "points": np.array([place[frame] for frame in self._point_frames]),
            "elements": np.array([(e.rate, e.position) for e in elements]).reshape(-1, 2),
            "springs": np.array(ends).reshape(-1, 2),
            "order": np.zeros(0),
            "sequence": np.zeros((0, 5)),
            "damping": self.tree.damping,
            "lengths": np.concatenate(lengths),
            "units": self.row_units(indices),
            "rounding": np.array([self.rounding(indices)]),
            "placements": self._all_placements[frames].reshape(-1, 12),
            "effort": self.elements.effort,
            "element_values": np.array([_joint_values(e.joint) for e in elements]).reshape(-1, 9),
            "spring_values": np.array(pulls).reshape(-1, 4),
            "joint_values": self._joint_rows,
            "gravity": model.gravity.linear,
        }
        scheme = SCHEMES[self.scene.simulation.integrator]
        kept = len(scheme.weights) if scheme.implicit or scheme.history else 0
        sizes |= {"implicit": int(scheme.implicit), "stages": kept}
        return ActiveSet({**sizes, "width": 0, "border": 0, "independent": -1}, parts)

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
