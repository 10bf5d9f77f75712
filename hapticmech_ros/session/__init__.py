# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Device, mechanism, analysis and control in one process, without ROS."""

from hapticmech_ros.session.sample import Run, Sample
from hapticmech_ros.session.session import Session
from hapticmech_ros.session.shared_session import SharedSession

__all__ = ["Run", "Sample", "Session", "SharedSession"]
