"""What the controllers use of an analysis."""

from __future__ import annotations

from hapticmech_ros.control.measurements import RenderingModel
from hapticmech_ros.operational import OperationalAnalysis


def rendering_model(analysis: OperationalAnalysis) -> RenderingModel:
    """Return the part of an analysis that the controllers use."""
    return RenderingModel(
        analysis.inverse_inertia,
        analysis.constraint_projector,
        analysis.balanced_share,
        analysis.free_acceleration,
    )
