"""The analysis of an operational point by a kernel, for a compiled mechanism."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import Closing, failure
from hapticmech_ros.mechanism.evaluation import Evaluation
from hapticmech_ros.mechanism.kernels.band_kernels import UNDECIDED
from hapticmech_ros.mechanism.kernels.chosen import Chosen
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.operational.metric import TaskMetric
from hapticmech_ros.operational.observation import Observation, observation_layout
from hapticmech_ros.operational.observe_kernels import NO_SPECTRUM, observe_point
from hapticmech_ros.scene.rendering import Perception


class CompiledAnalysis:
    """What is constant in the analysis of one operational point."""

    def __init__(
        self,
        mechanism: Mechanism,
        index: int,
        rows: Array,
        metric: TaskMetric,
        perception: Perception,
    ) -> None:
        self._mechanism = mechanism
        self._index = index
        self._rows = rows
        limits = metric.mass, float(perception.s_on), float(perception.s_off)
        parts = (metric.point_to_link, metric.factor, metric.dual_factor)
        self._constants = np.concatenate([limits, *(part.ravel() for part in parts)])
        self._layout = observation_layout(rows.size, mechanism.nv)
        self._ahead = np.empty(0)
        self._position, self._rates = np.empty(mechanism.nq), np.empty(mechanism.nv)

    @staticmethod
    def understands(terms: Evaluation) -> bool:
        """Return whether the terms are in arrays that kernels take."""
        return isinstance(terms, Evaluation)

    def observe_terms(self, terms: Evaluation, v: Array, lateness: float) -> Observation:
        """Analyse the point at the configuration of terms that kernels found, and rates (nv,)."""
        known = terms.closing
        return self._observe(known.q, v, known.chosen, known.packed, 1, lateness)

    def observe(
        self, q: Array, v: Array, active: Active, lateness: float, closing: Closing | None
    ) -> Observation:
        """Analyse the point at a state; see :meth:`Analyser.observe`."""
        if closing is not None:
            return self._observe(q, v, closing.chosen, closing.packed, 1, lateness)
        chosen = self._mechanism.chosen(active)
        return self._observe(q, v, chosen, chosen.scratch, 0, lateness)

    def _observe(
        self, q: Array, v: Array, chosen: Chosen, packed: Array, known: int, lateness: float
    ) -> Observation:
        mechanism, found = self._mechanism, np.empty(self._layout.size)
        self._position[:] = q
        self._rates[:] = v
        if self._ahead.size != chosen.size:
            self._ahead = np.empty(chosen.size)
        code = observe_point(
            *chosen.constants,
            packed,
            known,
            self._position,
            self._rates,
            self._index,
            self._constants,
            self._rows,
            mechanism.length,
            lateness,
            self._ahead,
            found,
        )
        if code == UNDECIDED:
            return self._observe(q, v, chosen.dense, chosen.dense.scratch, 0, lateness)
        if code == NO_SPECTRUM:
            raise HapticMechError("SVD of S did not converge")
        if code:
            raise failure(code, mechanism.tree)
        return Observation(found, self._layout, self._rows, mechanism.nv)
