"""Feel virtual mechanisms: their inertia, their joints and their contacts.

The names below are the public API of the numerical core; none of them needs ROS or a clock.
"""

from hapticmech_ros.errors import (
    BagError,
    ClosureError,
    HapticMechError,
    InvalidInputError,
    SceneError,
)
from hapticmech_ros.mechanism import Mechanism, MechanismState, Simulator
from hapticmech_ros.operational import OperationalAnalysis, analyse
from hapticmech_ros.scene import Scene, load_scene
from hapticmech_ros.session import Sample, Session

__all__ = [
    "BagError",
    "ClosureError",
    "HapticMechError",
    "InvalidInputError",
    "Mechanism",
    "MechanismState",
    "OperationalAnalysis",
    "Sample",
    "Scene",
    "SceneError",
    "Session",
    "Simulator",
    "analyse",
    "load_scene",
]
