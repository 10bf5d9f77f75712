# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The analysis of an operational point with NumPy, which kernels are compared with."""

from oracles.operational.analysis import ReadableAnalyser, analyser_of

__all__ = ["ReadableAnalyser", "analyser_of"]
