# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scene's tree, closures, elements and operational points in Pinocchio's model.

D(q) v̇ + h(q, v) = τ + Σ Jᵀ F - Wᵀ λ,      W v̇ + Ẇ v = 0

where τ is what springs, dampers, friction, stops and efforts do (see :mod:`elements`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.closures import (
    WORLD_AXES,
    Active,
    LoopClosure,
    bind_closure,
    bind_coupling,
)
from hapticmech_ros.mechanism.elements import Elements, bind_spring
from hapticmech_ros.mechanism.inertia import ANGULAR, refuse_massless
from hapticmech_ros.mechanism.model import TreeModel, authored_state, build_tree
from hapticmech_ros.mechanism.stiffness import chosen_integrator
from hapticmech_ros.mechanism.tolerances import NEAR, RESOLVED
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import OperationalPoint

# Rounding of a closure's row, of what its ends do: some units of the last place.
_ROUNDING = 16.0 * np.finfo(float).eps


class MultibodyModel:
    """Names, frames, configurations and energies of a mechanism; no dynamics.

    Args:
        scene: what to model.

    Attributes:
        scene: what is modelled, with the integrator that ``auto`` stands for.
        nv: number of degrees of freedom of the open tree.
        nq: length of the configuration vector.
        length: characteristic length, m; the unit of closures' point rows.
        elements: springs, dampers, friction, stops and efforts.
        initially_active: which closures are closed as the scene starts; couplings always.
    """

    def __init__(self, scene: Scene) -> None:
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

    def __repr__(self) -> str:
        closures = ", ".join(closure.name for closure in self.closures) or "no closures"
        points, kind = ", ".join(self.point_names), type(self).__name__
        return f"{kind} of {self.scene.name}: nv {self.nv}; {closures}; held at {points}"

    def row_units(self, indices: Sequence[int]) -> Array:
        """Return (m,) what rows of closures are divided by before they are factored.

        Their length ℓ in m or 1 in rad, times a power of 2 per closure, 1/(√kg m), so that closures
        between heavy links and between light ones, long ones and short ones, have singular values
        next to 1: one that is small then means a singular position.

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
        both, as the scene starts: 1 where D is singular there. Where next to nothing is left of
        what both ends do, it is rounding, or may be anything elsewhere: the size is then that of
        the largest other closure, or of what one end does.
        """
        scales, rounding = np.ones(len(self.closures)), np.zeros(len(self.closures))
        q, _ = authored_state(self.scene, self.tree)
        # Not the scratch data: this may be asked for in the middle of an evaluation.
        model, data = self.model, self.model.createData()
        upper = np.triu(pin.crba(model, data, q).reshape(self.nv, self.nv))
        try:
            factor = np.linalg.cholesky(upper + np.triu(upper, 1).T)
        except np.linalg.LinAlgError:
            return scales, rounding
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        of_ends, lengths = np.zeros(len(self.closures)), np.repeat((self.length, 1.0), 3)[:, None]
        for index, loop in enumerate(self.closures):
            frames = (loop.frame_a, loop.frame_b)
            a, b = (
                pin.getFrameJacobian(model, data, frame, WORLD_AXES).reshape(6, self.nv)
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

        Terms evaluated before are of the place before. The unit ``length`` stays what it was.
        """
        index = self.point_index(point.name)
        points = list(self.scene.operational_points)
        points[index] = point
        self.scene = self.scene.model_copy(update={"operational_points": tuple(points)})
        frame = self.model.frames[self._point_frames[index]]
        frame.parentJoint, frame.placement = self.tree.place(point.link, point.origin)

    def on_wrong_branch(self, index: int, q: Array) -> bool:
        """Return whether closure ``index`` has axes more than 90° apart at q.

        Args:
            index: of the closure.
            q: (nq,) configuration.
        """
        loop = self.closures[index]
        if not loop.has_axes:
            return False
        pin.framesForwardKinematics(self.model, self.data, q)
        return loop.on_wrong_branch(self.data)

    def link_place(self, link: str) -> tuple[int, pin.SE3]:
        """Return the joint that carries a link, and the link's frame in it.

        Raises:
            InvalidInputError: no such link.
        """
        if link not in self.tree.link_joint:
            raise InvalidInputError("link", link, f"must be one of {list(self.tree.link_joint)}")
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
        jacobian = pin.getJointJacobian(self.model, self.data, joint, WORLD_AXES)
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
            known = [*self.tree.link_joint, *self.point_names]
            raise InvalidInputError("frame", frame, f"must be one of {known}")
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
        names = self.tree.joint_names
        if name not in names:
            raise InvalidInputError("joint", name, f"must be one of {list(names)}")
        index = names.index(name)
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
        if name not in names:
            raise InvalidInputError("closure", name, f"must be one of {names}")
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
