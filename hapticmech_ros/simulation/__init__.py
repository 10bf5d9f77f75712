# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A mechanism in time: its steps, with contacts and without, loops that latch, trajectories."""

from hapticmech_ros.simulation.simulator import MechanismState, Simulator, Trajectory

__all__ = ["MechanismState", "Simulator", "Trajectory"]
