# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Topics and services of the mechanism: of its operational points, of contacts and closures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

from hapticmech_ros.device.real_device import MOST_BUTTONS
from hapticmech_ros.device.state import NO_WRENCH
from hapticmech_ros.errors import InvalidInputError, listed
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import flat_grasp, flat_grasps, grasp_posed
from hapticmech_ros.mechanism.constraint_space import PointKinematics
from hapticmech_ros.mechanism.model import se3
from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.nodes.exchange import Outlet
from hapticmech_ros.nodes.inputs import NEVER, ExpiringWrench, InOrder
from hapticmech_ros.nodes.messages import (
    CONTROL_SUBSCRIBER,
    LATCHED,
    WORLD,
    read_framed_pose,
    write_pose,
)
from hapticmech_ros.nodes.parameters import MechanismParameters
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene.mechanism import OperationalPoint
from hapticmech_ros.wire.bounds import pose_bounds, twist_bounds
from hapticmech_ros.wire.contact_points import ContactLayout
from hapticmech_ros.wire.stamped import encode_pose, encode_twist
from hapticmech_ros.wire.topics import (
    CLOSURES,
    CONTACT_FORCE,
    CONTACTS,
    EXTERNAL_WRENCH,
    OPERATIONAL_POINT,
    POINT_COMMAND,
    POINT_FORCE,
    POINT_JOINTS,
    POINT_POSE,
    POINT_TWIST,
    SET_OPERATIONAL_POINT,
)
from hapticmech_ros.wire.wrench import encode_wrench

if TYPE_CHECKING:
    from hapticmech_ros.contact.memory import Touching


class PointPort:
    """One operational point's commands, and its CRTK topics.

    Args:
        actor: the mechanism's.
        name: of the operational point.
        go_on: called when something came that a tick in lockstep may have waited for.

    Attributes:
        name: as given.
        command: the controller's wrench, which expires.
        order: of commands; overtaken ones are dropped.
        controllers: publishers of commands.
        since_ns: commands that answer no later sample count as zero.
        commands, awaited: the same, and ``external_cf``, by stamp, in lockstep.
    """

    def __init__(
        self, actor: Actor[MechanismParameters], name: str, go_on: Callable[[int], None]
    ) -> None:
        self.name = name
        self._actor = actor
        self._go_on = go_on
        self.since_ns = NEVER
        self._pose_bounds = pose_bounds(actor.limits)
        self._twist_bounds = twist_bounds(actor.limits)
        self.order = InOrder()
        self.command = ExpiringWrench()
        self.commands: dict[int, Array] = {}
        self.awaited: dict[int, Array] = {}
        self._publish_pose = actor.view(POINT_POSE, PoseStamped, name)
        self._publish_twist = actor.view(POINT_TWIST, TwistStamped, name)
        self._publish_force = actor.view(POINT_FORCE, WrenchStamped, name)
        self._publish_joints = actor.view(POINT_JOINTS, JointState, name)
        qos, commands = actor.control_input, POINT_COMMAND.of(name)
        self.controllers = actor.sources(commands)
        actor.input_command(commands, qos, self._on_command, sources=self.controllers)
        if actor.parameters.require_external_wrench:
            topic = EXTERNAL_WRENCH.of(name)
            actor.input_command(topic, qos, self._on_awaited, unstamped_is_now=False)

    def set_timeout(self, timeout_ns: int) -> None:
        """Set how long a command stands, and how long it then takes to reach zero."""
        self.command.timeout_ns = self.command.ramp_ns = timeout_ns

    def received(self, now_ns: int) -> bool:
        """Return whether commands of one controller are received."""
        return self.command.received(now_ns) and not self.controllers.fault(now_ns)

    def forget(self) -> None:
        """Forget commands, and their publishers."""
        self.command.clear()
        self.order.forget()
        self.controllers.forget()

    def let_go(self, now_ns: int) -> None:
        """Release the mechanism: commands that answer earlier samples count as zero.

        Args:
            now_ns: the time of the mechanism's last sample.
        """
        self.since_ns = now_ns
        self.command.clear()
        self.command.put(np.zeros(6), now_ns)

    def check(self, point: PointKinematics) -> None:
        """Hold the point's pose and twist to the scene's limits.

        Raises:
            OutputError: one is beyond them.
        """
        self._pose_bounds.check_output((*point.pose.translation.tolist(), 0.0, 0.0, 0.0))
        self._twist_bounds.check_output(point.twist.tolist())

    def publish(
        self, point: PointKinematics, force: Array, joints: Callable[[], bytes], time_ns: int
    ) -> None:
        """Publish the topics for people and CRTK clients.

        Args:
            point: its kinematics.
            force: (6,) F_c, N and N m, world axes at the operational point.
            joints: returns the serialized joint states.
            time_ns: their stamp, ns.
        """
        self._publish_force.offer(encode_wrench, force, time_ns)
        self._publish_twist.offer(encode_twist, point.twist.tolist(), time_ns)
        self._publish_joints.offer(joints)
        self._publish_pose.offer(encode_pose, pin.SE3ToXYZQUAT(point.pose).tolist(), time_ns)

    def _on_command(self, wrench: Array, stamp_ns: int, now_ns: int) -> None:
        self._actor.ages.add(now_ns - stamp_ns)
        if self.controllers.fault(now_ns):
            self.command.clear()
        elif self._actor.lockstep or self.order.is_next(stamp_ns, now_ns):
            self.command.put(wrench if stamp_ns > self.since_ns else np.zeros(6), now_ns)
        if self._actor.lockstep:
            self.commands[stamp_ns] = wrench
            self._go_on(now_ns)

    def _on_awaited(self, wrench: Array, stamp_ns: int, now_ns: int) -> None:
        self.awaited[stamp_ns] = wrench
        self._go_on(now_ns)


class ContactPort:
    """Publishes contact points, in a scene with contacts, if there are subscribers.

    Args:
        actor: the mechanism's.
        names: of the scene's contacts; without any there are no topics.
    """

    def __init__(self, actor: Actor[MechanismParameters], names: Sequence[str]) -> None:
        self._layout = ContactLayout(names)
        self._points = [actor.view(CONTACTS, Float64MultiArray)] if names else []
        self._pairs = [actor.view(CONTACT_FORCE, WrenchStamped, name) for name in names]

    def publish(self, touching: Touching | None, time_ns: int) -> None:
        """Publish the points of contact of the step that led to a time; None: nothing touches."""
        for outlet in self._points:
            outlet.offer(self._layout.encode, touching, time_ns)
        for pair, outlet in enumerate(self._pairs):
            wrench = NO_WRENCH if touching is None else touching.wrench(pair)
            outlet.offer(encode_wrench, wrench, time_ns)


def offer_closures(
    actor: Actor[Any], names: Iterable[str], switch: Callable[[str, bool], None]
) -> None:
    """Offer ``mechanism/closures/<name>``: true closes it, false opens it.

    Args:
        actor: whose services they are.
        names: of the closures and couplings.
        switch: does it, or raises HapticMechError, which is answered.
    """
    node = actor.node
    for name in names:
        answer = partial(_answer, actor, name, switch)
        node.keep(node.create_service(SetBool, f"{CLOSURES.name}/{name}", answer))


def _answer(
    actor: Actor[Any],
    name: str,
    switch: Callable[[str, bool], None],
    request: SetBool.Request,
    response: SetBool.Response,
) -> SetBool.Response:
    closed = bool(request.data)
    done = f"{name} is {'closed' if closed else 'open'}"
    return actor.failures.answer(f"closure {name}", lambda: switch(name, closed), response, done)


def closure_button(given: str, names: Sequence[str]) -> tuple[str, int] | None:
    """Return the closure that a button switches, and the number of the button; None for none.

    Args:
        given: name and number, such as ``ground_pin 2``; empty: none.
        names: of the closures.

    Raises:
        InvalidInputError: no such closure, or no number of a button.
    """
    if not given.strip():
        return None
    name, _, number = given.strip().rpartition(" ")
    if name not in names or not number.isdecimal() or not 0 < int(number) <= MOST_BUTTONS:
        rule = f"must be one of {listed(names)}, and a number from 1 to {MOST_BUTTONS}"
        raise InvalidInputError("closure_button", given, rule)
    return name, int(number)


class OperationalPoints:
    """Moves operational points, and announces where they are.

    Subscribes to ``mechanism/<point>/set_operational_point`` and publishes
    ``mechanism/<point>/operational_point``.

    Args:
        actor: the mechanism's.
        mechanism: whose operational points they are.
        configuration: returns the present q (nq,).
        take: puts a point elsewhere, between two ticks; may refuse with InvalidInputError.

    Attributes:
        numbers: (points, 7) where every point is.
    """

    def __init__(
        self,
        actor: Actor[MechanismParameters],
        mechanism: Mechanism,
        configuration: Callable[[], Array],
        take: Callable[[OperationalPoint], None],
    ) -> None:
        self._actor = actor
        self._mechanism = mechanism
        self._configuration = configuration
        self._take = take
        self.numbers: Array = flat_grasps(mechanism.scene)
        self._outlets: list[Outlet] = []
        for name in mechanism.point_names:
            self._outlets.append(actor.output(OPERATIONAL_POINT, PoseStamped, LATCHED, point=name))
            accept = partial(self._on_grasp, name)
            actor.input(SET_OPERATIONAL_POINT.of(name), PoseStamped, CONTROL_SUBSCRIBER, accept)

    def announce(self) -> None:
        """Publish the place of every operational point."""
        for point in self._mechanism.scene.operational_points:
            self._announce(point)

    def moved(self, point: OperationalPoint) -> None:
        """Publish that an operational point has another place."""
        self.numbers = self.numbers.copy()
        self.numbers[self._mechanism.point_index(point.name)] = flat_grasp(
            self._mechanism.scene, point
        )
        self._announce(point)

    def _on_grasp(self, name: str, message: PoseStamped, now_ns: int) -> None:
        del now_ns
        frame, pose = message.header.frame_id, read_framed_pose(message, self._actor.limits)
        scene = self._mechanism.scene
        if frame == WORLD:
            frame = scene.operational_point(name).link
            held = self._mechanism.frame_pose(self._configuration(), frame)
            pose = held.actInv(pose)
        if not frame:
            rule = f"must be a link, an operational point, or '{WORLD}'"
            raise InvalidInputError("frame_id", frame, rule)
        self._take(grasp_posed(scene, name, frame, pose))

    def _announce(self, point: OperationalPoint) -> None:
        message = PoseStamped()
        pose: pin.SE3 = se3(point.origin)
        write_pose(message, pose, self._actor.now_ns())
        message.header.frame_id = point.link
        self._outlets[self._mechanism.point_index(point.name)].publish(message)
