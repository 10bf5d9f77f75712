"""What will run for a scene, and what will not: the plan compiled from it, as data."""

from hapticmech_ros.plan.arrays import ArraySize
from hapticmech_ros.plan.choices import Choice
from hapticmech_ros.plan.scene_check import PointCheck, SceneCheck, check_scene
from hapticmech_ros.plan.scene_plan import ClosurePlan, ScenePlan, plan_scene
from hapticmech_ros.plan.tick import TickPart

__all__ = [
    "ArraySize",
    "Choice",
    "ClosurePlan",
    "PointCheck",
    "SceneCheck",
    "ScenePlan",
    "TickPart",
    "check_scene",
    "plan_scene",
]
