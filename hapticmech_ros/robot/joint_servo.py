# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What stands for the joints' own controllers of a robot that takes positions or velocities."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.robot.mujoco_robot import MujocoRobot

# Rate of a joint's error, 1/s, critically damped: that of an industrial robot's servo.
RATE = 100.0


def servo_torque(robot: MujocoRobot, position: Array | None, velocity: Array | None) -> Array:
    """Return torques (nv,) that make joints go where they are told, by the robot's own terms.

    v̇ = ω² (q_c - q) + 2 ω (v_c - v) with position and velocity; with one of them, its part alone
    and rest for the other.

    Args:
        robot: in MuJoCo.
        position: (nv,) q_c, rad or m; None: no position is told.
        velocity: (nv,) v_c, rad/s or m/s; None: rest.
    """
    inertia, bias, _ = robot.terms()
    wanted = np.zeros(robot.nv) if velocity is None else velocity
    asked = 2.0 * RATE * (wanted - robot.v)
    if position is not None:
        asked = asked + RATE**2 * (position - robot.q)
    return np.asarray(inertia @ asked + bias)
