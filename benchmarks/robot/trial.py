# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One task by one law in MuJoCo: the motion, and what is measured of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from benchmarks.robot.driven import STEPS
from benchmarks.robot.laws import Law, Setting
from benchmarks.robot.tasks import (
    APPROACH,
    FORCE,
    GAP,
    LEVER,
    PATH_S,
    REST_S,
    SETTLE_S,
    SLIDE,
    SLIDE_S,
    Task,
    straight,
)
from hapticmech_ros.control.clutch import pose_error
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.numerics import Array
from hapticmech_ros.robot.follower import DisturbanceObserver, Observed, balanced
from hapticmech_ros.robot.law import ForceTask, RobotState, Target
from hapticmech_ros.robot.mujoco_robot import Around, MujocoRobot, Unmodelled, Wall

# s of control; m of the ball at the tool.
PERIOD, RADIUS = 1e-3, 0.01
# Of an error, m: with the lever for angles.
SCALE = np.repeat((1.0, LEVER), 3)
# N that count as contact, and m at which a trial is given up.
TOUCH_N, LOST_M = 1.0, 0.3
# s that a contact may take to be found.
_LONGEST_APPROACH_S = 2.0


@dataclass(frozen=True)
class Measured:
    """What was measured of a trial.

    Attributes:
        path_rms_mm: error of the tool along the path, with the lever of 0.1 m for angles.
        path_max_mm: the largest.
        force_rms_n: error of the force while the tool moves along the wall.
        force_peak_n: largest force, at the impact above all.
        slide_rms_mm: error of the tool along the wall meanwhile.
        peak_torque: largest torque over the joint's limit.
        torque_rate: largest change of a torque along the path, kN m/s.
        drift: rad, by how much joints have moved in the null space, where the path returns.
        saturated: periods in which limits took torque away.
    """

    path_rms_mm: float
    path_max_mm: float
    force_rms_n: float
    force_peak_n: float
    slide_rms_mm: float
    peak_torque: float
    torque_rate: float
    drift: float | None
    saturated: int

    @property
    def score(self) -> float:
        """What settings are chosen by: mm along the path and N at the wall."""
        return self.path_rms_mm + self.force_rms_n


class Stage:
    """A task prepared for trials: targets along the path and the wall, the same for all laws.

    Args:
        task: what is to be done.
        unmodelled: what the robot has that no law knows of.
    """

    def __init__(self, task: Task, unmodelled: Unmodelled | None = None) -> None:
        self.task = task
        self.mechanism = Mechanism(task.scene)
        ticks = round((PATH_S + REST_S) / PERIOD)
        self.path = [task.path(PERIOD * tick) for tick in range(ticks)]
        places = np.array([target.pose.translation for target in self.path])
        end = self.path[-1].pose.translation
        self.gap = float((places @ task.into).max() - end @ task.into) + GAP
        self.wall = Wall(end + (self.gap + RADIUS) * task.into, -task.into)
        self._around = Around(self.wall, RADIUS, unmodelled or Unmodelled())

    @cached_property
    def robot(self) -> MujocoRobot:
        """The robot, which every trial puts back."""
        return MujocoRobot(self.task.scene, around=self._around, step=PERIOD / STEPS)

    def run(self, setting: Setting, most: float = np.inf) -> Measured:
        """Return what is measured of a law.

        Args:
            setting: of the law.
            most: mm; a trial whose error along the path is larger ends early.

        Raises:
            HapticMechError: the robot is lost, or finds no wall, or has a larger error.
        """
        return self._trial(setting).measured(most)

    def path_error(self, setting: Setting, most: float = np.inf) -> float:
        """Return the error of a law along the path alone, rms, mm; infinite if it is lost.

        Args:
            setting: of the law.
            most: mm; a trial whose error is larger ends early, with infinity.
        """
        try:
            return 1e3 * _rms(self._trial(setting).follow(most))
        except HapticMechError:
            return float("inf")

    def _trial(self, setting: Setting) -> _Trial:
        return _Trial(self, setting.make(self.mechanism, "", self.task.limits), setting.observer)


class _Trial:
    """A robot in motion under a law; torques act a period after what they answer."""

    def __init__(self, stage: Stage, law: Law, rate: float) -> None:
        self.stage, self.law, self.robot = stage, law, stage.robot
        self.robot.put(stage.task.start, np.zeros(self.robot.nv))
        self.torque = law.law.resting(stage.task.start)
        self.integral, self.saturated, self.peak = 0.0, 0, 0.0
        self.contact: Array = np.zeros(6)
        self.rates: list[float] = []
        self.error: Array = np.zeros(6)
        self.observer = DisturbanceObserver(law.law.mechanism, rate, PERIOD)
        self.before: RobotState | None = None
        self.observed = Observed(np.zeros(0), np.zeros(0))
        self.acted = self.torque

    def follow(self, most: float) -> Array:
        """Return lengths (n,) of errors along the path, m; none has an rms above a limit, mm."""
        lengths: list[float] = []
        left = len(self.stage.path) * (1e-3 * most) ** 2
        for target in self.stage.path:
            lengths.append(float(np.linalg.norm(SCALE * self.tick(target))))
            left -= lengths[-1] ** 2
            if left < 0.0:
                raise HapticMechError(f"the error is above {most:g} mm")
        return np.array(lengths)

    def measured(self, most: float) -> Measured:
        """Return what is measured; see :meth:`follow`."""
        task = self.stage.task
        lengths = self.follow(most)
        rate, drift = max(self.rates), float(np.abs(self.robot.q - task.start).max())
        forces, slide, peak = self._press()
        return Measured(
            path_rms_mm=1e3 * _rms(lengths),
            path_max_mm=1e3 * float(lengths.max()),
            force_rms_n=_rms(forces - FORCE),
            force_peak_n=peak,
            slide_rms_mm=1e3 * _rms(slide),
            peak_torque=self.peak,
            torque_rate=1e-3 * rate,
            drift=drift if task.returns else None,
            saturated=self.saturated,
        )

    def tick(self, target: Target) -> Array:
        """Return the error (6,) at the start of a period, and move over it."""
        robot, law = self.robot, self.law
        state = law.law.state(robot.q, robot.v)
        if self.before is None:
            self.observed = self.observer.begin(state)
        else:
            self.observed = self.observer.next(
                self.observed, self.before, self.acted, self.contact, state
            )
        self.before = state
        self.error = pose_error(robot.pose, target.pose)
        if not np.linalg.norm(self.error[:3]) < LOST_M:
            raise HapticMechError("the robot is lost")
        self.contact = robot.contact_wrench()
        known = balanced(state, self.observed)
        limited = law.torque(known, target, self.contact, self.integral)
        self.integral = law.law.next_integral(self.integral, target.force, self.contact, PERIOD)
        robot.advance(self.torque, STEPS)
        self.acted = self.torque
        self.rates.append(float(np.abs(limited.torque - self.torque).max()) / PERIOD)
        self.saturated += limited.saturated
        self.torque = limited.torque
        self.peak = max(self.peak, float((np.abs(self.torque) / self.stage.task.limits).max()))
        return self.error

    def _press(self) -> tuple[Array, Array, float]:
        """Return forces and errors while moving along the wall, and the peak force."""
        task, end = self.stage.task, self.stage.path[-1].pose
        far = self.stage.gap + APPROACH * _LONGEST_APPROACH_S
        towards = straight(end, far * task.into, 1.5 * far / APPROACH)
        target = towards(0.0)
        for tick in range(round(4.0 / PERIOD)):
            if self._pushed() > TOUCH_N:
                break
            target = towards(PERIOD * tick)
            self.tick(target)
        else:
            raise HapticMechError("the robot finds no wall")
        found, peak = target.pose, self._pushed()
        force = ForceTask(task.into, FORCE)
        forces, errors = [], []
        along = straight(found, SLIDE * task.along, SLIDE_S)
        for tick in range(-round(SETTLE_S / PERIOD), round(SLIDE_S / PERIOD)):
            # At rest before it begins.
            self.tick(replace(along(PERIOD * tick), force=force))
            pushed = self._pushed()
            peak = max(peak, pushed)
            if tick >= 0:
                forces.append(pushed)
                sideways = self.error[:3] - (task.into @ self.error[:3]) * task.into
                errors.append(float(np.linalg.norm(sideways)))
        return np.array(forces), np.array(errors), peak

    def _pushed(self) -> float:
        """Return the force into the wall, N."""
        return -float(self.stage.task.into @ self.contact[:3])


def _rms(values: Array) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))
