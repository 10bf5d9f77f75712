"""The controllers of Fig. 3, and the architecture that joins them."""

from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.engagement import Engagement
from hapticmech_ros.control.measurements import (
    ControlOutput,
    DeviceMeasurement,
    PointMeasurement,
    RenderingModel,
)

__all__ = [
    "ControlArchitecture",
    "ControlOutput",
    "DeviceMeasurement",
    "Engagement",
    "PointMeasurement",
    "RenderingModel",
]
