# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bodies dragged by mice: place and motion of each grip, and the wrench of each drag.

The spring by which a mouse drags is sampled at every tick, like a controller: the moved mass and
the period bound its stiffness and damping, and so it is stable at any setting.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import InvalidInputError, listed
from hapticmech_ros.live.commands import Command, Drag, Draggable, DragState, Release
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.numerics import Array
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.operational.results import felt_masses
from hapticmech_ros.scene import Scene

# Of the sampled spring: at most this angle ω T a period, and this share of the velocity a period.
MOST_ANGLE, MOST_BRAKING = 0.25, 0.25
# A ray this near to the plane (sine of the angle) does not determine a point on it.
_GRAZING = 0.05


@dataclass(frozen=True, slots=True)
class DragSpring:
    """A spring and damper with a limit.

    Attributes:
        stiffness: N/m.
        damping: N s/m.
        limit: N, of the force.
    """

    stiffness: float
    damping: float
    limit: float

    def force(self, place: Array, velocity: Array, goal: Array) -> Array:
        """Return the force (3,) on a grip, N, world axes.

        Args:
            place: (3,) of the grip, m, world axes.
            velocity: (3,) of the grip, m/s, world axes.
            goal: (3,) to where it is pulled, m, world axes.
        """
        wanted = self.stiffness * (goal - place) - self.damping * velocity
        size = float(np.linalg.norm(wanted))
        return np.asarray(wanted if size <= self.limit else wanted * (self.limit / size))


def drag_spring(
    stiffness: float, felt: float, moved: float, period: float, limit: float
) -> DragSpring:
    """Return a critically damped spring, as stiff as it may be.

    Args:
        stiffness: that is wanted, N/m.
        felt: mass (kg) that it is to be critically damped with.
        moved: least mass (kg) that it moves at once, which bounds both.
        period: of the session, s.
        limit: N, of the force.

    Raises:
        InvalidInputError: a number that is not positive and finite.
    """
    given = {"stiffness": stiffness, "felt": felt, "moved": moved, "period": period, "limit": limit}
    for name, value in given.items():
        if not (np.isfinite(value) and value > 0.0):
            raise InvalidInputError(f"{name} of a drag", value, "must be positive and finite")
    bounded = min(stiffness, (MOST_ANGLE / period) ** 2 * moved)
    damping = min(2.0 * float(np.sqrt(bounded * felt)), MOST_BRAKING / period * moved)
    return DragSpring(bounded, damping, limit)


def on_plane(eye: Array, seen: Array, height: float) -> Array:
    """Return where (3,) a ray of sight meets the plane z = ``height``, m, world axes.

    Where the ray grazes the plane, or leads away from it, it is the place seen put on the plane.

    Args:
        eye: (3,) of the viewer.
        seen: (3,) on the ray.
        height: of the plane, m.
    """
    ray = seen - eye
    length = float(np.linalg.norm(ray))
    if length > 0.0 and abs(ray[2]) > _GRAZING * length:
        share = (height - eye[2]) / ray[2]
        if share > 0.0:
            return np.asarray(eye + share * ray)
    return np.array((seen[0], seen[1], height))


@dataclass(slots=True)
class _Held:
    """A grabbed body: its last command, and the data to find its goal from a ray."""

    drag: Drag
    height: float | None
    offset: Array

    def pointed_at(self, eye: Array, seen: Array) -> Array:
        """Return the point (3,) on the ray from an eye (3,) through a seen point (3,), m."""
        return np.array(seen) if self.height is None else on_plane(eye, seen, self.height)


class Mice:
    """The drags of all clients; may be used from several threads.

    A client drags one body at a time, and a body is dragged by one client at a time.

    Args:
        send: sends the session a command.
    """

    def __init__(self, send: Callable[[Command], None]) -> None:
        self._send = send
        self._lock = threading.Lock()
        self._held: dict[int, _Held] = {}

    def grab(
        self,
        client: int,
        body: Draggable,
        grip: Array,
        held: Array,
        eye: Array,
        seen: Array,
        planar: bool,
    ) -> int:
        """Take hold of a body, unless another client has it.

        Args:
            client: whose mouse it is.
            body: that is grabbed.
            grip: (3,) where in the link's frame, m.
            held: (3,) where that is now, m, world axes.
            eye: (3,) from where it is seen, likewise.
            seen: (3,) that the mouse points at, likewise.
            planar: whether it is pulled in the plane z = const. alone.

        Returns:
            Who has it now: this client, or the other one.
        """
        with self._lock:
            holder = self._holders().get(body, client)
            if holder != client:
                return holder
            self._let_go(client)
            drag = Drag(body, grip, np.array(held))
            found = _Held(drag, float(held[2]) if planar else None, np.zeros(3))
            found.offset = held - found.pointed_at(eye, seen)
            self._held[client] = found
            self._send(drag)
            return client

    def move(self, client: int, eye: Array, seen: Array) -> None:
        """Pull to where the mouse points now, if this client has hold of something.

        Args:
            client: whose mouse it is.
            eye: (3,) from where it is seen, m, world axes.
            seen: (3,) that the mouse points at, likewise.
        """
        with self._lock:
            held = self._held.get(client)
            if held is not None:
                held.drag = replace(held.drag, goal=held.pointed_at(eye, seen) + held.offset)
                self._send(held.drag)

    def let_go(self, client: int | None = None) -> None:
        """End the drag of a client, or all of them if None."""
        with self._lock:
            for one in list(self._held) if client is None else [client]:
                self._let_go(one)

    def holders(self) -> dict[Draggable, int]:
        """Return which client drags each body that is dragged."""
        with self._lock:
            return self._holders()

    def repeat(self) -> None:
        """Send the drags again: without that the session ends them.

        A mouse that is held still sends no events; this shows that its page is alive.
        """
        with self._lock:
            for held in self._held.values():
                self._send(held.drag)

    def _holders(self) -> dict[Draggable, int]:
        return {held.drag.body: client for client, held in self._held.items()}

    def _let_go(self, client: int) -> None:
        held = self._held.pop(client, None)
        if held is not None:
            self._send(Release(held.drag.body))


# Share of a link's mass that a grip on it moves at once, at least: a rod's end moves a quarter.
_SHARE_MOVED, _LEAST_MASS = 0.25, 1e-3
# A drag without commands for so long (s) has ended: its page hangs, or is gone. Its wrench must end
# within 0.2 s, on a busy machine too.
DRAG_TIMEOUT_S = 0.15
# Bounds of the factor on the stiffness of the drag's spring.
SOFTEST, STIFFEST = 0.1, 10.0


class Grip:
    """A drag of a device, or of a mechanism's link.

    Args:
        mechanism: that is held.
        drag: the body, and its goal.
        spring: that pulls at first.
        now: s, of the caller's clock.

    Attributes:
        spring: that pulls.
        force: (3,) on it, computed last, N, world axes.
        place: (3,) where, m, world axes.
        received: time of its last command, s.

    Raises:
        InvalidInputError: no such link.
    """

    def __init__(self, mechanism: Mechanism, drag: Drag, spring: DragSpring, now: float) -> None:
        self.spring, self.received = spring, now
        self.force, self.place = np.zeros(3), np.zeros(3)
        self._drag, self._goal_at = drag, now
        self._model, self._data = mechanism.model, mechanism.model.createData()
        self._planar = mechanism.scene.task_space == "planar"
        if drag.body.kind == "link":
            self._joint, local = mechanism.link_place(drag.body.name)
            self._origin, self._in_joint = local.translation, local * drag.grip

    @property
    def state(self) -> DragState:
        """The drag as it is."""
        drag = self._drag
        return DragState(drag.body, self.force, self.place, drag.goal, self._goal_at)

    def pull_to(self, goal: Array, now: float) -> None:
        """Pull to another place, or to the same, from now (s) on.

        Args:
            goal: (3,) m, world axes.
            now: s, of the caller's clock.
        """
        self.received = now
        if (goal != self._drag.goal).any():
            self._drag, self._goal_at = replace(self._drag, goal=goal), now

    def continues(self, drag: Drag) -> bool:
        """Return whether this is the same grip with another goal."""
        return drag.body == self._drag.body and bool((drag.grip == self._drag.grip).all())

    def on_device(self, place: Array, velocity: Array) -> Array:
        """Return the wrench (6,) on the device, N and N m, world axes.

        Args:
            place: (3,) of the device, m, world axes.
            velocity: (3,) of the device, m/s, world axes.
        """
        self._pull(place, velocity)
        return np.concatenate((self.force, np.zeros(3)))

    def on_link(self, q: Array, v: Array) -> Array:
        """Return the wrench (6,) on the link at its origin, N and N m, world axes.

        Args:
            q: (nq,) configuration.
            v: (nv,) rates, rad/s or m/s.
        """
        pin.forwardKinematics(self._model, self._data, q, v)
        pose, motion = self._data.oMi[self._joint], self._data.v[self._joint]
        moving = motion.linear + np.cross(motion.angular, self._in_joint)
        self._pull(pose * self._in_joint, pose.rotation @ moving)
        torque = np.cross(self.place - pose * self._origin, self.force)
        return np.concatenate((self.force, torque))

    def _pull(self, place: Array, velocity: Array) -> None:
        self.place = np.array(place)
        self.force = self.spring.force(self.place, velocity, self._drag.goal)
        if self._planar:
            self.force[2] = 0.0


class Dragging:
    """The drags of a mechanism and of the devices on it, until released or timed out.

    Args:
        mechanism: that the devices hold.
        scene: with all its hands.
        users: operational points that are held.
        period: for which a force of a spring stays as it is, s, delays included.
        analysis: of the point that a user holds, as it is now, by the name of the point.

    Attributes:
        grips: of dragged bodies, in the order of grabbing.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        scene: Scene,
        users: Sequence[str],
        period: float,
        analysis: Callable[[str], OperationalAnalysis],
    ) -> None:
        self.grips: dict[Draggable, Grip] = {}
        self._mechanism, self._scene, self._users = mechanism, scene, users
        self._period, self._analysis = period, analysis
        self._factor = 1.0

    def drag_to(self, drag: Drag, now: float) -> None:
        """Pull a body somewhere from now (s) on.

        Args:
            drag: the body, and its goal.
            now: s, of the caller's clock.

        Raises:
            InvalidInputError: no such link or hand, or a grip or goal that is not three finite
                numbers.
        """
        for name, value in (("grip", drag.grip), ("goal", drag.goal)):
            if np.shape(value) != (3,) or not np.isfinite(value).all():
                raise InvalidInputError(f"{name} of a drag", value, "must be three finite numbers")
        grip = self.grips.get(drag.body)
        if grip is not None and grip.continues(drag):
            grip.pull_to(drag.goal, now)
        else:
            spring = self._spring(drag.body)
            self.grips[drag.body] = Grip(self._mechanism, drag, spring, now)

    def release(self, body: Draggable | None = None) -> None:
        """Let go of a body, or of all."""
        if body is None:
            self.grips.clear()
        else:
            self.grips.pop(body, None)

    def stiffen(self, factor: float) -> None:
        """Pull by springs so many times as stiff as the scene's position channel.

        Raises:
            InvalidInputError: a factor out of bounds.
        """
        if not SOFTEST <= factor <= STIFFEST:
            rule = f"must be {SOFTEST:g} to {STIFFEST:g}"
            raise InvalidInputError("factor on the stiffness of the drag", factor, rule)
        self._factor = factor
        for body, grip in self.grips.items():
            grip.spring = self._spring(body)

    def expire(self, now: float) -> None:
        """Release drags without commands for too long at a time, s."""
        for body, grip in list(self.grips.items()):
            if now - grip.received > DRAG_TIMEOUT_S:
                del self.grips[body]

    def wrenches(
        self,
        devices: Mapping[str, tuple[Array, Array]],
        state: tuple[Array, Array] | None,
    ) -> dict[Draggable, Array]:
        """Return the wrenches from now on: on a device (6,), or on a link at its origin (6,).

        Forces and torques in N and N m, world axes. Bodies without a known state have none.

        Args:
            devices: place (3,), m, and velocity (3,), m/s, world axes, of each device that is
                known, by the operational point that it holds.
            state: (nq,) configuration and (nv,) rates, rad/s or m/s; None where they are not known.
        """
        found = {}
        for body, grip in self.grips.items():
            if body.kind == "hand" and body.name in devices:
                found[body] = grip.on_device(*devices[body.name])
            elif body.kind == "link" and state is not None:
                found[body] = grip.on_link(*state)
        return found

    def states(self) -> tuple[DragState, ...]:
        """Return the drags as they are."""
        return tuple(grip.state for grip in self.grips.values())

    def _spring(self, body: Draggable) -> DragSpring:
        """Return a body's spring; for a link, with the limits of the first user's device."""
        if body.kind == "hand" and body.name not in self._users:
            raise InvalidInputError("hand", body.name, f"must be one of {listed(self._users)}")
        scene = self._scene.held_at(body.name if body.kind == "hand" else self._users[0])
        if body.kind == "link":
            self._mechanism.link_place(body.name)
            link = next(one for one in scene.links if one.name == body.name)
            felt = max(link.inertial.mass, _LEAST_MASS)
            moved = max(_SHARE_MOVED * felt, _LEAST_MASS)
        else:
            moved = scene.device.mass
            lightest = float(felt_masses(self._analysis(body.name))[0][0])
            felt = moved + (lightest if np.isfinite(lightest) else 0.0)
        stiffness = self._factor * max(scene.controller.position_channel.stiffness, 1.0)
        limit = scene.device.force_limit
        return drag_spring(stiffness, felt, moved, self._period, limit)
