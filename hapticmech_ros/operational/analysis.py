# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Analysis of a mechanism at an operational point: all that rendering needs of it.

Metric of the task space: the inertia that makes directions of different units comparable.

The spatial inertia I_ℓ of the grasped link alone, at the operational point and in world axes, makes
μ = eig(I_ℓ^½ X I_ℓ^½) a number between 0 (rigid) and 1 (as free as the link alone) that depends
neither on units nor on axes. A link that moves in a plane is held in it: the rows and columns of
I_ℓ in the plane remain. A link that is held by a ball joint turns about it: ((I_ℓ⁻¹)_tt)⁻¹ remains,
with t the rows of positions.

F_c at the operational points of a mechanism, from forces that act on it elsewhere. These are its
contacts', and the other hands' where there are several; see :mod:`.observe_kernels`.

Response of an operational point to another hand's wrench.

F_j, by the hand at point j, accelerates point i by X_ij F_j: part of the F_c of point i, which its
device renders as it renders a contact. The last F_j that the mechanism knows answers a sample taken
a period ago; the device adds the change since, see :mod:`~hapticmech_ros.control.other_hands`.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import Closing, Evaluation, failure
from hapticmech_ros.mechanism.kernels.band_kernels import NOT_DECIDED
from hapticmech_ros.mechanism.kernels.layout import ActiveSet
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.model import se3
from hapticmech_ros.numerics import Array
from hapticmech_ros.operational.observation import Observation
from hapticmech_ros.operational.observe_kernels import (
    NO_SPECTRUM,
    consistent_wrench,
    observation_size,
    observe_point,
)
from hapticmech_ros.operational.results import CompensatedResponse, OperationalAnalysis
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import OperationalPoint
from hapticmech_ros.scene.rules import inertia_matrix


def coupling(terms: Evaluation) -> Array:
    """Return X (points, points, 6, 6), the inverse inertia of all operational points together.

    X_ij = J_i L⁻ᵀ (1 - U Uᵀ) L⁻¹ J_jᵀ: a wrench F_j at point j accelerates point i by X_ij F_j,
    with loops closed. X_ii is Λ_h⁻¹ of point i, and X_ji = X_ijᵀ.

    Args:
        terms: of the mechanism at a state.

    Returns:
        1/kg, 1/(kg m) and 1/(kg m²); force before torque, world axes at each point.
    """
    space, n = terms.space, len(terms.points)
    columns = np.hstack([point.jacobian.T for point in terms.points])
    free = space.without_closure_part(space.to_mass_metric(columns))
    whole = free.T @ free
    return np.ascontiguousarray(whole.reshape(n, 6, n, 6).transpose(0, 2, 1, 3))


def by_others(terms: Evaluation, wrenches: Array) -> Array:
    """Return joint forces (points, nv), N m or N: for each point, of the wrenches at all others.

    Row i is the sum of J_jᵀ F_j over all j ≠ i. The point's acceleration by it is the sum of
    X_ij F_j, with X_ij of :func:`coupling`.

    Args:
        terms: of the mechanism at a state.
        wrenches: (points, 6) F_j, on the mechanism, N and N m, world axes at each point.
    """
    forces = np.array([p.jacobian.T @ f for p, f in zip(terms.points, wrenches, strict=True)])
    return np.asarray(forces.sum(axis=0) - forces)


def transmission(found: OperationalAnalysis, coupled: Array) -> Array:
    """Return Y_ij (6, 6): a wrench F_j at point j is felt at point i as F_c = Y_ij F_j.

    Y_ij = Σ_k (1 - w_k) n_k n_kᵀ X_ij / s_k², the sum over the directions of point i (T18), so that
    X_ii Y_ij = X_ij along all that the joints do not constrain there.

    Args:
        found: analysis of point i.
        coupled: (6, 6) X_ij, see :func:`coupling`; 1/kg, 1/(kg m) and 1/(kg m²), world axes.

    Returns:
        1, m and 1/m; force before torque, world axes at each point.
    """
    rows, felt = found.rows, found.weights < 1.0
    wrenches = found.spectrum.wrenches[:, felt]
    shares = (1.0 - found.weights[felt]) / found.spectrum.s[felt] ** 2
    whole = np.zeros((6, 6))
    whole[rows] = wrenches @ (shares[:, None] * (wrenches.T @ coupled[rows]))
    return whole


def contact_wrench(analyser: Analyser, terms: Evaluation, joint_force: Array) -> Array:
    """Return F_c (6,): by the environment on the mechanism, at the point, world axes, N and N m.

    Args:
        analyser: of the point.
        terms: of the mechanism at a state.
        joint_force: (nv,) Σ J_cᵀ λ, N m or N.
    """
    seen, closing, wrench = analyser.observe_terms(terms), terms.closing, np.zeros(6)
    consistent_wrench(
        closing.active_set.model,
        closing.parts,
        seen.numbers,
        analyser.rows,
        np.array(joint_force, dtype=float),
        wrench,
    )
    return wrench


class ContactWrenches:
    """Converts forces elsewhere on a mechanism to a wrench at each of its operational points.

    Args:
        mechanism: whose.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._analysers = [Analyser(mechanism, name) for name in mechanism.point_names]

    def at(self, terms: Evaluation, joint_forces: Array) -> Array:
        """Return F_c (points, 6), on the mechanism, N and N m, world axes at each point.

        Args:
            terms: of the mechanism at a state.
            joint_forces: (points, nv), N m or N: to be felt at each point, such as the sum of J_cᵀ
                λ of the contacts.
        """
        found = np.zeros((len(self._analysers), 6))
        for index, (analyser, force) in enumerate(zip(self._analysers, joint_forces, strict=True)):
            if force.any():
                found[index] = contact_wrench(analyser, terms, force)
        return found


class TaskMetric:
    """I_ℓ of one operational point; constant in the axes of the link, so factored once.

    Attributes:
        rows: (t,) rows of a six-vector that the task space has.
        mass: reference mass m_ℓ in kg: of the link, or of the point's ``metric``.
        factor, dual_factor: (t, t) G and G⁻ᵀ in the axes of the link; √kg and √kg m, and their
            inverses.
        point_to_link: (3, 3) maps components in the link's axes to those in the point's.
    """

    def __init__(self, scene: Scene, point: OperationalPoint) -> None:
        inertia = _inertia_at_point(scene, point)
        self.mass = float(inertia[0, 0])
        self.rows = np.array(scene.task_rows)
        moving = scene.moving_rows
        inertia = inertia[np.ix_(moving, moving)]
        if self.rows.size < len(moving):
            held = np.isin(moving, self.rows)
            inertia = np.linalg.inv(np.linalg.inv(inertia)[np.ix_(held, held)])
        self.factor = np.linalg.cholesky(inertia)
        self.dual_factor = np.linalg.inv(self.factor).T
        self.point_to_link = se3(point.origin).rotation.T


def _inertia_at_point(scene: Scene, point: OperationalPoint) -> Array:
    """Return I_ℓ (6, 6) at the point, in the axes of its link."""
    if point.metric is not None:
        mass, length = point.metric.mass, point.metric.length
        return np.diag([mass] * 3 + [mass * length**2] * 3)
    inertial = next(link.inertial for link in scene.links if link.name == point.link)
    body = pin.Inertia(inertial.mass, np.array(inertial.com), inertia_matrix(inertial.inertia))
    at_point = pin.SE3(np.eye(3), np.array(point.origin.xyz))
    return np.asarray(body.se3ActionInverse(at_point).matrix())


class Analyser:
    """Analyses one operational point of a mechanism.

    Args:
        mechanism: whose.
        point: operational point; the first one if empty.
        compensated_delay: τ, s, that :meth:`compensated` and :meth:`observe` compensate for.

    Attributes:
        point: operational point.
        index: of it in the scene's order.
        rows: (t,) rows of a six-vector that the task space has.
        metric: of the task space there.
        constants: of the analysis, see
            :func:`~hapticmech_ros.operational.observe_kernels.metric_of`.
        observation_size: numbers of an observation.

    Raises:
        InvalidInputError: unknown point.
    """

    def __init__(
        self, mechanism: Mechanism, point: str = "", compensated_delay: float = 0.0
    ) -> None:
        scene = mechanism.scene
        self.compensated_delay = compensated_delay
        self.mechanism = mechanism
        self.point = scene.operational_point(point)
        self.index = mechanism.point_index(point)
        self.metric = metric = TaskMetric(scene, self.point)
        self.rows = metric.rows
        limits = metric.mass, float(scene.perception.s_on), float(scene.perception.s_off)
        parts = (metric.point_to_link, metric.factor, metric.dual_factor)
        self.constants = np.concatenate([limits, *(part.ravel() for part in parts)])
        self.observation_size = observation_size(self.rows.size, mechanism.nv)
        self._ahead = np.empty(0)
        self._position, self._rates = np.empty(mechanism.nq), np.empty(mechanism.nv)
        self._unknown = np.zeros(1 + mechanism.nv)

    def observe(
        self,
        q: Array,
        v: Array,
        active: Active,
        closing: Closing | None = None,
        before: Array | None = None,
    ) -> Observation:
        """Return Eq. 1's terms at the point at a state, and the analysis there.

        Args:
            q: (nq,) configuration.
            v: (nv,) rates, rad/s or m/s.
            active: which closures are closed.
            closing: result of ``Mechanism.closing_terms`` at the same q and closures, to save time.
            before: (1 + nv,) a time ago, s, and the rates then, rad/s or m/s; see
                :mod:`.observe_kernels`.

        Raises:
            HapticMechError: D is not positive definite, or an SVD did not converge.
        """
        if closing is not None:
            return self._observe(
                q, v, closing.active_set, closing.packed, 1, self.compensated_delay, before
            )
        found = self.mechanism.active_set(active)
        return self._observe(q, v, found, found.scratch, 0, self.compensated_delay, before)

    def analyse(self, terms: Evaluation) -> OperationalAnalysis:
        """Return the analysis of the point from the terms of Eq. 1 at a state.

        Raises:
            HapticMechError: as :meth:`observe`.
        """
        return self.observe_terms(terms).analysis

    def compensated(self, terms: Evaluation, before: Array | None = None) -> CompensatedResponse:
        """Return X_τ and a_τ for a loop with delay τ; see :mod:`.observe_kernels`.

        Args:
            terms: of Eq. 1 at a state.
            before: (1 + nv,) as of :meth:`observe`.

        Raises:
            HapticMechError: as :meth:`observe`.
        """
        return self.observe_terms(terms, self.compensated_delay, before).compensated

    def observe_terms(
        self, terms: Evaluation, compensated_delay: float = 0.0, before: Array | None = None
    ) -> Observation:
        """Return the same as :meth:`observe`, from terms at a state.

        Args:
            terms: of Eq. 1.
            compensated_delay: τ, s.
            before: (1 + nv,) as of :meth:`observe`.

        Raises:
            HapticMechError: as :meth:`observe`.
        """
        known, v = terms.closing, terms.v
        return self._observe(
            known.q, v, known.active_set, known.packed, 1, compensated_delay, before
        )

    def _observe(
        self,
        q: Array,
        v: Array,
        active_set: ActiveSet,
        packed: Array,
        known: int,
        compensated_delay: float,
        before: Array | None,
    ) -> Observation:
        mechanism, found = self.mechanism, np.empty(self.observation_size)
        self._position[:] = q
        self._rates[:] = v
        if self._ahead.size != active_set.size:
            self._ahead = np.empty(active_set.size)
        code = observe_point(
            *active_set.constants,
            packed,
            known,
            self._position,
            self._rates,
            self.index,
            self.constants,
            self.rows,
            mechanism.length,
            compensated_delay,
            self._unknown if before is None else before,
            self._ahead,
            found,
        )
        if code == NOT_DECIDED:
            dense = active_set.dense
            return self._observe(q, v, dense, dense.scratch, 0, compensated_delay, before)
        if code == NO_SPECTRUM:
            raise HapticMechError("SVD of S did not converge")
        if code:
            raise failure(code, mechanism.tree)
        return Observation(found, self.rows, mechanism.nv)


def analyse(
    mechanism: Mechanism,
    q: Array,
    point: str = "",
    v: Array | None = None,
    active: Active | None = None,
) -> OperationalAnalysis:
    """Return Λ_h⁻¹ and its spectrum at configuration q and the named operational point.

    Args:
        mechanism: to analyse.
        q: (nq,) configuration; closures are taken as met there.
        point: name of an operational point; the scene's first one if empty.
        v: (nv,) rates, rad/s or m/s; at rest if left out. Only a_0 depends on them.
        active: which closures are closed; as the scene starts if left out.

    Raises:
        InvalidInputError: unknown point, wrong size, NaN.
        HapticMechError: as :meth:`Analyser.observe`.
    """
    q, v = mechanism.check_state(q, np.zeros(mechanism.nv) if v is None else v)
    terms = mechanism.evaluate(q, v, mechanism.initially_active if active is None else active)
    return Analyser(mechanism, point).analyse(terms)
