# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rule of a scene's limits: what the scene itself says lies within them."""

from __future__ import annotations

from collections.abc import Iterator

from hapticmech_ros.errors import SceneError, SceneProblem
from hapticmech_ros.scene.document import SceneDocument


def check_limits(scene: SceneDocument) -> None:
    """Refuse a scene whose own figures its nodes would refuse in messages.

    Without messages a scene may go beyond: its limits bound nothing else.

    Raises:
        SceneError: names each figure, its value and its limit.
    """
    problems = tuple(_broken(scene))
    if problems:
        raise SceneError(scene.name, problems)


def _broken(scene: SceneDocument) -> Iterator[SceneProblem]:
    """Yield each figure whose messages the scene's own nodes would refuse."""
    device, joint = scene.device, scene.controller.joint_constraint
    figures = (
        ("device.force_limit", device.force_limit, "force"),
        ("device.torque_limit", device.torque_limit, "torque"),
        ("controller.joint_constraint.stiffness", joint.stiffness, "stiffness"),
        ("controller.joint_constraint.damping", joint.damping, "damping"),
    )
    speeds = (
        (f"initial_state.v.{name}", speed, "joint_velocity")
        for name, given in scene.initial_state.v.items()
        for speed in (given if isinstance(given, tuple) else (given,))
    )
    for key, value, name in (*figures, *speeds):
        most = getattr(scene.limits, name)
        if abs(value) > most:
            yield SceneProblem(key, value, f"must be at most limits.{name}, {most:g}, in size")
