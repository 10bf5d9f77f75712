"""The analysis of an operational point by a kernel, for a compiled mechanism."""

from __future__ import annotations

from typing import cast

import numpy as np

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism.compiled.band_kernels import UNDECIDED
from hapticmech_ros.mechanism.compiled.chosen import Chosen
from hapticmech_ros.mechanism.compiled.mechanism import (
    CompiledEvaluation,
    CompiledMechanism,
    failure,
)
from hapticmech_ros.mechanism.compiled.space import CompiledClosing
from hapticmech_ros.mechanism.evaluation import Active, Evaluation
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.operational.kernels import ANALYSIS_SIZE, analyse_point
from hapticmech_ros.operational.late_kernels import late_point, see_late
from hapticmech_ros.operational.metric import TaskMetric
from hapticmech_ros.operational.point_kernels import NO_SPECTRUM, see_point
from hapticmech_ros.scene.rendering import Perception


class CompiledAnalysis:
    """What is constant in the analysis of one operational point.

    Attributes:
        wrenches: (t, t) columns n_i of what :meth:`see` saw last; a view.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        index: int,
        rows: Array,
        metric: TaskMetric,
        perception: Perception,
    ) -> None:
        self._mechanism = cast(CompiledMechanism, mechanism)
        self._index = index
        self._rows = rows
        limits = metric.mass, float(perception.s_on), float(perception.s_off)
        parts = (metric.point_to_link, metric.factor, metric.dual_factor)
        self._constants = np.concatenate([limits, *(part.ravel() for part in parts)])
        t = rows.size
        self._details = np.empty(t * (1 + 2 * t))
        self.wrenches: Array = self._details[t : t * (1 + t)].reshape(t, t)
        self._ahead = np.empty(0)
        self._position, self._rates = np.empty(mechanism.nq), np.empty(mechanism.nv)

    @staticmethod
    def understands(terms: Evaluation) -> bool:
        """Return whether the terms are in arrays that kernels take."""
        return isinstance(terms, CompiledEvaluation)

    def __call__(self, terms: Evaluation) -> tuple[Array, Array]:
        """Return analysis and details, as ``analyse_point`` fills them.

        Raises:
            HapticMechError: the SVD of S did not converge.
        """
        bias_force, passive, _, effort, bias, closing, points = terms
        known = cast(CompiledClosing, closing)
        pose, jacobian, _, drift = points[self._index]
        analysis, details = np.empty(ANALYSIS_SIZE), np.empty(self._details.size)
        converged = analyse_point(
            *known.chosen.constants,
            known.packed,
            bias_force,
            passive + effort,
            bias,
            jacobian,
            drift,
            pose.rotation,
            self._constants,
            self._rows,
            analysis,
            details,
        )
        if not converged:
            raise _no_spectrum()
        return analysis, details

    def late(
        self,
        terms: Evaluation,
        q: Array,
        v: Array,
        s: Array,
        details: Array,
        free_acceleration: Array,
        lateness: float,
    ) -> Array:
        """Return X_τ and a_τ, (42,); arguments as of ``late_point``."""
        bias_force, passive, _, effort, bias, closing, points = terms
        known, late = cast(CompiledClosing, closing), np.empty(42)
        late[36:] = free_acceleration
        self._position[:] = q
        self._rates[:] = v
        late_point(
            *known.chosen.constants,
            known.packed,
            self._position,
            self._rates,
            bias_force,
            passive + effort,
            bias,
            points[self._index].jacobian,
            self._index,
            self._rows,
            s,
            details,
            self._mechanism.length,
            lateness,
            self._room(known.chosen),
            late,
        )
        return late

    def see(self, q: Array, v: Array, active: Active, seen: Array, lateness: float = 0.0) -> None:
        """Fill ``seen``; see :meth:`Analyser.see`."""
        mechanism = self._mechanism
        self._position[:] = q
        self._rates[:] = v
        chosen = mechanism.chosen(active)
        code = self._see(chosen, seen)
        if code == UNDECIDED:
            chosen = chosen.dense
            code = self._see(chosen, seen)
        if code:
            raise _no_spectrum() if code == NO_SPECTRUM else failure(code, mechanism.tree)
        if lateness > 0.0:
            see_late(
                *chosen.constants,
                chosen.scratch,
                self._position,
                self._rates,
                self._index,
                self._rows,
                self._details,
                mechanism.length,
                lateness,
                self._room(chosen),
                seen,
            )

    def _room(self, chosen: Chosen) -> Array:
        """Return room for the terms at another configuration."""
        if self._ahead.size != chosen.size:
            self._ahead = np.empty(chosen.size)
        return self._ahead

    def _see(self, chosen: Chosen, seen: Array) -> int:
        return see_point(
            *chosen.constants,
            chosen.scratch,
            self._position,
            self._rates,
            self._index,
            self._constants,
            self._rows,
            self._details,
            seen,
        )


def _no_spectrum() -> HapticMechError:
    return HapticMechError("SVD of S did not converge")
