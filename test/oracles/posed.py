# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes at a state, how far results are apart, and by how much rounding is magnified."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.mechanism import Evaluation, Mechanism
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import ConstraintSpace
from hapticmech_ros.mechanism.model import authored_state
from hapticmech_ros.scene import Scene, scene_from_document
from oracles.generator import Sample
from oracles.kinematics import Array
from oracles.running import with_start


@dataclass(frozen=True)
class Posed:
    """A scene's mechanism, and a state."""

    mechanism: Mechanism
    q: Array
    v: Array

    @property
    def sets(self) -> set[Active]:
        """Return sets of closures to try: as the scene starts, all, none."""
        count = len(self.mechanism.closures)
        return {self.mechanism.initially_active, (True,) * count, (False,) * count}

    @property
    def all_closed(self) -> Active:
        """Return the set of all closures."""
        return (True,) * len(self.mechanism.closures)

    def evaluate(self, active: Active) -> Evaluation:
        """Return all terms of Eq. 1."""
        return self.mechanism.evaluate(self.q, self.v, active)


def posed(scene: Scene, seed: int = 0, away: float = 0.0) -> Posed:
    """Return a scene at its authored state; ``away`` moves each coordinate by about that."""
    mechanism = Mechanism(scene)
    q, v = authored_state(scene, mechanism.tree)
    rng = np.random.default_rng(seed)
    if away:
        q, v = mechanism.integrate(q, away * rng.normal(size=v.size)), v + rng.normal(size=v.size)
    return Posed(mechanism, q, v)


def posed_sample(sample: Sample, away: float = 0.0) -> Posed:
    """Return a generated sample at its state, moved by ``away``."""
    document = with_start(sample.document, sample.q, sample.v)
    return posed(scene_from_document(document), away=away)


def apart(found: Array, expected: Array, size: float = 0.0) -> float:
    """Return the largest difference relative to the largest entry, or to ``size`` if larger."""
    assert found.shape == expected.shape
    if not expected.size:
        return 0.0
    largest = max(float(np.abs(expected).max()), size)
    return float(np.abs(found - expected).max()) / largest if largest > 0.0 else 0.0


def of_inertia(space: ConstraintSpace) -> float:
    """Return by how much D magnifies rounding beyond what tolerances have room for, 1e3."""
    return max(1.0, float(np.linalg.cond(space.factor)) ** 2 / 1e3)


def condition(space: ConstraintSpace) -> float:
    """Return by how much rounding is magnified: by closures that carry force, σ₁/σ_r, and by D."""
    closures = float(space.sigma[0] / space.sigma[-1]) if space.rank else 1.0
    return closures * of_inertia(space)


def falling(terms: Evaluation, index: int) -> float:
    """Return how large a point's acceleration is where nothing cancels: each force's by itself.

    With closures and without.
    """
    forces = np.abs(terms.bias_force) + np.abs(terms.passive_force) + np.abs(terms.effort)
    point, space = terms.points[index], terms.space
    free = space.to_mass_metric(np.eye(forces.size))
    sizes = [
        np.abs(point.jacobian @ np.column_stack([space.from_mass_metric(c) for c in part.T]))
        for part in (free, space.without_closure_part(free))
    ]
    return float(max((size @ forces).max() for size in sizes) + np.abs(point.drift).max())


def projector(space: ConstraintSpace) -> Array:
    """Return U Uᵀ, which is unique where U is not."""
    return space.basis @ space.basis.T
