"""Everything that rendering needs to know of a mechanism at an operational point, with NumPy."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.layout import OPERATIONAL_MODEL, Layout
from hapticmech_ros.mechanism import Evaluation, Mechanism
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.evaluation import PointKinematics
from hapticmech_ros.operational import Analyser, OperationalAnalysis
from hapticmech_ros.operational.late_answer import LateAnswer
from hapticmech_ros.operational.metric import PLANAR_ROWS, SPATIAL_ROWS, TaskMetric
from hapticmech_ros.operational.observation import Observation, observation_layout
from oracles.mechanism.mechanism import ReadableEvaluation, ReadableMechanism
from oracles.operational.late_answer import late_answer
from oracles.operational.projector import balanced_share, constraint_projector, rigidity
from oracles.operational.spectrum import (
    embed,
    factors_in_world,
    inverse_inertia,
    root,
    spectrum,
)

_PLACE = OPERATIONAL_MODEL.slice("position", "quaternion")


class ReadableAnalyser:
    """Analyses one operational point; arguments and results as of ``operational.Analyser``."""

    def __init__(
        self, mechanism: ReadableMechanism, point: str = "", lateness: float = 0.0
    ) -> None:
        scene = mechanism.scene
        self.lateness = lateness
        self.mechanism = mechanism
        self.point = scene.operational_point(point)
        self.index = mechanism.point_index(point)
        self.rows = PLANAR_ROWS if scene.task_space == "planar" else SPATIAL_ROWS
        self.metric = TaskMetric(scene, self.point)

    def observe(self, q: Array, v: Array, active: Active) -> Observation:
        """Evaluate Eq. 1 at a state and analyse the point there."""
        terms = self.mechanism.evaluate(q, v, active)
        found, point = self.analyse(terms), terms.points[self.index]
        late = self.late(terms, q, v, active, found)
        layout = observation_layout(self.rows.size, self.mechanism.nv)
        return observation_of(layout, found, late, point)

    def analyse(self, terms: ReadableEvaluation | Evaluation) -> OperationalAnalysis:
        """Analyse the point from the terms of Eq. 1 at a state, by NumPy or by kernels."""
        point = terms.points[self.index]
        jacobian = point.jacobian if self.rows.size == 6 else point.jacobian[self.rows]
        perception = self.mechanism.scene.perception
        root_matrix = root(terms.space, jacobian)
        found = spectrum(root_matrix, *factors_in_world(self.metric, point.pose.rotation))
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
        self,
        terms: ReadableEvaluation,
        q: Array,
        v: Array,
        active: Active,
        found: OperationalAnalysis,
    ) -> LateAnswer:
        """Return X and a_0 as a loop late by τ needs them."""
        free = found.free_acceleration
        if self.lateness == 0.0:
            return LateAnswer(found.inverse_inertia, free)
        place = self.mechanism, terms, q, v, active, self.index, self.rows
        return late_answer(*place, found.spectrum, free, self.lateness)


def analyser_of(
    mechanism: ReadableMechanism | Mechanism, point: str = "", lateness: float = 0.0
) -> ReadableAnalyser | Analyser:
    """Return the analyser that belongs to a mechanism, readable or of kernels."""
    kind = ReadableAnalyser if isinstance(mechanism, ReadableMechanism) else Analyser
    return kind(mechanism, point, lateness)


def observation_of(
    layout: Layout, found: OperationalAnalysis, late: LateAnswer, point: PointKinematics
) -> Observation:
    """Return what was found as an observation."""
    numbers, nv = np.zeros(layout.size), point.jacobian.shape[1]
    spectrum, rows = found.spectrum, found.rows
    parts = {
        "inverse_inertia": late.inverse_inertia,
        "constraint_projector": found.constraint_projector,
        "balanced_share": found.balanced_share,
        "free_acceleration": late.free_acceleration,
        "twist": point.twist,
        "inverse_inertia_now": found.inverse_inertia,
        "free_acceleration_now": found.free_acceleration,
        "weights": found.weights,
        "directions": spectrum.wrenches,
        "duals": spectrum.duals,
        "jacobian": point.jacobian,
        "motion": np.concatenate((point.twist, point.drift)),
    }
    for name, value in parts.items():
        numbers[layout.slice(name)] = np.ravel(value)
    numbers[: spectrum.s.size] = spectrum.s
    numbers[_PLACE] = pin.SE3ToXYZQUAT(point.pose)
    return Observation(numbers, layout, rows, nv)
