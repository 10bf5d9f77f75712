"""What the controllers use of an analysis."""

from __future__ import annotations

from hapticmech_ros.control.measurements import RenderingModel
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.operational.late_answer import LateAnswer


def rendering_model(
    analysis: OperationalAnalysis, late: LateAnswer | None = None
) -> RenderingModel:
    """Return the part of an analysis that the controllers use, with X and a_0 of a late loop."""
    if late is None:
        late = LateAnswer(analysis.inverse_inertia, analysis.free_acceleration)
    return RenderingModel(
        late.inverse_inertia,
        analysis.constraint_projector,
        analysis.balanced_share,
        late.free_acceleration,
    )
