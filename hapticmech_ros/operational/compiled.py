"""The analysis of an operational point by a kernel, for terms of a compiled mechanism."""

from __future__ import annotations

from typing import cast

import numpy as np

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism.compiled import CompiledEvaluation
from hapticmech_ros.mechanism.compiled_space import CompiledSpace
from hapticmech_ros.mechanism.mechanism import Evaluation
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.operational.kernels import analyse_point
from hapticmech_ros.operational.metric import TaskMetric
from hapticmech_ros.scene.document import Perception


class CompiledAnalysis:
    """What is constant in the analysis of one operational point."""

    def __init__(self, index: int, rows: Array, metric: TaskMetric, perception: Perception) -> None:
        self._index = index
        self._rows = rows
        self._factors = np.array([metric.factor, metric.dual_factor])
        self._point_to_link = np.ascontiguousarray(metric.point_to_link)
        self._constants = metric.mass, float(perception.s_on), float(perception.s_off)

    @staticmethod
    def understands(terms: Evaluation) -> bool:
        """Return whether the terms are in arrays that kernels take."""
        return isinstance(terms, CompiledEvaluation)

    def __call__(self, terms: Evaluation) -> tuple[Array, Array, Array, Array]:
        """Return X, P_c and Π (3, 6, 6); s and weights (2, t); n_i and I_ℓ⁻¹ n_i (2, t, t); a_0.

        Raises:
            HapticMechError: the SVD of S did not converge.
        """
        bias_force, passive, _, _, bias, _, points = terms
        space = cast(CompiledSpace, terms.space)
        pose, jacobian, _, drift = points[self._index]
        size = self._rows.size
        squares = np.zeros((3, 6, 6))
        values, directions = np.empty((2, size)), np.empty((2, size, size))
        acceleration = np.empty(6)
        converged = analyse_point(
            space.packed,
            space.rank,
            bias_force,
            passive,
            bias,
            jacobian,
            drift,
            pose.rotation,
            self._factors,
            self._point_to_link,
            *self._constants,
            self._rows,
            squares,
            values,
            directions,
            acceleration,
        )
        if not converged:
            raise HapticMechError("SVD of S did not converge")
        return squares, values, directions, acceleration
