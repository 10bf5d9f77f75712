# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What robots are to do: go through a singular pose, press on a wall, and move along it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from hapticmech_ros import load_scene
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.numerics import Array
from hapticmech_ros.robot.law import OperationalLaw, Target
from hapticmech_ros.scene import Scene

IIWA = str(Path(__file__).resolve().parents[2] / "examples/iiwa14.yaml")
# N m, of the makers' data sheets.
IIWA_LIMITS = (320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0)
UR5E_LIMITS = (150.0, 150.0, 150.0, 28.0, 28.0, 28.0)
# s of the path, and s at rest after it.
PATH_S, REST_S = 3.0, 0.5
# m before the wall, m/s towards it, N on it, m along it, and s for that.
GAP, APPROACH, FORCE, SLIDE, SLIDE_S = 0.01, 0.05, 20.0, 0.08, 2.0
# m by which a tool is called beyond its robot's reach.
BEYOND = 0.010
# m: with what lever an error of orientation counts as one of position.
LEVER = 0.1
# s that force and tool may take to settle, before and after the motion along the wall.
SETTLE_S = 1.0

Motion = Callable[[float], Target]
# A share of a way by time and duration (s), and its derivatives.
Timing = Callable[[float, float], tuple[float, float, float]]


@dataclass(frozen=True)
class Task:
    """A robot's task.

    Attributes:
        name: of the task.
        scene: of the robot.
        limits: (nv,) of its torques, N m.
        start: (nv,) where it begins, at rest.
        path: target by time, 0 to PATH_S.
        into: (3,) unit vector into the wall.
        along: (3,) unit vector along it, in which the tool is moved.
        returns: whether the path ends where it began.
    """

    name: str
    scene: Scene
    limits: Array
    start: Array
    path: Motion
    into: Array
    along: Array
    returns: bool


def share(time: float, duration: float) -> tuple[float, float, float]:
    """Return a quintic from 0 to 1, at rest at both ends, and its derivatives, 1, 1/s and 1/s²."""
    x = float(np.clip(time / duration, 0.0, 1.0))
    position = x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
    rate = 30.0 * x**2 * (1.0 - x) ** 2 / duration
    return position, rate, 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / duration**2


def straight(start: pin.SE3, way: Array, duration: float) -> Motion:
    """Return a straight motion of the tool, at rest at both ends.

    Args:
        start: pose.
        way: (3,) m, world axes.
        duration: s.
    """

    def at(time: float) -> Target:
        position, rate, change = share(time, duration)
        pose = pin.SE3(start.rotation, start.translation + position * way)
        none = np.zeros(3)
        return Target(pose, np.r_[rate * way, none], np.r_[change * way, none])

    return at


def there_and_back(time: float, duration: float) -> tuple[float, float, float]:
    """Return half of 1 - cos, squared, from 0 to 1 and back, and its derivatives, 1, 1/s and 1/s².

    It rests at both ends with its first three derivatives.
    """
    turn = 2.0 * np.pi / duration
    angle = turn * float(np.clip(time, 0.0, duration))
    c, s = np.cos(angle), np.sin(angle)
    half, slope, bend = 0.5 * (1.0 - c), 0.5 * s * turn, 0.5 * c * turn**2
    return half**2, 2.0 * half * slope, 2.0 * (slope**2 + half * bend)


def through_joints(
    law: OperationalLaw, start: Array, end: Array, timing: Timing, beyond: Array
) -> Motion:
    """Return the tool's motion while all joints go straight to others, and beyond what they reach.

    Args:
        law: of the robot.
        start: (nv,) rad.
        end: (nv,) rad, for a motion beyond it a pose at the end of the reach.
        timing: share of the way by time, over ``PATH_S``.
        beyond: (3,) m, added by the square of the share; zeros: the robot can make the motion.
    """
    way = end - start

    def at(time: float) -> Target:
        position, rate, change = timing(time, PATH_S)
        point = law.state(start + position * way, rate * way).point
        twist, acceleration = point.twist.copy(), point.jacobian @ (change * way) + point.drift
        twist[:3] += 2.0 * position * rate * beyond
        acceleration[:3] += 2.0 * (rate**2 + position * change) * beyond
        place = point.pose.translation + position**2 * beyond
        return Target(pin.SE3(point.pose.rotation, place), twist, acceleration)

    return at


def ur5e() -> OperationalLaw:
    """Return a UR5e as a robot: with weight, without the damping that a hand feels in the scene."""
    scene = load_scene("ur5e")
    still = [f"links.{link.name}.joint.damping=0.0" for link in scene.links]
    # As the iiwa's: the tool's own would rather turn the tool than move it.
    metric = f"operational_points[0].metric={{mass: 5.0, length: {LEVER}}}"
    return OperationalLaw(Mechanism(scene.with_("gravity=[0, 0, -9.81]", metric, *still)))


def iiwa() -> OperationalLaw:
    """Return the iiwa of examples/."""
    return OperationalLaw(Mechanism(load_scene(IIWA)))


def wrist_path(start: Array, end: Array) -> Task:
    """Return the task of a UR5e whose joints go straight, on either side of the wrist's pose.

    Args:
        start: (6,) rad.
        end: (6,) rad.
    """
    return _through("UR5e, through the wrist", ur5e(), UR5E_LIMITS, start, end)


def _through(
    name: str, law: OperationalLaw, limits: tuple[float, ...], start: Array, end: Array
) -> Task:
    """Return the task of a robot whose joints go straight from one pose to another."""
    path = through_joints(law, start, end, share, np.zeros(3))
    return _pressed(name, law, limits, start, end, path)


def _beyond(
    name: str,
    law: OperationalLaw,
    limits: tuple[float, ...],
    start: Array,
    end: Array,
    arm: tuple[str, str],
) -> Task:
    """Return the task of a robot that is called beyond its reach, and back.

    Args:
        name: of the task.
        law: of the robot.
        limits: of its torques, N m.
        start: (nv,) rad.
        end: (nv,) rad, its arm straight.
        arm: links at the arm's shoulder and wrist.
    """
    shoulder, wrist = (law.mechanism.frame_pose(end, link).translation for link in arm)
    out = wrist - shoulder
    beyond = np.asarray(BEYOND * out / np.linalg.norm(out))
    path = through_joints(law, start, end, there_and_back, beyond)
    return _pressed(name, law, limits, start, start, path)


def _pressed(
    name: str,
    law: OperationalLaw,
    limits: tuple[float, ...],
    start: Array,
    end: Array,
    path: Motion,
) -> Task:
    """Return the task with a wall beyond all of the path, where that is next to the path's end."""
    times = np.linspace(0.0, PATH_S, 61)
    places = np.array([path(float(time)).pose.translation for time in times])
    axes = [sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
    # How far the path goes beyond where it ends; in that direction there is no wall.
    beyond = [float((places @ axis).max() - places[-1] @ axis) for axis in axes]
    into = axes[int(np.argmin(beyond))]
    along = np.abs(np.roll(into, 1))
    scene, returns = law.mechanism.scene, bool((start == end).all())
    return Task(name, scene, np.array(limits), start, path, into, along, returns)


TASKS: dict[str, Callable[[], Task]] = {
    "wrist": lambda: wrist_path(
        np.array([0.0, -1.9, 1.9, -0.5, -0.6, 0.0]), np.array([0.4, -1.6, 1.7, -0.7, 0.6, 0.3])
    ),
    "arm": lambda: _beyond(
        "UR5e, beyond reach",
        ur5e(),
        UR5E_LIMITS,
        np.array([0.0, -1.9, 1.9, -0.5, -1.0, 0.0]),
        np.array([0.0, -1.3, 0.0, -0.3, -1.0, 0.0]),
        ("upper_arm", "wrist_block1"),
    ),
    "elbow": lambda: _through(
        "iiwa14, through the elbow",
        iiwa(),
        IIWA_LIMITS,
        np.array([0.0, 0.9, 0.0, -0.6, 0.0, 0.6, 0.0]),
        np.array([0.3, 0.7, 0.2, 0.6, 0.0, 0.4, 0.2]),
    ),
    "reach": lambda: _beyond(
        "iiwa14, beyond reach",
        iiwa(),
        IIWA_LIMITS,
        np.array([0.0, 0.6, 0.0, -1.2, 0.0, 0.9, 0.0]),
        np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.6, 0.0]),
        ("link2", "link6"),
    ),
}
# Of one robot each: one setting serves all that it is asked to do.
ROBOTS = {"UR5e": ("wrist", "arm"), "iiwa14": ("elbow", "reach")}
