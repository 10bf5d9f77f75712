# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Inputs of viewer and live page: newest messages, kept as bytes until a picture is drawn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import pinocchio as pin
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.subscription import Subscription
from std_msgs.msg import Float64MultiArray, UInt8

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import flat_grasps, grasp_of
from hapticmech_ros.nodes.actor import Actor, ClockedActor, Host
from hapticmech_ros.nodes.inputs import Latest
from hapticmech_ros.nodes.messages import CONTROL_SUBSCRIBER, deserialized, read_pose, read_wrench
from hapticmech_ros.nodes.parameters import SceneSubscriberParameters
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import nanoseconds
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.observation import rigid_count
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.contact_points import ContactLayout, ContactPoints
from hapticmech_ros.wire.state import StateLayout, WireState
from hapticmech_ros.wire.topics import (
    CONTACTS,
    COUNT,
    DEVICE_COMMAND,
    DEVICE_POSE,
    HAND_FORCE,
    POINT_COMMAND,
    STATE,
    user_prefixes,
)

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class ReceivedUser:
    """The present state of one user, without old messages.

    Attributes:
        device: pose of the device.
        hand_wrench: (6,) F_h, N and N m, world axes.
        device_command: (6,) by the device, on the hand, likewise.
        count: joint constraints felt.
    """

    device: pin.SE3 | None = None
    hand_wrench: Array | None = None
    device_command: Array | None = None
    count: int | None = None


@dataclass(frozen=True, slots=True)
class Received:
    """The present state, without old messages.

    Attributes:
        state: of the mechanism.
        users: operational point held -> state of its user.
        point_commands: operational point -> (6,) on the mechanism, N and N m, world axes.
        touching: points of contact; None in a scene without contacts, or if not received.
    """

    state: WireState
    users: dict[str, ReceivedUser]
    point_commands: dict[str, Array]
    touching: ContactPoints | None = None


class SceneInput(Generic[T]):
    """The newest message of one topic.

    Args:
        actor: whose subscription it is.
        name: of the topic.
        message_type: of the topic.
        read: from bytes to the value; refuses by InvalidInputError.
    """

    def __init__(
        self, actor: Actor[Any], name: str, message_type: type, read: Callable[[bytes], T]
    ) -> None:
        self._actor = actor
        self._name = name
        self._type = message_type
        self._read = read
        self._latest: Latest[bytes] = Latest()
        self._subscription: Subscription | None = None

    def listen(self, wanted: bool) -> None:
        """Subscribe, if that was not done before; or subscribe no more, and forget."""
        node = self._actor.node
        if wanted and self._subscription is None:
            guarded = self._actor.guarded(self._name, self._keep)
            self._subscription = node.create_subscription(
                self._type, self._name, guarded, CONTROL_SUBSCRIBER, raw=True
            )
        elif not wanted and self._subscription is not None:
            node.destroy_subscription(self._subscription)
            self._subscription = None
            self.forget()

    def forget(self) -> None:
        """Forget received messages."""
        self._latest = Latest()

    def value(self, now_ns: int, timeout_ns: int) -> T | None:
        """Return the value of a message that came within ``timeout_ns``; a bad one is refused."""
        message = self._latest.value
        if message is None or not self._latest.fresh(now_ns, timeout_ns):
            return None
        try:
            return self._read(message)
        except InvalidInputError as error:
            self._actor.node.refuse(self._name, error)
            self.forget()
            return None

    def _keep(self, message: bytes, now_ns: int) -> None:
        self._latest.put(message, now_ns)


def user_inputs(
    actor: Actor[Any], point: str, prefix: str, directions: int
) -> dict[str, SceneInput[Any]]:
    """Return the subscriptions of one user's topics, by the fields of :class:`ReceivedUser`.

    Args:
        actor: whose subscriptions they are.
        point: that is held.
        prefix: before the names of the user's topics.
        directions: that the task space has.
    """
    return {
        "device": SceneInput(
            actor,
            prefix + DEVICE_POSE.name,
            PoseStamped,
            lambda data: read_pose(deserialized(data, PoseStamped), actor.limits),
        ),
        "hand_wrench": _wrench_input(actor, prefix + HAND_FORCE.name),
        "device_command": _wrench_input(actor, prefix + DEVICE_COMMAND.name),
        "count": SceneInput(
            actor, prefix + COUNT.of(point), UInt8, lambda data: _count(data, directions)
        ),
    }


class SceneInputs:
    """A viewer's subscriptions, while it has viewers itself.

    At the control rate it subscribes only to topics without a slower copy: the mechanism's state
    and the commands.

    Args:
        actor: whose subscriptions they are.
        mechanism: of the graph.
        prefixes: of the names of a user's topics, by the operational point held.
    """

    def __init__(
        self, actor: Actor[Any], mechanism: Mechanism, prefixes: Mapping[str, str]
    ) -> None:
        layout = StateLayout(mechanism)
        directions = len(mechanism.scene.task_rows)
        self._state = SceneInput(
            actor, STATE.name, Float64MultiArray, lambda data: layout.unpack(decode(data))
        )
        self._users = {
            point: user_inputs(actor, point, prefix, directions)
            for point, prefix in prefixes.items()
        }
        self._points = {
            name: _wrench_input(actor, POINT_COMMAND.of(name)) for name in mechanism.point_names
        }
        names = [contact.name for contact in mechanism.scene.contacts]
        touched = ContactLayout(names)
        self._touching = [
            SceneInput(
                actor, CONTACTS.name, Float64MultiArray, lambda data: touched.unpack(decode(data))
            )
            for _ in names[:1]
        ]

    def listen(self, wanted: bool) -> None:
        """Subscribe to everything, or to nothing."""
        for one in self._all():
            one.listen(wanted)

    def forget(self) -> None:
        """Forget received messages."""
        for one in self._all():
            one.forget()

    def _all(self) -> list[SceneInput[Any]]:
        of_users = [one for user in self._users.values() for one in user.values()]
        return [self._state, *of_users, *self._points.values(), *self._touching]

    def state(self, now_ns: int, timeout_ns: int) -> WireState | None:
        """Return the mechanism's state; None without one that came within ``timeout_ns``."""
        return self._state.value(now_ns, timeout_ns)

    def now(self, now_ns: int, timeout_ns: int) -> Received | None:
        """Return the present state; None without one of the mechanism."""
        state = self._state.value(now_ns, timeout_ns)
        if state is None:
            return None
        touching = [one.value(now_ns, timeout_ns) for one in self._touching]
        commands = {name: one.value(now_ns, timeout_ns) for name, one in self._points.items()}
        return Received(
            state,
            {
                point: ReceivedUser(**{k: one.value(now_ns, timeout_ns) for k, one in user.items()})
                for point, user in self._users.items()
            },
            {name: wrench for name, wrench in commands.items() if wrench is not None},
            touching[0] if touching else None,
        )


def _wrench_input(actor: Actor[Any], name: str) -> SceneInput[Array]:
    return SceneInput(
        actor,
        name,
        WrenchStamped,
        lambda data: read_wrench(deserialized(data, WrenchStamped), actor.wrenches),
    )


def _count(data: bytes, largest: int) -> int:
    count = int(deserialized(data, UInt8).data)
    if count > largest:
        raise InvalidInputError("count", count, f"must be 0 to {largest}")
    return count


P = TypeVar("P", bound=SceneSubscriberParameters)


class SceneSubscriber(ClockedActor[P]):
    """Subscribes to a mechanism and all its users.

    Attributes:
        users: operational points that are held, in their order.
        prefixes: of the names of a user's topics, by its point.
        mechanism: of the graph.
        inputs: the subscriptions.
        analysers: of the points held, by these.

    Raises:
        InvalidInputError: no such operational point, or one that is named twice.
    """

    def __init__(self, node: Host, parameters: P) -> None:
        super().__init__(node, parameters)
        self.users = self._held(parameters)
        self.prefixes = user_prefixes(self.users)
        self.mechanism = Mechanism(self.shared_scene)
        self.inputs = SceneInputs(self, self.mechanism, self.prefixes)
        self._grasps = flat_grasps(self.shared_scene)
        self._analyse_anew()

    @property
    def timeout_ns(self) -> int:
        """Age of a message, ns, from which on it is not shown."""
        return nanoseconds(self.parameters.input_timeout)

    def activate(self) -> None:
        """Begin with messages from now on."""
        self.inputs.forget()

    def ready(self, deadline_ns: int) -> bool:
        """Return whether a tick can be done: always, with the present inputs."""
        del deadline_ns
        return True

    def followed(self, grasps: Array) -> bool:
        """Move operational points to the places published by the mechanism.

        Args:
            grasps: (points, 7) see :func:`~hapticmech_ros.mechanism.closures.flat_grasps`.

        Returns:
            Whether they were elsewhere before.

        Raises:
            InvalidInputError: points that the scene cannot have.
        """
        if (grasps == self._grasps).all():
            return False
        mechanism = self.mechanism
        for name, numbers in zip(mechanism.point_names, grasps, strict=True):
            mechanism.set_operational_point(grasp_of(mechanism.scene, name, numbers))
        self._grasps = grasps
        self._analyse_anew()
        return True

    def count(self, user: str, received: Received, s: Array) -> int:
        """Return how many joint constraints a user feels: as received, or else from s.

        Args:
            user: by the point held.
            received: the present state.
            s: (t,) of the spectrum at that point.
        """
        counted = received.users[user].count
        return rigid_count(s, self.scene.perception) if counted is None else counted

    def _analyse_anew(self) -> None:
        self.analysers = {user: Analyser(self.mechanism, user) for user in self.users}

    def _held(self, parameters: P) -> tuple[str, ...]:
        named = parameters.held_points.split(",") if parameters.held_points else []
        if not named and parameters.operational_point:
            named = [self.point]
        scene = self.shared_scene
        points = named or scene.held_points
        found = tuple(scene.operational_point(name.strip()).name for name in points)
        if len(set(found)) < len(found):
            raise InvalidInputError("held_points", found, "each point can be held once")
        return found
