"""The controllers with NumPy, which kernels are compared with."""

from oracles.control.architecture import ReadableControl

__all__ = ["ReadableControl"]
