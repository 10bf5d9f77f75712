"""Eq. 1: Pinocchio model of the tree, loop closures, dynamics, integration, simulator."""

from hapticmech_ros.mechanism.build import build
from hapticmech_ros.mechanism.evaluation import Evaluation, PointKinematics
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.simulator import Simulator
from hapticmech_ros.mechanism.state import MechanismState, Trajectory

__all__ = [
    "Evaluation",
    "Mechanism",
    "MechanismState",
    "PointKinematics",
    "Simulator",
    "Trajectory",
    "build",
]
