"""Everything that rendering needs to know of a mechanism at an operational point."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import Closing
from hapticmech_ros.mechanism.evaluation import Evaluation
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.operational.inverse_inertia import (
    PLANAR_ROWS,
    SPATIAL_ROWS,
    embed,
    inverse_inertia,
    root,
)
from hapticmech_ros.operational.late_answer import LateAnswer, late_answer
from hapticmech_ros.operational.metric import TaskMetric
from hapticmech_ros.operational.observation import (
    Observation,
    observation_layout,
    observation_of,
)
from hapticmech_ros.operational.projector import balanced_share, constraint_projector, rigidity
from hapticmech_ros.operational.results import OperationalAnalysis
from hapticmech_ros.operational.spectrum import spectrum

if TYPE_CHECKING:
    from hapticmech_ros.operational.compiled import CompiledAnalysis


class Analyser:
    """Analyses one operational point of a mechanism.

    Args:
        mechanism: whose.
        point: operational point; the first one if empty.
        lateness: τ, s, of the loop that :meth:`late` and :meth:`observe` answer for; 0 for none.

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
        self._compiled = self._load() if hasattr(mechanism, "chosen") else None

    def observe(
        self, q: Array, v: Array, active: Active, closing: Closing | None = None
    ) -> Observation:
        """Evaluate Eq. 1 at a state and analyse the point there.

        Args:
            q: (nq,) configuration.
            v: (nv,) rates.
            active: which closures are closed.
            closing: what ``Mechanism.closing_terms`` gave at the same q and closures, to save time.

        Raises:
            HapticMechError: D is not positive definite, or an SVD did not converge.
        """
        if self._compiled is not None:
            return self._compiled.observe(q, v, active, self.lateness, closing)
        terms = self.mechanism.evaluate(q, v, active, closing)
        found, point = self.analyse(terms), terms.points[self.index]
        late = self.late(terms, q, v, active, found)
        layout = observation_layout(self.rows.size, self.mechanism.nv)
        return observation_of(layout, found, late, point)

    def analyse(self, terms: Evaluation) -> OperationalAnalysis:
        """Analyse the point from the terms of Eq. 1 at a state."""
        if self._compiled is not None and self._compiled.understands(terms):
            return self._compiled.observe_terms(terms, terms.v, 0.0).analysis
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
        free = found.free_acceleration
        if self.lateness == 0.0:
            return LateAnswer(found.inverse_inertia, free)
        if self._compiled is not None and self._compiled.understands(terms):
            return self._compiled.observe_terms(terms, v, self.lateness).late
        place = self.mechanism, terms, q, v, active, self.index, self.rows
        return late_answer(*place, found.spectrum, free, self.lateness)

    def _load(self) -> CompiledAnalysis:
        # Here, so that only a compiled mechanism waits for Numba.
        from hapticmech_ros.operational.compiled import CompiledAnalysis

        perception = self.mechanism.scene.perception
        return CompiledAnalysis(self.mechanism, self.index, self.rows, self.metric, perception)


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
