# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The package's own terms (D, W, J, S, X) of a sample, for tests to check against the oracles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.mechanism import Evaluation, Mechanism
from hapticmech_ros.mechanism.model import authored_state
from hapticmech_ros.operational import OperationalAnalysis, analyse
from hapticmech_ros.scene import scene_from_document
from oracles import closed_form
from oracles.generator import Sample
from oracles.kinematics import Array, Document


@dataclass(frozen=True)
class Terms:
    """Terms of Eq. 1 and the analysis of an operational point, reduced to the task's rows."""

    mechanism: Mechanism
    evaluation: Evaluation
    analysis: OperationalAnalysis
    point: str = ""

    @property
    def d(self) -> Array:
        """Return D."""
        return self.evaluation.inertia

    @property
    def w(self) -> Array:
        """Return W."""
        return self.evaluation.closure_jacobian

    @property
    def j(self) -> Array:
        """Return J_h on the task's rows."""
        index = self.mechanism.point_index(self.point)
        return self.evaluation.points[index].jacobian[self.analysis.rows]

    @property
    def x(self) -> Array:
        """Return X on the task's rows."""
        rows = self.analysis.rows
        return self.analysis.inverse_inertia[rows][:, rows]

    @property
    def scale(self) -> float:
        """Return |X| of the tree without closures: X is what they leave of it, zero if locked."""
        return float(np.linalg.norm(closed_form.inverse_inertia(self.d, self.w[:0], self.j)))


def terms_of(
    document: Document, q: Array | None = None, v: Array | None = None, point: str = ""
) -> Terms:
    """Evaluate and analyse a document at (q, v): left out, where it starts, and at rest."""
    mechanism = Mechanism(scene_from_document(document))
    q = authored_state(mechanism.scene, mechanism.tree)[0] if q is None else q
    rates = v if v is not None else 0.0 * mechanism.tree.damping
    evaluation = mechanism.evaluate(q, rates, mechanism.initially_active)
    return Terms(mechanism, evaluation, analyse(mechanism, q, point, rates), point)


def sample_terms(sample: Sample, point: str = "") -> Terms:
    """Evaluate and analyse a generated sample at rest."""
    return terms_of(sample.document, sample.q, point=point)
