# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The controllers with NumPy, which kernels are compared with."""

from oracles.control.architecture import ReadableControl

__all__ = ["ReadableControl"]
