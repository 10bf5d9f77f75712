"""What the mouse has got hold of: where it is, how it moves, and the wrench of the drag on it."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.live.commands import HAND, Drag
from hapticmech_ros.live.drag_spring import DragSpring, drag_spring
from hapticmech_ros.session import Sample, Session
from hapticmech_ros.view.mass_ellipsoid import felt_masses

# Share of a link's mass that a grip on it moves at once, at least: a rod's end moves a quarter.
_SHARE_MOVED, _LEAST_MASS = 0.25, 1e-3


class Grip:
    """A drag of a session's device, or of one of its links.

    Args:
        session: whose.
        drag: what is dragged, and to where.
        stiffness: of the spring, N/m.
        sample: of the session, its newest.

    Attributes:
        name: ``hand``, or the link.
        force: (3,) on it in the last tick, N, world axes.
        place: (3,) where, m, world axes.

    Raises:
        InvalidInputError: no such link, or a grip or goal that is not three finite numbers.
    """

    def __init__(self, session: Session, drag: Drag, stiffness: float, sample: Sample) -> None:
        self.name = drag.link or HAND
        self._session, self._drag = session, drag
        self._planar = session.scene.task_space == "planar"
        self.force, self.place = np.zeros(3), np.zeros(3)
        mechanism = session.simulator.mechanism
        self._data = mechanism.model.createData()
        if drag.link:
            self._joint, local = mechanism.link_place(drag.link)
            self._origin, self._in_joint = local.translation, local * drag.grip
        self._spring = self._tuned(stiffness, sample)

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

    def stiffen(self, stiffness: float, sample: Sample) -> None:
        """Pull by another spring (N/m) from now on."""
        self._spring = self._tuned(stiffness, sample)

    def continues(self, drag: Drag) -> bool:
        """Return whether this is the same grip with another goal."""
        return drag.link == self._drag.link and bool((drag.grip == self._drag.grip).all())

    def wrenches(self) -> tuple[Array | None, dict[str, Array]]:
        """Return what acts in the next tick: on the device (6,), or on a link at its origin (6,).

        Forces and torques in N and N m, world axes.
        """
        if not self._drag.link:
            device = self._session.device
            self._pull(device.pose.translation, device.twist[:3])
            return np.concatenate((self.force, np.zeros(3))), {}
        model, state = self._session.simulator.mechanism.model, self._session.mechanism
        pin.forwardKinematics(model, self._data, state.q, state.v)
        pose, motion = self._data.oMi[self._joint], self._data.v[self._joint]
        moving = motion.linear + np.cross(motion.angular, self._in_joint)
        self._pull(pose * self._in_joint, pose.rotation @ moving)
        torque = np.cross(self.place - pose * self._origin, self.force)
        return None, {self._drag.link: np.concatenate((self.force, torque))}

    def _pull(self, place: Array, velocity: Array) -> None:
        self.place = np.array(place)
        self.force = self._spring.force(self.place, velocity, self._drag.goal)
        if self._planar:
            self.force[2] = 0.0

    def _tuned(self, stiffness: float, sample: Sample) -> DragSpring:
        scene = self._session.scene
        if self._drag.link:
            link = next(one for one in scene.links if one.name == self._drag.link)
            felt = max(link.inertial.mass, _LEAST_MASS)
            moved = max(_SHARE_MOVED * felt, _LEAST_MASS)
        else:
            moved, lightest = scene.device.mass, float(felt_masses(sample.analysis)[0][0])
            felt = moved + (lightest if np.isfinite(lightest) else 0.0)
        return drag_spring(stiffness, felt, moved, self._session.period, scene.device.force_limit)
