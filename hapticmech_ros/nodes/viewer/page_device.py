# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A user's device for a page on a graph: its place, and whether a mouse can drag it.

A page commands a running graph by public topics and services.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pinocchio as pin
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

from hapticmech_ros.control.tuning import TUNED
from hapticmech_ros.errors import check_one_of
from hapticmech_ros.live.commands import (
    Command,
    Drag,
    Draggable,
    DragStiffness,
    Hold,
    Release,
    Report,
    SwitchClosure,
    Tune,
)
from hapticmech_ros.live.live_session import holding
from hapticmech_ros.live.process import Mailbox
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.nodes.exchange import Outlet
from hapticmech_ros.nodes.messages import STREAM_PUBLISHER, write_pose
from hapticmech_ros.nodes.timeouts import ByRate
from hapticmech_ros.nodes.viewer.scene_inputs import SceneInput
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import NANOSECONDS, nanoseconds
from hapticmech_ros.scene.hand import STILL_HAND
from hapticmech_ros.wire.bounds import read
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.messages import DeviceStateMessage
from hapticmech_ros.wire.topics import (
    CLOSURES,
    CONTROLLER,
    DEVICE,
    DEVICE_STATE,
    DIAGNOSTICS,
    EXTERNAL_WRENCH,
    HAND_WRENCH,
    REAL_DEVICES,
    SET_OPERATIONAL_POINT,
)
from hapticmech_ros.wire.wrench import encode_wrench


class PageLink:
    """Commands and reports of a page on a graph; for one node and several threads."""

    def __init__(self) -> None:
        self._asked: deque[Command] = deque()
        self._told = Mailbox("the node of this page has ended")

    @property
    def takes(self) -> frozenset[type]:
        """Commands that a graph obeys: it is neither paused, begun anew nor recorded from here."""
        return frozenset((Drag, Release, DragStiffness, Tune, SwitchClosure, Hold))

    def send(self, command: Command) -> None:
        """Send the node a command."""
        self._asked.append(command)

    def news(self, timeout_s: float) -> list[Report]:
        """Return the node's reports: of states only the newest, the others in their order.

        Args:
            timeout_s: how long to wait for anything.

        Raises:
            HapticMechError: the node has ended.
        """
        return self._told.take(timeout_s)

    def asked(self) -> list[Command]:
        """Return the commands since the last call, in their order."""
        return [self._asked.popleft() for _ in range(len(self._asked))]

    def tell(self, report: Report) -> None:
        """Send the page a report."""
        self._told.put(report)

    def close(self) -> None:
        """Send no more reports."""
        self._told.close()


# A drag's end is sent as a zero wrench so often: one message may be lost.
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
        users: prefixes of the names of a user's topics and nodes, by the point held.
        refused: called with the reason of a refusal.

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
        # Of a body that is pushed, or was: how many zero wrenches are still to be sent.
        self._endings: dict[Draggable, int] = {}
        self.changed: dict[str, float] = {}

    def push(self, wrenches: Mapping[Draggable, Array], now_ns: int) -> None:
        """Push bodies from now on; bodies no longer pushed get zero wrenches.

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
        """Return whether a body's wrench has subscribers."""
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
        check_one_of("key to tune", command.key, _PARAMETERS)
        name = _PARAMETERS[command.key]
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
            self._refused(f"{name}: this service is not available")
            return

        def done(answer: Any) -> None:
            self._actor.failures.run(name, answered, answer.result())

        client.call_async(request).add_done_callback(done)


# Older states are not used to push.
STALE = ByRate(12, 0.05)
# Diagnostics come once a second; older ones (ns) are not shown.
_TOLD_NS = 3 * NANOSECONDS


class PageDevice:
    """The received state of the device that holds an operational point.

    Args:
        page: the node.
        point: that is held.
        prefix: before the names of the user's topics and nodes.
        commands: of the page.
    """

    def __init__(self, page: Actor[Any], point: str, prefix: str, commands: GraphCommands) -> None:
        self._body, self._prefix, self._commands = Draggable("hand", point), prefix, commands
        self._scene = page.shared_scene.held_at(point)
        self._stale_ns = nanoseconds(STALE.at(page.period_s))
        self._state: SceneInput[DeviceStateMessage] = SceneInput(
            page,
            prefix + DEVICE_STATE.name,
            Float64MultiArray,
            lambda data: read(DeviceStateMessage, decode(data)),
        )
        # Full name of each node that may drive it -> the node.
        self._drivers = {
            page.node.resolve_topic_name(prefix + name).lstrip("/"): name
            for name in (DEVICE, *REAL_DEVICES)
        }
        self._driver, self._said = DEVICE, ""
        self._figures: dict[str, str] = {}
        self._received_ns = -_TOLD_NS

    def listen(self, wanted: bool) -> None:
        """Subscribe to its samples, or not."""
        self._state.listen(wanted)

    def forget(self) -> None:
        """Forget its samples."""
        self._state.forget()

    def receive(self, message: DiagnosticArray, now_ns: int) -> None:
        """Store its driver's diagnostics at a time (ns)."""
        for status in message.status:
            if status.name in self._drivers:
                self._driver, self._said = self._drivers[status.name], status.message
                self._figures = {pair.key: pair.value for pair in status.values}
                self._received_ns = now_ns

    def motion(self, now_ns: int) -> tuple[Array, Array] | None:
        """Return its place (3,), m, and velocity (3,), m/s, world axes; None if not known."""
        sample = self._state.value(now_ns, self._stale_ns)
        if sample is None:
            return None
        return sample.sample.position, sample.sample.twist[:3]

    def told(self, now_ns: int) -> str:
        """Return its driver's rate and missed deadlines."""
        if not self._is_told(now_ns):
            return f"nothing of {self._prefix}{DEVICE} on {DIAGNOSTICS.name}"
        rate, missed = (
            self._figures.get(key, "-") for key in ("achieved_rate_hz", "missed_deadlines")
        )
        return f"{self._prefix}{self._driver} {rate} Hz, {missed} deadlines missed"

    def holding(self, now_ns: int) -> str:
        """Return the hand that holds it besides the mouse, and its driver's status."""
        if not self._is_told(now_ns):
            return ""
        chosen = self._figures.get("hand", "")
        hand = {"still": STILL_HAND, "commanded": None}.get(chosen, self._scene.hand)
        return f"{holding(hand, self._scene.device.force_limit)}; {self._driver}: {self._said}"

    def immovable(self, now_ns: int) -> str:
        """Return why the mouse cannot drag it; empty if it can."""
        topic = f"{self._prefix}{HAND_WRENCH.name}"
        if self._is_told(now_ns) and self._driver in REAL_DEVICES:
            return f"{self._driver} drives a real device, which its own user's hand alone moves"
        if not self._commands.is_heard(self._body):
            return f"no device subscribes to {topic}"
        if self.motion(now_ns) is None:
            return f"no messages on {self._prefix}{DEVICE_STATE.name}"
        return ""

    def _is_told(self, now_ns: int) -> bool:
        return now_ns - self._received_ns <= _TOLD_NS
