"""Eq. 1 evaluated at a state: D, h, J, W and what follows from them.

D(q) v̇ + h(q, v) = τ + Σ Jᵀ F - Wᵀ λ,      W v̇ + Ẇ v = 0

where τ is what springs, dampers, friction, stops and efforts do (see :mod:`elements`).
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.closures import (
    WORLD_AXES,
    LoopClosure,
    bind_closure,
    bind_coupling,
)
from hapticmech_ros.mechanism.constraint_space import (
    SingularInertiaError,
    cholesky_of_upper,
    constraint_space,
    refuse_massless,
    singular_joint,
)
from hapticmech_ros.mechanism.elements import Elements, bind_spring
from hapticmech_ros.mechanism.evaluation import Active, Closing, Evaluation, PointKinematics
from hapticmech_ros.mechanism.model import Array, TreeModel, build_tree
from hapticmech_ros.scene.document import Scene
from hapticmech_ros.scene.mechanism import OperationalPoint

_NOTHING = np.zeros(0)


class Mechanism:
    """A scene's tree, closures and operational points, evaluated at states.

    The only mutable part is Pinocchio's scratch data; every result is a copy.

    Attributes:
        nv: number of degrees of freedom of the open tree.
        nq: length of the configuration vector.
        length: characteristic length, m; the unit of closures' point rows.
        elements: springs, dampers, friction, stops and efforts.
        compiled: whether kernels compute the terms.
    """

    compiled: ClassVar[bool] = False

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
        self._zero = np.zeros(self.model.nv)
        self._neutral: Array = np.asarray(pin.neutral(self.model))
        self._choices: dict[Active, tuple[list[LoopClosure], Array]] = {}
        closed = [closure.active for closure in scene.closures]
        self.initially_active: Active = (*closed, *(True for _ in scene.couplings))

    def grasp(self, point: OperationalPoint) -> None:
        """Put the operational point of that name elsewhere; ``scene`` has it there from now on.

        Terms evaluated before are of the place before. The unit ``length`` stays what it was.
        """
        index = self.point_index(point.name)
        points = list(self.scene.operational_points)
        points[index] = point
        self.scene = self.scene.model_copy(update={"operational_points": tuple(points)})
        frame = self.model.frames[self._point_frames[index]]
        frame.parentJoint, frame.placement = self.tree.place(point.link, point.origin)

    def evaluate(
        self, q: Array, v: Array, active: Active, closing: Closing | None = None
    ) -> Evaluation:
        """Evaluate every term of Eq. 1 at (q, v) with the given closures active.

        Args:
            q: (nq,) configuration.
            v: (nv,) rates.
            active: which closures are closed.
            closing: what :meth:`closing_terms` gave at the same q and closures, to save time.

        Raises:
            SingularInertiaError: D is not positive definite.
        """
        if closing is None:
            closing = self.closing_terms(q, active)
        model, data = self.model, self.data
        pin.computeAllTerms(model, data, q, v)
        # Once more, for accelerations at v̇ = 0 that do not contain gravity.
        pin.forwardKinematics(model, data, q, v, self._zero)
        pin.updateFramePlacements(model, data)
        passive, dissipative = self.elements.forces(model, data, q, v)
        return Evaluation(
            bias_force=data.nle.copy(),
            passive_force=passive,
            dissipative_force=dissipative,
            effort=self.elements.effort,
            closure_bias=self._closure_bias(active),
            closing=closing,
            points=tuple(self._point(frame, v) for frame in self._point_frames),
            v=v,
        )

    def closing_terms(self, q: Array, active: Active) -> Closing:
        """Return φ, W and the factorisation at q: what projections need.

        Raises:
            SingularInertiaError: D is not positive definite at q.
        """
        model, data = self.model, self.data
        try:
            factor = cholesky_of_upper(pin.crba(model, data, q).reshape(self.nv, self.nv))
        except SingularInertiaError as error:
            raise singular_joint(self.tree, error.rate) from None
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        loops, lengths = self._chosen(active)
        if len(loops) == 1:
            residual, jacobian = loops[0].residual(model, data), loops[0].jacobian(model, data)
        elif loops:
            residual = np.concatenate([loop.residual(model, data) for loop in loops])
            jacobian = np.vstack([loop.jacobian(model, data) for loop in loops])
        else:
            residual, jacobian = _NOTHING, np.zeros((0, self.nv))
        space = constraint_space(factor, jacobian, lengths, residual)
        return Closing(residual, jacobian, space)

    def slopes(self, q: Array, v: Array, horizon: float) -> tuple[Array, Array]:
        """Return how passive forces resist change: stiffness and damping, each (nv, nv).

        Symmetric, positive semi-definite approximations of -∂τ/∂q and -∂τ/∂v. Friction counts with
        its secant, a stop if it is met or will be within ``horizon`` (s) at the present speed, and
        springs between points as if their direction stayed.
        """
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        return self.elements.slopes(self.model, self.data, q, v, horizon)

    def distance_of(self, index: int, q: Array, v: Array) -> tuple[float, float]:
        """Return |φ| of closure ``index``, active or not, and the rate at which it grows."""
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        residual = self.closures[index].residual(self.model, self.data)
        distance = float(np.sqrt(residual @ residual))
        rate = residual @ (self.closures[index].jacobian(self.model, self.data) @ v)
        return distance, float(rate) / distance if distance > 0.0 else 0.0

    def on_wrong_branch(self, index: int, q: Array) -> bool:
        """Return whether closure ``index`` has axes more than 90° apart at q."""
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
        """Return (6, nv) Jacobian of a link's frame at q: world axes, at the frame's origin.

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
        """Return q ⊕ change on the configuration manifold."""
        return np.asarray(pin.integrate(self.model, q, change))

    def coordinates(self, q: Array) -> Array:
        """Return (nv,) positions of all degrees of freedom as seen from the neutral ones."""
        # Where q and v are as long as each other the neutral ones are zero.
        return q if self.nq == self.nv else self.difference(self._neutral, q)

    def configuration(self, coordinates: Array) -> Array:
        """Return q (nq,) of such positions."""
        return coordinates if self.nq == self.nv else self.integrate(self._neutral, coordinates)

    def difference(self, start: Array, end: Array) -> Array:
        """Return the change (nv,) that leads from one configuration (nq,) to another."""
        return np.asarray(pin.difference(self.model, start, end))

    def energy(self, q: Array, v: Array) -> tuple[float, float]:
        """Return kinetic and potential energy, J; the latter with that of springs and stops."""
        kinetic = pin.computeKineticEnergy(self.model, self.data, q, v)
        potential = float(pin.computePotentialEnergy(self.model, self.data, q))
        if self.elements.springs:
            pin.updateFramePlacements(self.model, self.data)
        return float(kinetic), potential + self.elements.energy(self.data, q)

    def point_index(self, name: str = "") -> int:
        """Return the index of an operational point; the first one if ``name`` is empty.

        Raises:
            InvalidInputError: no such point.
        """
        return self.point_names.index(self.scene.operational_point(name).name)

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
        """Return copies of (q, v) after checking sizes and finiteness.

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

    def _point(self, frame: int, v: Array) -> PointKinematics:
        model, data = self.model, self.data
        jacobian = pin.getFrameJacobian(model, data, frame, WORLD_AXES).reshape(6, self.nv)
        drift = pin.getFrameClassicalAcceleration(model, data, frame, WORLD_AXES).vector
        return PointKinematics(data.oMf[frame].copy(), jacobian, jacobian @ v, drift)

    def _closure_bias(self, active: Active) -> Array:
        loops, _ = self._chosen(active)
        if len(loops) == 1:
            return loops[0].bias(self.model, self.data)
        if not loops:
            return _NOTHING
        return np.concatenate([loop.bias(self.model, self.data) for loop in loops])

    def _chosen(self, active: Active) -> tuple[list[LoopClosure], Array]:
        """Return the active closures and their row units; found once per set of closures."""
        if active not in self._choices:
            loops = [loop for loop, on in zip(self.closures, active, strict=True) if on]
            lengths = [loop.row_lengths(self.length) for loop in loops]
            self._choices[active] = (loops, np.concatenate(lengths) if lengths else _NOTHING)
        return self._choices[active]
