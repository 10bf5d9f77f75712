# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Constrained and free directions of a scene at its start, in the metric's unit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.analysis.scene_variants import held_by_nobody
from hapticmech_ros.arrays import Array
from hapticmech_ros.operational import Analyser, OperationalAnalysis
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Session


@dataclass(frozen=True, slots=True)
class Directions:
    """Wrenches n_i / √m_ℓ, world axes at the point: 1 N at a link's centre of mass.

    Attributes:
        normals: (6, t) wrenches, N and N m per N; n_iᵀ e / √m_ℓ is a displacement in m.
        weights: (t,) rigidity w(s_i): 1 is constrained, 0 is free.
        mass: m_ℓ, kg.
        analysis: operational analysis they are taken from.
    """

    normals: Array
    weights: Array
    mass: float
    analysis: OperationalAnalysis

    @property
    def held(self) -> Array:
        """(6, k) directions constrained by the joints; units and axes of ``normals``."""
        return self.normals[:, self.weights == 1.0]

    @property
    def free(self) -> Array:
        """(6, t - k) other directions; likewise."""
        return self.normals[:, self.weights < 1.0]


def directions(scene: Scene, point: str = "") -> Directions:
    """Return the directions of a scene at its start.

    Args:
        scene: to analyse.
        point: operational point; the first one if empty.

    Raises:
        InvalidInputError: no such point.
    """
    session = Session(held_by_nobody(scene), point)
    analysis = session.tick().analysis
    mass = Analyser(session.simulator.mechanism, point).metric.mass
    normals = np.zeros((6, len(analysis.weights)))
    normals[analysis.rows] = analysis.spectrum.wrenches / np.sqrt(mass)
    return Directions(normals, analysis.weights, mass, analysis)
