"""The controllers of Fig. 3, and the architecture that joins them."""

from hapticmech_ros.control.architecture import (
    ControlArchitecture,
    ControlOutput,
    DeviceMeasurement,
    PointMeasurement,
    RenderingModel,
)
from hapticmech_ros.control.engagement import Engagement

__all__ = [
    "ControlArchitecture",
    "ControlOutput",
    "DeviceMeasurement",
    "Engagement",
    "PointMeasurement",
    "RenderingModel",
]
