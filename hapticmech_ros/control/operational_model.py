# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the controllers use of an analysis."""

from __future__ import annotations

from hapticmech_ros.control.measurements import OperationalModel
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.operational.delay_compensation import CompensatedResponse


def operational_model_of(
    analysis: OperationalAnalysis, compensated: CompensatedResponse | None = None
) -> OperationalModel:
    """Return the part of an analysis that the controllers use, with X and a_0 of a late loop."""
    if compensated is None:
        compensated = CompensatedResponse(analysis.inverse_inertia, analysis.free_acceleration)
    return OperationalModel(
        compensated.inverse_inertia,
        analysis.constraint_projector,
        analysis.wrench_projector,
        compensated.free_acceleration,
    )
