# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the mouse has got hold of: where it is, how it moves, and the wrench of the drag on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.live.commands import HAND, Drag, LiveState
from hapticmech_ros.live.drag_spring import DragSpring, drag_spring
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.operational.felt_masses import felt_masses

# Share of a link's mass that a grip on it moves at once, at least: a rod's end moves a quarter.
_SHARE_MOVED, _LEAST_MASS = 0.25, 1e-3
# A drag of which nothing is heard for so long (s) has ended: its page hangs, or is gone. Its wrench
# is to end within 0.2 s, whatever else the machine has to do.
DRAG_TIMEOUT_S = 0.15
# Bounds of the factor on the stiffness of what drags.
SOFTEST, STIFFEST = 0.1, 10.0


class Grip:
    """A drag of a device, or of a mechanism's link.

    Args:
        mechanism: that the device holds.
        drag: what is dragged, and to where.

    Attributes:
        link: that is held; empty for the device.
        force: (3,) on it when it was asked for last, N, world axes.
        place: (3,) where, m, world axes.

    Raises:
        InvalidInputError: no such link.
    """

    def __init__(self, mechanism: Mechanism, drag: Drag) -> None:
        self.link = drag.link
        self._model, self._drag = mechanism.model, drag
        self._planar = mechanism.scene.task_space == "planar"
        self.force, self.place = np.zeros(3), np.zeros(3)
        self._data = mechanism.model.createData()
        if drag.link:
            self._joint, local = mechanism.link_place(drag.link)
            self._origin, self._in_joint = local.translation, local * drag.grip

    @property
    def goal(self) -> Array:
        """(3,) to where it is pulled, m, world axes."""
        return self._drag.goal

    def pull_to(self, goal: Array) -> None:
        """Pull to another place from now on.

        Args:
            goal: (3,) m, world axes.
        """
        self._drag = Drag(self._drag.link, self._drag.grip, goal)

    def continues(self, drag: Drag) -> bool:
        """Return whether this is the same grip with another goal."""
        return drag.link == self._drag.link and bool((drag.grip == self._drag.grip).all())

    def on_device(self, spring: DragSpring, place: Array, velocity: Array) -> Array:
        """Return the wrench (6,) on the device, N and N m, world axes.

        Args:
            spring: that pulls.
            place: (3,) of the device, m, world axes.
            velocity: (3,) of the device, m/s, world axes.
        """
        self._pull(spring, place, velocity)
        return np.concatenate((self.force, np.zeros(3)))

    def on_link(self, spring: DragSpring, q: Array, v: Array) -> Array:
        """Return the wrench (6,) on the link at its origin, N and N m, world axes.

        Args:
            spring: that pulls.
            q: (nq,) configuration.
            v: (nv,) rates, rad/s or m/s.
        """
        pin.forwardKinematics(self._model, self._data, q, v)
        pose, motion = self._data.oMi[self._joint], self._data.v[self._joint]
        moving = motion.linear + np.cross(motion.angular, self._in_joint)
        self._pull(spring, pose * self._in_joint, pose.rotation @ moving)
        torque = np.cross(self.place - pose * self._origin, self.force)
        return np.concatenate((self.force, torque))

    def _pull(self, spring: DragSpring, place: Array, velocity: Array) -> None:
        self.place = np.array(place)
        self.force = spring.force(self.place, velocity, self._drag.goal)
        if self._planar:
            self.force[2] = 0.0


class Dragging:
    """The one drag of a mechanism and its device, until it is let go or nothing more is heard.

    Args:
        mechanism: that the device holds.
        period: for which a force of the spring stays as it is, s, delays included.
        now: s, of the caller's clock.

    Attributes:
        grip: what is held; None for nothing.
    """

    def __init__(self, mechanism: Mechanism, period: float, now: float) -> None:
        self.grip: Grip | None = None
        self._mechanism, self._period = mechanism, period
        self._factor = 1.0
        self._heard = self._goal_at = now
        self._spring: DragSpring | None = None

    def drag_to(self, drag: Drag, analysis: OperationalAnalysis, now: float) -> None:
        """Pull something somewhere from now (s) on.

        Args:
            drag: what, and to where.
            analysis: of the point held, as it is.
            now: s, of the caller's clock.

        Raises:
            InvalidInputError: no such link, or a grip or goal that is not three finite numbers.
        """
        for name, value in (("grip", drag.grip), ("goal", drag.goal)):
            if np.shape(value) != (3,) or not np.isfinite(value).all():
                raise InvalidInputError(f"{name} of a drag", value, "must be three finite numbers")
        self._heard = now
        grip = self.grip
        if grip is None or (grip.goal != drag.goal).any():
            self._goal_at = now
        if grip is not None and grip.continues(drag):
            grip.pull_to(drag.goal)
        else:
            self.grip = Grip(self._mechanism, drag)
            self._tune(analysis)

    def stiffen(self, factor: float, analysis: OperationalAnalysis) -> None:
        """Pull by a spring so many times as stiff as the scene's position channel.

        Raises:
            InvalidInputError: a factor out of bounds.
        """
        if not SOFTEST <= factor <= STIFFEST:
            rule = f"must be {SOFTEST:g} to {STIFFEST:g}"
            raise InvalidInputError("factor on the stiffness of the drag", factor, rule)
        self._factor = factor
        self._tune(analysis)

    def expire(self, now: float) -> None:
        """Let go if nothing has been heard for too long at a time, s."""
        if now - self._heard > DRAG_TIMEOUT_S:
            self.grip = None

    def wrenches(
        self, place: Array, velocity: Array, q: Array, v: Array
    ) -> tuple[Array | None, dict[str, Array]]:
        """Return what acts from now on: on the device (6,), or on a link at its origin (6,).

        Forces and torques in N and N m, world axes.

        Args:
            place: (3,) of the device, m, world axes.
            velocity: (3,) of the device, m/s, world axes.
            q: (nq,) configuration.
            v: (nv,) rates, rad/s or m/s.
        """
        grip, spring = self.grip, self._spring
        if grip is None or spring is None:
            return None, {}
        if not grip.link:
            return grip.on_device(spring, place, velocity), {}
        return None, {grip.link: grip.on_link(spring, q, v)}

    def on(self, state: LiveState) -> LiveState:
        """Return a state with what is dragged in it."""
        grip = self.grip
        if grip is None:
            return state
        return replace(
            state,
            dragged=grip.link or HAND,
            drag_force=grip.force,
            grip=grip.place,
            goal=grip.goal,
            goal_at=self._goal_at,
        )

    def _tune(self, analysis: OperationalAnalysis) -> None:
        grip, scene = self.grip, self._mechanism.scene
        if grip is None:
            return
        if grip.link:
            link = next(one for one in scene.links if one.name == grip.link)
            felt = max(link.inertial.mass, _LEAST_MASS)
            moved = max(_SHARE_MOVED * felt, _LEAST_MASS)
        else:
            moved, lightest = scene.device.mass, float(felt_masses(analysis)[0][0])
            felt = moved + (lightest if np.isfinite(lightest) else 0.0)
        stiffness = self._factor * max(scene.controller.position_channel.stiffness, 1.0)
        limit = scene.device.force_limit
        self._spring = drag_spring(stiffness, felt, moved, self._period, limit)
