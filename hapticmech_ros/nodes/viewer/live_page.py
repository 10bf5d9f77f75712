# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The live page of a running graph: a node that displays it and can push the mechanism.

It has a separate process and uses topics and services only. The page's threads and the node's meet
in a :class:`~hapticmech_ros.nodes.viewer.page_device.PageLink`.
"""

from __future__ import annotations

import threading
import time
from collections import deque

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray

from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.live.commands import (
    Command,
    Drag,
    Draggable,
    DragStiffness,
    Failed,
    Hold,
    LiveState,
    Open,
    Opened,
    Release,
    SwitchClosure,
    Tune,
    UserState,
)
from hapticmech_ros.live.grip import Dragging
from hapticmech_ros.live.settings import VISER, checked_address
from hapticmech_ros.mechanism.closures import flat_grasps
from hapticmech_ros.mechanism.projection import consistent_initial_state
from hapticmech_ros.nodes.actor import Host
from hapticmech_ros.nodes.messages import STREAM_PUBLISHER
from hapticmech_ros.nodes.parameters import LiveParameters
from hapticmech_ros.nodes.viewer.page_device import STALE, GraphCommands, PageDevice, PageLink
from hapticmech_ros.nodes.viewer.scene_inputs import Received, ReceivedUser, SceneSubscriber
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import NANOSECONDS, nanoseconds
from hapticmech_ros.operational.observation import Observation
from hapticmech_ros.system.installation import refuse_unmet
from hapticmech_ros.wire.state import WireState
from hapticmech_ros.wire.topics import DIAGNOSTICS, STATE

# Between two wrenches of a drag, s, and ticks between two reported states: 33 a second.
TICK_S, TICKS_TOLD = 0.005, 6
# From a sample to the end of its answer: the sample's age, its transit, a tick, and the transit
# back.
_DELAYED_S = 2.0 * TICK_S
# How long the page's thread is given to end, s.
_END_S = 5.0


class LivePageNode(SceneSubscriber[LiveParameters]):
    """Serves the page, sends it received states, and executes its commands.

    Raises:
        HapticMechError: viser is not installed, the address is none, or a mesh cannot be read.
    """

    name = "live_page"
    parameters_type = LiveParameters

    def __init__(self, node: Host, parameters: LiveParameters) -> None:
        super().__init__(node, parameters)
        refuse_unmet([VISER])
        # Here, as it needs viser.
        from hapticmech_ros.live.page import LivePage

        address = checked_address("host", parameters.host)
        self._link = PageLink()
        self._commands = GraphCommands(
            self, self.mechanism, self.prefixes, lambda why: self._link.tell(Failed(why))
        )
        self._devices = {
            point: PageDevice(self, point, prefix, self._commands)
            for point, prefix in self.prefixes.items()
        }
        self._dragging = Dragging(
            self.mechanism,
            self.shared_scene,
            self.users,
            _DELAYED_S,
            lambda point: self._seen[point].analysis,
        )
        self.input(DIAGNOSTICS.name, DiagnosticArray, STREAM_PUBLISHER, self._on_diagnostics)
        self._times: deque[tuple[int, int]] = deque()
        self._ticks, self._number, self._first_ns = 0, 0, 0
        self._last = self._at_the_start()
        self._seen = self._observed(self._last)
        self._ended = ""
        self._page = LivePage(
            self._link, parameters.scene, (), (), parameters.host, parameters.port
        )
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="live page", daemon=True)
        self._open()
        self._thread.start()
        seen_by = "" if address.is_loopback else "; all who reach it can see and push the mechanism"
        node.get_logger().info(f"{self._page.address}{seen_by}")

    @property
    def period_s(self) -> float:
        """Time between wrenches of a drag, s."""
        return TICK_S

    def activate(self) -> None:
        """Begin with messages from now on."""
        super().activate()
        for device in self._devices.values():
            device.forget()
        self._dragging.release()

    def deactivate(self) -> None:
        """Push nothing, and unsubscribe."""
        self._dragging.release()
        self._commands.push({}, self.now_ns())
        self._listen(False)

    def close(self) -> None:
        """Serve the page no more."""
        self._stop.set()
        self._link.close()
        self._thread.join(_END_S)
        self._page.close()

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return the page's address, and whether it is open in a browser."""
        looks = "open in a browser" if self._page.looked_at else "not open in a browser"
        dragged = ", ".join(f"{body.kind} {body.name}" for body in self._dragging.grips)
        figures = {
            "address": self._page.address,
            "dragged": dragged or "nothing",
            **self.clock_figures(),
        }
        return not self._ended, self._ended or f"{self._page.address}: {looks}", figures

    def tick(self, periods: int, deadline_ns: int) -> None:
        """Execute commands, push dragged bodies, and send the state to open pages."""
        del periods, deadline_ns
        looked_at = self._page.looked_at and not self._ended
        self._listen(looked_at)
        now, clock = self.now_ns(), time.monotonic()
        for command in self._link.asked():
            try:
                self._do(command, now, clock)
            except HapticMechError as error:
                self._link.tell(Failed(str(error)))
        self._dragging.expire(clock)
        if self._ended:
            self._dragging.release()
        self._push(now)
        self._ticks += 1
        if looked_at and self._ticks % TICKS_TOLD == 0:
            self._tell(now)

    def _serve(self) -> None:
        try:
            self._page.serve(self._stop.is_set)
        except Exception as error:  # noqa: BLE001 - after any error nothing is pushed any more
            if not self._stop.is_set():
                self._ended = f"the page has ended: {type(error).__name__}: {error}"
                self.node.get_logger().error(self._ended)

    def _listen(self, wanted: bool) -> None:
        self.inputs.listen(wanted)
        for device in self._devices.values():
            device.listen(wanted)

    def _do(self, command: Command, now_ns: int, clock: float) -> None:
        match command:
            case Drag(body=body):
                device = self._devices.get(body.name) if body.kind == "hand" else None
                problem = "" if device is None else device.immovable(now_ns)
                if problem:
                    raise InvalidInputError("drag of hand", body.name, problem)
                self._dragging.drag_to(command, clock)
            case Release():
                self._dragging.release(command.body)
            case DragStiffness():
                self._dragging.stiffen(command.factor)
            case Tune():
                self._commands.tune(command)
            case SwitchClosure():
                self._commands.switch(command)
            case Hold():
                self._commands.hold(command, now_ns)

    def _push(self, now_ns: int) -> None:
        """Push dragged bodies by their present state; not where that is unknown."""
        wrenches: dict[Draggable, Array] = {}
        if self._dragging.grips:
            state = self.inputs.state(now_ns, nanoseconds(STALE.at(self.period_s)))
            moving = {point: one.motion(now_ns) for point, one in self._devices.items()}
            wrenches = self._dragging.wrenches(
                {point: motion for point, motion in moving.items() if motion is not None},
                None if state is None else (state.q, state.v),
            )
        self._commands.push(wrenches, now_ns)

    def _tell(self, now_ns: int) -> None:
        """Send the page the present state; without messages, the last known one."""
        received = self.inputs.now(now_ns, self.timeout_ns)
        if received is not None:
            self._first_ns = self._first_ns or received.state.stamp_ns
            self.ages.add(now_ns - received.state.stamp_ns)
            try:
                if self.followed(received.state.grasps):
                    self._dragging.release()
                    self._open()
                self._seen, self._last = self._observed(received), received
            except HapticMechError as error:
                problem = InvalidInputError(
                    "state", received.state.q.tolist(), f"cannot be drawn: {error}"
                )
                self.node.refuse(STATE.name, problem)
                return
        self._link.tell(self._state(self._last, received is not None, now_ns))

    def _state(self, known: Received, fresh: bool, now_ns: int) -> LiveState:
        state = known.state
        rates = (device.told(now_ns) for device in self._devices.values())
        return LiveState(
            number=self._number,
            time=(state.stamp_ns - (self._first_ns or state.stamp_ns)) / NANOSECONDS,
            paused=False,
            factor=self._factor(state.stamp_ns, now_ns),
            q=state.q,
            active=state.active,
            users=tuple(self._user_state(point, known, now_ns) for point in self.users),
            drags=self._dragging.states(),
            changed=tuple(f"{key}={value:g}" for key, value in self._commands.changed.items()),
            told="; ".join(rates) if fresh else f"nothing on {STATE.name}",
        )

    def _user_state(self, point: str, known: Received, now_ns: int) -> UserState:
        seen, user, device = self._seen[point], known.users[point], self._devices[point]
        pose = seen.point.pose if user.device is None else user.device
        return UserState(
            point=point,
            observation=seen.numbers,
            count=self.count(point, known, seen.s),
            device=np.column_stack((pose.rotation, pose.translation)),
            hand_wrench=_or_none(user.hand_wrench),
            on_hand=_or_none(user.device_command),
            on_mechanism=_or_none(known.point_commands.get(point)),
            contact=known.state.contacts[self.analysers[point].index],
            holding=device.holding(now_ns),
            immovable=device.immovable(now_ns),
        )

    def _factor(self, stamp_ns: int, now_ns: int) -> float:
        """Return the mechanism's elapsed time over this node's, in the last second."""
        times = self._times
        times.append((now_ns, stamp_ns))
        while len(times) > 2 and now_ns - times[1][0] >= NANOSECONDS:
            times.popleft()
        (began, first), (ended, last) = times[0], times[-1]
        return (last - first) / (ended - began) if ended > began else 0.0

    def _observed(self, received: Received) -> dict[str, Observation]:
        state = received.state
        return {
            point: self.analysers[point].observe(state.q, state.v, state.active)
            for point in self.users
        }

    def _at_the_start(self) -> Received:
        """Return the state drawn before the first message."""
        mechanism = self.mechanism
        q, v = consistent_initial_state(mechanism)
        points = len(mechanism.point_names)
        state = WireState(
            0,
            mechanism.initially_active,
            q,
            v,
            np.zeros((points, 6)),
            flat_grasps(mechanism.scene),
            (False,) * points,
        )
        return Received(state, dict.fromkeys(self.users, ReceivedUser()), {})

    def _open(self) -> None:
        self._number += 1
        scene = self.mechanism.scene
        self._link.tell(Opened(self._number, Open(self.parameters.scene), scene, self.users))
        # At once, for the page to have its view before anybody opens it.
        self._link.tell(self._state(self._last, False, self.now_ns()))

    def _on_diagnostics(self, message: DiagnosticArray, now_ns: int) -> None:
        for device in self._devices.values():
            device.receive(message, now_ns)


def _or_none(wrench: Array | None) -> Array:
    """Return a wrench, or zero without one."""
    return np.zeros(6) if wrench is None else wrench
