# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Accuracy: mechanisms whose motion is known, as scenes, with the values they have to reproduce."""

from benchmarks.accuracy.cases import Case, Output, cases
from benchmarks.accuracy.n_four_bar import n_four_bar

__all__ = ["Case", "Output", "cases", "n_four_bar"]
