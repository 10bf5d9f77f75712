# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the nodes of robots: of the one that follows, and of the simulated one."""

from __future__ import annotations

from typing import Literal

from hapticmech_ros.nodes.parameters import NodeParameters, flag, number, text, timeout
from hapticmech_ros.nodes.timeouts import ROBOT_JOINTS, ROBOT_TARGET, ROBOT_WRENCH

# Value of a rate that follows by a rule.
BY_RULE = -1.0


class JointParameters(NodeParameters):
    """Parameters common to a robot's controller and a simulated robot."""

    interface: Literal["effort", "velocity", "position"] = text(
        "effort", "commands of the robot's controller: torques, rates or positions of joints"
    )
    command_type: Literal["array", "trajectory"] = text(
        "array",
        "array: Float64MultiArray, of forward_command_controller; trajectory: JointTrajectory with "
        "one point, of joint_trajectory_controller",
    )
    joint_state_topic: str = text("robot/joint_states", "JointState of the robot's joints")
    joint_command_topic: str = text(
        "robot/commands", "commands of the joints, in the order of the robot's file"
    )


class FollowerParameters(JointParameters):
    """Parameters of the robot that follows."""

    place = -1

    robot: str = text("", "the robot: file of a scene, URDF, MJCF or SDF")
    robot_point: str = text("", "operational point of the robot; empty: its first")
    gravity: str = text(
        "",
        "gravity on the robot, m/s^2; empty: that of the robot's file, for URDF 0 0 -9.81",
    )
    wrench_topic: str = text(
        "", "WrenchStamped of a force sensor at robot_point, axes of its frame_id; empty: none"
    )
    wrench_frame: str = text(
        "", "frame that gives the axes of wrench_topic in place of its frame_id; empty: frame_id"
    )
    torque_limits: str = text("", "of each joint, N m or N, separated by spaces; empty: none")
    joint_timeout: float = timeout(
        "joint states older than this are stale", ROBOT_JOINTS, "unconfigured"
    )
    target_timeout: float = timeout(
        "a target older than this is stale: the robot brakes", ROBOT_TARGET, "unconfigured"
    )
    wrench_timeout: float = timeout(
        "a wrench older than this is stale: the robot brakes", ROBOT_WRENCH, "unconfigured"
    )
    largest_error: float = number(
        0.1,
        "if the target is farther away, the robot follows again from where both are",
        "m",
        0.001,
        10.0,
        "unconfigured",
    )
    swing_speed: float = number(
        0.05,
        "reversals at this speed about the target count as a swing, which lowers rates; 0: none",
        "m/s",
        0.0,
        10.0,
        "unconfigured",
    )
    linear_rate: float = number(
        30.0,
        "rate with which errors of position decay; -1: by loop_delay and unknown_payload",
        "1/s",
        BY_RULE,
        1000.0,
    )
    angular_rate: float = number(
        30.0,
        "rate with which errors of orientation decay; -1: as linear_rate",
        "1/s",
        BY_RULE,
        1000.0,
    )
    damping_ratio: float = number(1.0, "damping ratio of position and orientation", "1", 0.0, 10.0)
    posture_rate: float = number(
        5.0, "rate with which joints return to the robot's initial state", "1/s", 0.0, 100.0
    )
    observer_rate: float = number(
        0.0,
        "rate of the observer of friction and payload (without a wrench sensor: of contacts too); "
        "0: none; -1: by loop_delay and unknown_payload",
        "1/s",
        BY_RULE,
        500.0,
    )
    loop_delay: float = number(
        0.0,
        "delay from a joint sample to the middle of the period in which its torques act; used by "
        "rates of -1",
        "s",
        0.0,
        1.0,
    )
    unknown_payload: float = number(
        0.0, "largest unmodelled mass at the tool; used by rates of -1", "kg", 0.0, 1000.0
    )
    payload_centre: str = text("0 0 0", "place of unknown_payload, from robot_point in its axes, m")
    gain_ramp: float = number(
        0.3, "time over which changed rates take effect", "s", 0.0, 10.0, "unconfigured"
    )
    feedback: float = number(
        1.0, "share of the robot's contact force that acts on the mechanism", "1", 0.0, 1.0
    )
    feedback_force: float = number(20.0, "largest contact force on the mechanism", "N", 0.0, 1000.0)
    feedback_torque: float = number(
        2.0, "largest contact torque on the mechanism", "N m", 0.0, 100.0
    )
    feedback_passivity: bool = flag(
        True, "limit the energy that the contact gives the mechanism", "any"
    )
    feedback_allowance: float = number(
        0.0005, "energy that a contact may give in excess of what it received", "J", 0.0, 10.0
    )
    tool_mass: float = number(
        0.0, "mass beyond the wrench sensor", "kg", 0.0, 1000.0, "unconfigured"
    )
    tool_centre: str = text("0 0 0", "centre of mass of the tool, from robot_point in its axes, m")
    sensor_offset: str = text(
        "0 0 0 0 0 0", "reading of the wrench sensor without tool and load, N and N m"
    )
    sensor_gravity: str = text("0 0 -9.81", "gravity on the tool, world axes, m/s^2")


class SimulatedRobotParameters(JointParameters):
    """Parameters of the robot in MuJoCo; its scene is the robot."""

    place = 0

    wrench_topic: str = text("robot/wrench", "WrenchStamped of its contact, in the tool's axes")
    command_timeout: float = number(
        0.1, "commands older than this count as lost: joints brake and stay", "s", 0.001, 10.0
    )
    wall: str = text("", "point and normal of a wall, world axes, m; empty: none")
