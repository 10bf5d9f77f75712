"""The analysis of an operational point with NumPy, which kernels are compared with."""

from oracles.operational.analysis import ReadableAnalyser, analyser_of

__all__ = ["ReadableAnalyser", "analyser_of"]
