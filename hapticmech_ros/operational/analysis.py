"""Everything that rendering needs to know of a mechanism at an operational point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hapticmech_ros.layout import OPERATIONAL_MODEL
from hapticmech_ros.mechanism.evaluation import Active, Evaluation
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.operational.inverse_inertia import (
    PLANAR_ROWS,
    SPATIAL_ROWS,
    embed,
    inverse_inertia,
    root,
)
from hapticmech_ros.operational.late_answer import LateAnswer, late_answer
from hapticmech_ros.operational.metric import TaskMetric
from hapticmech_ros.operational.projector import balanced_share, constraint_projector, rigidity
from hapticmech_ros.operational.spectrum import Spectrum, spectrum
from hapticmech_ros.quaternions import quaternion_of

if TYPE_CHECKING:
    from hapticmech_ros.operational.compiled import CompiledAnalysis

_SEEN = OPERATIONAL_MODEL.slice("s", "twist")
_SQUARES = OPERATIONAL_MODEL.slice("inverse_inertia", "balanced_share")
_FREE = OPERATIONAL_MODEL.slice("free_acceleration")


@dataclass(frozen=True, slots=True)
class OperationalAnalysis:
    """Λ_h⁻¹ and what follows from it; world axes, origin at the operational point, force first.

    Attributes:
        inverse_inertia: (6, 6) X; zero in rows a planar scene does not have.
        spectrum: s, μ, rank and directions, on the task's rows only.
        weights: (t,) rigidity w(s_i).
        constraint_projector: (6, 6) P_c.
        balanced_share: (6, 6) Π.
        free_acceleration: (6,) a_0, acceleration of the point with no wrench on it; m/s², rad/s².
        rows: (t,) rows of a six-vector that the task space has.
    """

    inverse_inertia: Array
    spectrum: Spectrum
    weights: Array
    constraint_projector: Array
    balanced_share: Array
    free_acceleration: Array
    rows: Array

    @property
    def rank(self) -> int:
        """Rank of X."""
        return self.spectrum.rank

    @property
    def constraint_wrenches(self) -> Array:
        """Return N_c (6, k): wrenches at the hand that the joints balance entirely."""
        full = np.zeros((6, self.spectrum.s.size - self.rank))
        full[self.rows] = self.spectrum.constraint_wrenches
        return full


class Analyser:
    """Analyses one operational point of a mechanism.

    Args:
        mechanism: whose.
        point: operational point; the first one if empty.
        lateness: τ, s, of the loop that :meth:`late` and :meth:`see` answer for; 0 for none.

    Raises:
        InvalidInputError: unknown point.
    """

    def __init__(self, mechanism: Mechanism, point: str = "", lateness: float = 0.0) -> None:
        scene = mechanism.scene
        self.lateness = lateness
        self.mechanism = mechanism
        self.point = scene.operational_point(point)
        self.index = mechanism.point_index(point)
        self.rows = PLANAR_ROWS if scene.task_space == "planar" else SPATIAL_ROWS
        self.metric = TaskMetric(scene, self.point)
        self._compiled = self._load() if mechanism.compiled else None

    def analyse(self, terms: Evaluation) -> OperationalAnalysis:
        """Analyse the point from the terms of Eq. 1 at a state."""
        if self._compiled is not None and self._compiled.understands(terms):
            return self._by_kernel(self._compiled, terms)
        point = terms.points[self.index]
        jacobian = point.jacobian if self.rows.size == 6 else point.jacobian[self.rows]
        perception = self.mechanism.scene.perception
        root_matrix = root(terms.space, jacobian)
        found = spectrum(root_matrix, *self.metric.factors(point.pose.rotation))
        weights = rigidity(found.s, perception.s_on, perception.s_off)
        free_rates, _ = terms.acceleration(np.zeros(self.mechanism.nv))
        return OperationalAnalysis(
            inverse_inertia=embed(inverse_inertia(root_matrix)),
            spectrum=found,
            weights=weights,
            constraint_projector=embed(constraint_projector(found, weights, self.metric.mass)),
            balanced_share=embed(balanced_share(found, weights)),
            free_acceleration=point.jacobian @ free_rates + point.drift,
            rows=self.rows,
        )

    def late(
        self, terms: Evaluation, q: Array, v: Array, active: Active, found: OperationalAnalysis
    ) -> LateAnswer:
        """Return X and a_0 as a loop late by τ needs them; see :mod:`.late_answer`.

        Args:
            terms: of Eq. 1 at the state.
            q: (nq,) configuration.
            v: (nv,) rates.
            active: which closures are closed.
            found: the analysis there.
        """
        free, spectrum = found.free_acceleration, found.spectrum
        if self.lateness == 0.0:
            return LateAnswer(found.inverse_inertia, free)
        if self._compiled is not None and self._compiled.understands(terms):
            directions = (found.weights, spectrum.wrenches.ravel(), spectrum.duals.ravel())
            details = np.concatenate(directions)
            late = self._compiled.late(terms, q, v, spectrum.s, details, free, self.lateness)
            return LateAnswer(late[:36].reshape(6, 6), late[36:])
        place = self.mechanism, terms, q, v, active, self.index, self.rows
        return late_answer(*place, spectrum, free, self.lateness)

    def see(
        self, q: Array, v: Array, active: Active, seen: Array, wrenches: Array | None = None
    ) -> None:
        """Fill an array with what a controller needs of the point at a state.

        Args:
            q: (nq,) configuration.
            v: (nv,) rates.
            active: which closures are closed.
            seen: an :data:`~hapticmech_ros.layout.OPERATIONAL_MODEL` to fill up to the point's
                twist, (133,) or more: zero in rows that the task space does not have. X and a_0
                are those of :meth:`late`.
            wrenches: (t, t) to fill with the columns n_i, in the order of s; or None.

        Raises:
            HapticMechError: D is not positive definite, or an SVD did not converge.
        """
        if self._compiled is not None:
            self._compiled.see(q, v, active, seen, self.lateness)
            if wrenches is not None:
                wrenches[:] = self._compiled.wrenches
            return
        terms = self.mechanism.evaluate(q, v, active)
        found = self.analyse(terms)
        point = terms.points[self.index]
        s = np.zeros(6)
        s[: found.spectrum.s.size] = found.spectrum.s
        inverse_inertia, free = self.late(terms, q, v, active, found)
        squares = (inverse_inertia, found.constraint_projector, found.balanced_share)
        quaternion = quaternion_of(point.pose.rotation)
        place = (free, point.pose.translation, quaternion, point.twist)
        seen[_SEEN] = np.concatenate((s, *(square.ravel() for square in squares), *place))
        if wrenches is not None:
            wrenches[:] = found.spectrum.wrenches

    def _load(self) -> CompiledAnalysis:
        # Here, so that only a compiled mechanism waits for Numba.
        from hapticmech_ros.operational.compiled import CompiledAnalysis

        perception = self.mechanism.scene.perception
        return CompiledAnalysis(self.mechanism, self.index, self.rows, self.metric, perception)

    def _by_kernel(self, kernel: CompiledAnalysis, terms: Evaluation) -> OperationalAnalysis:
        analysis, details = kernel(terms)
        t = self.rows.size
        wrenches, duals = details[t:].reshape(2, t, t)
        x, projector, share = analysis[_SQUARES].reshape(3, 6, 6)
        found = Spectrum(analysis[:t], wrenches, duals)
        acceleration = analysis[_FREE]
        return OperationalAnalysis(x, found, details[:t], projector, share, acceleration, self.rows)


def analyse(
    mechanism: Mechanism,
    q: Array,
    point: str = "",
    v: Array | None = None,
    active: Active | None = None,
) -> OperationalAnalysis:
    """Return Λ_h⁻¹ and its spectrum at configuration q and the named operational point.

    Args:
        mechanism: from :func:`Mechanism`.
        q: (nq,) configuration; closures are taken as met there.
        point: name of an operational point; the scene's first one if empty.
        v: (nv,) rates; at rest if left out. Only the free acceleration depends on them.
        active: which closures are closed; as the scene starts if left out.

    Raises:
        InvalidInputError: unknown point, wrong size, NaN.
    """
    q, v = mechanism.check_state(q, np.zeros(mechanism.nv) if v is None else v)
    terms = mechanism.evaluate(q, v, mechanism.initially_active if active is None else active)
    return Analyser(mechanism, point).analyse(terms)
