# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Everything that rendering needs to know of a mechanism at an operational point, with NumPy."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.layout import OPERATIONAL_MODEL, Layout
from hapticmech_ros.mechanism import Evaluation, Mechanism
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import PointKinematics
from hapticmech_ros.operational import Analyser, OperationalAnalysis
from hapticmech_ros.operational.analysis import TaskMetric
from hapticmech_ros.operational.observation import Observation, observation_layout
from hapticmech_ros.operational.results import CompensatedResponse
from oracles.mechanism.mechanism import ReadableEvaluation, ReadableMechanism
from oracles.operational.delay_compensation import compensated_response
from oracles.operational.projector import constraint_projector, rigidity, wrench_projector
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
        self, mechanism: ReadableMechanism, point: str = "", compensated_delay: float = 0.0
    ) -> None:
        scene = mechanism.scene
        self.compensated_delay = compensated_delay
        self.mechanism = mechanism
        self.point = scene.operational_point(point)
        self.index = mechanism.point_index(point)
        self.metric = TaskMetric(scene, self.point)
        self.rows = self.metric.rows

    def observe(self, q: Array, v: Array, active: Active) -> Observation:
        """Evaluate Eq. 1 at a state and analyse the point there."""
        terms = self.mechanism.evaluate(q, v, active)
        found, point = self.analyse(terms), terms.points[self.index]
        compensated = self.compensated(terms, q, v, active, found)
        layout = observation_layout(self.rows.size, self.mechanism.nv)
        return observation_of(layout, found, compensated, point)

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
            inverse_inertia=embed(inverse_inertia(root_matrix), self.rows),
            spectrum=found,
            weights=weights,
            constraint_projector=embed(
                constraint_projector(found, weights, self.metric.mass), self.rows
            ),
            wrench_projector=embed(wrench_projector(found, weights), self.rows),
            free_acceleration=point.jacobian @ free_rates + point.drift,
            rows=self.rows,
        )

    def compensated(
        self,
        terms: ReadableEvaluation,
        q: Array,
        v: Array,
        active: Active,
        found: OperationalAnalysis,
        before: Array | None = None,
    ) -> CompensatedResponse:
        """Return X and a_0 as a loop late by τ needs them."""
        free = found.free_acceleration
        if self.compensated_delay == 0.0:
            return CompensatedResponse(found.inverse_inertia, free)
        place = self.mechanism, terms, q, v, active, self.index, self.rows
        late = self.compensated_delay
        return compensated_response(*place, found.spectrum, free, late, before)


def analyser_of(
    mechanism: ReadableMechanism | Mechanism, point: str = "", compensated_delay: float = 0.0
) -> ReadableAnalyser | Analyser:
    """Return the analyser that belongs to a mechanism, readable or of kernels."""
    kind = ReadableAnalyser if isinstance(mechanism, ReadableMechanism) else Analyser
    return kind(mechanism, point, compensated_delay)


def observation_of(
    layout: Layout,
    found: OperationalAnalysis,
    compensated: CompensatedResponse,
    point: PointKinematics,
) -> Observation:
    """Return what was found as an observation."""
    numbers, nv = np.zeros(layout.size), point.jacobian.shape[1]
    spectrum, rows = found.spectrum, found.rows
    parts = {
        "inverse_inertia": compensated.inverse_inertia,
        "constraint_projector": found.constraint_projector,
        "wrench_projector": found.wrench_projector,
        "free_acceleration": compensated.free_acceleration,
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
