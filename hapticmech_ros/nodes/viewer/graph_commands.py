# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a page asks of a running graph, by topics and services that anybody could use."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pinocchio as pin
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.tuning import TUNED
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.live.commands import Draggable, Hold, SwitchClosure, Tune
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.nodes.exchange import Outlet
from hapticmech_ros.nodes.messages import write_pose
from hapticmech_ros.nodes.qos import STREAM_PUBLISHER
from hapticmech_ros.wire.topic import CONTROLLER
from hapticmech_ros.wire.topics import (
    CLOSURES,
    EXTERNAL_WRENCH,
    HAND_WRENCH,
    SET_OPERATIONAL_POINT,
)
from hapticmech_ros.wire.wrench import encode_wrench

# A drag that has ended is told as a zero wrench so often: one message may be lost.
_ENDINGS = 3
_SET_PARAMETERS = f"{CONTROLLER}/set_parameters"
# Key of a scene -> the controller's parameter for it.
_PARAMETERS = {f"controller.{part}.{field}": name for name, (part, field) in TUNED.items()}


class GraphCommands:
    """Publishers and clients of one page.

    Every body has its publisher from the start: the graph takes time to find a new one.

    Args:
        actor: whose they are; its name is that of the page's own topics.
        mechanism: of the graph.
        users: what is before the names of a user's topics and nodes, by the point held.
        refused: told why something was not done.

    Attributes:
        changed: key of the scene, behind its user's prefix -> value that was set from here.
    """

    def __init__(
        self,
        actor: Actor[Any],
        mechanism: Mechanism,
        users: Mapping[str, str],
        refused: Callable[[str], None],
    ) -> None:
        self._actor, self._users, self._refused = actor, users, refused
        services = {f"{CLOSURES.name}/{c.name}": SetBool for c in mechanism.closures}
        services |= {f"{user}{_SET_PARAMETERS}": SetParameters for user in users.values()}
        node = actor.node
        self._clients = {
            name: node.keep(node.create_client(kind, name)) for name, kind in services.items()
        }
        topics = {Draggable("hand", p): user + HAND_WRENCH.name for p, user in users.items()}
        for link in mechanism.scene.links:
            topics[Draggable("link", link.name)] = EXTERNAL_WRENCH.of(link.name)
        self._wrenches: dict[Draggable, Outlet] = {
            body: actor.output_named(f"{topic}/{actor.name}", WrenchStamped, STREAM_PUBLISHER)
            for body, topic in topics.items()
        }
        self._places = {
            point: actor.output(SET_OPERATIONAL_POINT, PoseStamped, STREAM_PUBLISHER, point)
            for point in users
        }
        # Of a body that is pushed, or was: how often it is still told that it is not.
        self._endings: dict[Draggable, int] = {}
        self.changed: dict[str, float] = {}

    def push(self, wrenches: Mapping[Draggable, Array], now_ns: int) -> None:
        """Push bodies from now on; what was pushed and is not is told so.

        Args:
            wrenches: (6,) N and N m, world axes, on a hand's device at the point held, or on a
                link at its origin.
            now_ns: the time, ns.
        """
        for body in [body for body in self._endings if body not in wrenches]:
            self._send(body, np.zeros(6), now_ns)
            self._endings[body] -= 1
            if not self._endings[body]:
                del self._endings[body]
        for body, wrench in wrenches.items():
            self._send(body, wrench, now_ns)
            self._endings[body] = _ENDINGS

    def is_heard(self, body: Draggable) -> bool:
        """Return whether anybody listens to what pushes a body."""
        return self._wrenches[body].wanted

    def switch(self, command: SwitchClosure) -> None:
        """Open or close a loop by its service."""
        name, request = f"{CLOSURES.name}/{command.name}", SetBool.Request(data=command.closed)

        def answered(response: SetBool.Response) -> None:
            if not response.success:
                self._refused(response.message)

        self._call(name, request, answered)

    def tune(self, command: Tune) -> None:
        """Set a gain by the parameter for it of the user's controller.

        Raises:
            InvalidInputError: it has none for this key.
        """
        name = _PARAMETERS.get(command.key)
        if name is None:
            rule = f"must be one of {', '.join(_PARAMETERS)}"
            raise InvalidInputError("key to tune", command.key, rule)
        wanted = Parameter(name, value=float(command.value)).to_parameter_msg()
        request, user = SetParameters.Request(parameters=[wanted]), self._users[command.point]

        def answered(response: SetParameters.Response) -> None:
            (result,) = response.results
            if result.successful:
                self.changed[f"{user}{command.key}"] = float(command.value)
            else:
                self._refused(result.reason)

        self._call(f"{user}{_SET_PARAMETERS}", request, answered)

    def hold(self, command: Hold, now_ns: int) -> None:
        """Put the operational point of a user at the origin of a frame."""
        message = PoseStamped()
        write_pose(message, pin.SE3.Identity(), now_ns)
        message.header.frame_id = command.frame
        self._places[command.point].publish(message)

    def _send(self, body: Draggable, wrench: Array, now_ns: int) -> None:
        self._wrenches[body].publish(encode_wrench(wrench, now_ns, self._actor.wrenches))

    def _call(self, name: str, request: Any, answered: Callable[[Any], None]) -> None:
        client = self._clients.get(name)
        if client is None or not client.service_is_ready():
            self._refused(f"{name}: nobody offers this service")
            return

        def done(answer: Any) -> None:
            self._actor.failures.run(name, answered, answer.result())

        client.call_async(request).add_done_callback(done)
