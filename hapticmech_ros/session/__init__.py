"""Device, mechanism, analysis and control in one process, without ROS."""

from hapticmech_ros.session.run import Run
from hapticmech_ros.session.sample import Sample
from hapticmech_ros.session.session import Session

__all__ = ["Run", "Sample", "Session"]
