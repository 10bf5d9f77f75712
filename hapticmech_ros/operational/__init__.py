"""Λ_h⁻¹, its spectrum and its null space (Eqs. 2 to 12, corrected)."""

from hapticmech_ros.operational.analysis import Analyser, analyse
from hapticmech_ros.operational.results import OperationalAnalysis

__all__ = ["Analyser", "OperationalAnalysis", "analyse"]
