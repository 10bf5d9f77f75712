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
        "that the law compensates for, m/s^2; empty: the robot's file's, and 0 0 -9.81 for URDF",
    )
    wrench_topic: str = text(
        "", "WrenchStamped of a sensor at robot_point, in the axes of its frame_id; empty: none"
    )
    wrench_frame: str = text(
        "", "frame of the robot whose axes wrench_topic has, whatever frame_id; empty: frame_id"
    )
    torque_limits: str = text("", "of all joints, N m or N, with spaces between; empty: none")
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
        "a target farther away is followed from where it is then",
        "m",
        0.001,
        10.0,
        "unconfigured",
    )
    swing_speed: float = number(
        0.05,
        "speed about the target whose reversals are an oscillation, which lowers rates; 0: none",
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
    damping_ratio: float = number(1.0, "of both", "1", 0.0, 10.0)
    posture_rate: float = number(
        5.0, "rate with which joints return to the robot's initial state", "1/s", 0.0, 100.0
    )
    observer_rate: float = number(
        0.0,
        "rate of the observer of friction and payload, which a robot without a wrench sensor has "
        "for contacts; 0: none; -1: by loop_delay and unknown_payload",
        "1/s",
        BY_RULE,
        500.0,
    )
    loop_delay: float = number(
        0.0,
        "from a sample of the joints to the middle of the period in which its torques act, for "
        "rates of -1",
        "s",
        0.0,
        1.0,
    )
    unknown_payload: float = number(
        0.0, "largest unmodelled mass at the tool, for rates of -1", "kg", 0.0, 1000.0
    )
    payload_centre: str = text("0 0 0", "where it is, from robot_point in its axes, m")
    gain_ramp: float = number(
        0.3, "time over which rates pass to others", "s", 0.0, 10.0, "unconfigured"
    )
    feedback: float = number(
        1.0, "share of the robot's contact that acts on the mechanism", "1", 0.0, 1.0
    )
    feedback_force: float = number(20.0, "largest force of it", "N", 0.0, 1000.0)
    feedback_torque: float = number(2.0, "largest torque of it", "N m", 0.0, 100.0)
    feedback_passivity: bool = flag(
        True, "limit the energy that the contact gives the mechanism", "any"
    )
    feedback_allowance: float = number(
        0.0005, "that a contact may give beyond what the mechanism gave it", "J", 0.0, 10.0
    )
    tool_mass: float = number(
        0.0, "mass beyond the wrench sensor", "kg", 0.0, 1000.0, "unconfigured"
    )
    tool_centre: str = text("0 0 0", "its centre of mass from robot_point, in its axes, m")
    sensor_offset: str = text("0 0 0 0 0 0", "of the wrench sensor without tool, N and N m")
    sensor_gravity: str = text("0 0 -9.81", "that acts on the tool, world axes, m/s^2")


class SimulatedRobotParameters(JointParameters):
    """Parameters of the robot in MuJoCo; its scene is the robot."""

    place = 0

    wrench_topic: str = text("robot/wrench", "WrenchStamped of its contact, in the tool's axes")
    command_timeout: float = number(
        0.1, "commands older than this count as lost: joints brake and stay", "s", 0.001, 10.0
    )
    wall: str = text("", "point and normal of a wall, world axes, m; empty: none")
