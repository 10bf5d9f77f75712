"""A mechanism in time: its steps, with contacts and without, loops that latch, trajectories."""

from hapticmech_ros.simulation.simulator import Simulator
from hapticmech_ros.simulation.state import MechanismState, Trajectory

__all__ = ["MechanismState", "Simulator", "Trajectory"]
