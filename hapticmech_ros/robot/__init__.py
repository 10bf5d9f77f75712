# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot that follows an operational point: operational-space control by Λ_h⁻¹.

The robot is a scene of its own. :mod:`.law` computes joint torques, :mod:`.interfaces` other
commands that controllers of robots accept, and :mod:`.follower` handles lost inputs.
"""

from hapticmech_ros.robot.law import Command, ForceTask, Gains, OperationalLaw, Target

__all__ = ["Command", "ForceTask", "Gains", "OperationalLaw", "Target"]
