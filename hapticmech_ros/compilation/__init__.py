# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled functions over small arrays: how they are declared, built, kept and loaded."""

from hapticmech_ros.compilation.arrays import local, local_whole, put, shaped
from hapticmech_ros.compilation.decorators import (
    c_function,
    function_at,
    inner,
    kernel,
    leaf,
)
from hapticmech_ros.compilation.structures import (
    SIZES,
    Part,
    RealTail,
    RecordPart,
    Size,
    Structure,
    arrays_of,
)

__all__ = [
    "SIZES",
    "Part",
    "RealTail",
    "RecordPart",
    "Size",
    "Structure",
    "arrays_of",
    "c_function",
    "function_at",
    "inner",
    "kernel",
    "leaf",
    "local",
    "local_whole",
    "put",
    "shaped",
]
