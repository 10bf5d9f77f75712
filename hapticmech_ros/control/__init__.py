# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The controllers of Fig. 3, and the architecture that joins them."""

from hapticmech_ros.control.architecture import (
    ControlArchitecture,
    ControlLaw,
    LawInput,
    control_for,
)
from hapticmech_ros.control.clutch import Clutch
from hapticmech_ros.control.measurements import (
    ControlOutput,
    DeviceMeasurement,
    OperationalModel,
    PointMeasurement,
)

__all__ = [
    "Clutch",
    "ControlArchitecture",
    "ControlLaw",
    "ControlOutput",
    "DeviceMeasurement",
    "LawInput",
    "OperationalModel",
    "PointMeasurement",
    "control_for",
]
