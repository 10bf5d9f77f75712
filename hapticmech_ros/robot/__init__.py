# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot that follows an operational point: operational-space control by Λ_h⁻¹.

The robot is a scene of its own. :mod:`.law` computes joint torques, :mod:`.interfaces` what
controllers of robots accept instead, and :mod:`.follower` what is done when inputs are lost.
"""

from hapticmech_ros.robot.law import Command, ForceTask, Gains, OperationalLaw, Target

__all__ = ["Command", "ForceTask", "Gains", "OperationalLaw", "Target"]
