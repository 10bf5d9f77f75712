# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a page asks of a running graph, by topics and services that anybody could use."""

from __future__ import annotations

from collections.abc import Callable
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
from hapticmech_ros.live.commands import Hold, SwitchClosure, Tune
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
        refused: told why something was not done.

    Attributes:
        changed: key of the scene -> value that was set from here.
    """

    def __init__(
        self, actor: Actor[Any], mechanism: Mechanism, refused: Callable[[str], None]
    ) -> None:
        self._actor, self._refused = actor, refused
        services = {f"{CLOSURES.name}/{c.name}": SetBool for c in mechanism.closures}
        services[_SET_PARAMETERS] = SetParameters
        node = actor.node
        self._clients = {
            name: node.keep(node.create_client(kind, name)) for name, kind in services.items()
        }
        bodies = [(link.name, EXTERNAL_WRENCH.of(link.name)) for link in mechanism.scene.links]
        self._wrenches: dict[str, Outlet] = {
            body: actor.output_named(f"{topic}/{actor.name}", WrenchStamped, STREAM_PUBLISHER)
            for body, topic in [("", HAND_WRENCH.name), *bodies]
        }
        self._place = actor.output(SET_OPERATIONAL_POINT, PoseStamped, STREAM_PUBLISHER)
        self._pushed, self._endings = "", 0
        self.changed: dict[str, float] = {}

    def push(self, on_device: Array | None, on_links: dict[str, Array], now_ns: int) -> None:
        """Push the device or a link from now on, or nothing: what was pushed is told so.

        Args:
            on_device: (6,) N and N m, world axes, at the point held; None for nothing.
            on_links: name of a link -> (6,) likewise, at its origin; at most one.
            now_ns: the time, ns.
        """
        pushed = {"": on_device} if on_device is not None else on_links
        for body, wrench in pushed.items():
            if body != self._pushed:
                self._send(self._pushed, np.zeros(6), now_ns)
            self._send(body, wrench, now_ns)
            self._pushed, self._endings = body, _ENDINGS
        if not pushed and self._endings:
            self._send(self._pushed, np.zeros(6), now_ns)
            self._endings -= 1

    def switch(self, command: SwitchClosure) -> None:
        """Open or close a loop by its service."""
        name, request = f"{CLOSURES.name}/{command.name}", SetBool.Request(data=command.closed)

        def answered(response: SetBool.Response) -> None:
            if not response.success:
                self._refused(response.message)

        self._call(name, request, answered)

    def tune(self, command: Tune) -> None:
        """Set a gain by the controller's parameter for it.

        Raises:
            InvalidInputError: it has none for this key.
        """
        name = _PARAMETERS.get(command.key)
        if name is None:
            rule = f"must be one of {', '.join(_PARAMETERS)}"
            raise InvalidInputError("key to tune", command.key, rule)
        wanted = Parameter(name, value=float(command.value)).to_parameter_msg()
        request = SetParameters.Request(parameters=[wanted])

        def answered(response: SetParameters.Response) -> None:
            (result,) = response.results
            if result.successful:
                self.changed[command.key] = float(command.value)
            else:
                self._refused(result.reason)

        self._call(_SET_PARAMETERS, request, answered)

    def hold(self, command: Hold, now_ns: int) -> None:
        """Put the operational point at the origin of a frame."""
        message = PoseStamped()
        write_pose(message, pin.SE3.Identity(), now_ns)
        message.header.frame_id = command.frame
        self._place.publish(message)

    def _send(self, body: str, wrench: Array, now_ns: int) -> None:
        self._wrenches[body].publish(encode_wrench(wrench, now_ns, self._actor.wrenches))

    def _call(self, name: str, request: Any, answered: Callable[[Any], None]) -> None:
        client = self._clients.get(name)
        if client is None or not client.service_is_ready():
            self._refused(f"{name}: nobody offers this service")
            return

        def done(answer: Any) -> None:
            self._actor.failures.run(name, answered, answer.result())

        client.call_async(request).add_done_callback(done)
