# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Λ_h⁻¹, its spectrum and its null space (Eqs. 2 to 12, corrected)."""

from hapticmech_ros.operational.analysis import Analyser, analyse
from hapticmech_ros.operational.results import OperationalAnalysis

__all__ = ["Analyser", "OperationalAnalysis", "analyse"]
