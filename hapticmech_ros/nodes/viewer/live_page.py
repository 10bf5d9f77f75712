# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The live page of a running graph: a node that looks on, and pushes as anybody may.

It has a process of its own and uses topics and services only. The page's threads and the node's
meet in a :class:`~hapticmech_ros.nodes.viewer.page_link.PageLink`.
"""

from __future__ import annotations

import threading
import time
from collections import deque

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.installation import refuse_unmet
from hapticmech_ros.live.commands import (
    HAND,
    Command,
    Drag,
    DragStiffness,
    Failed,
    Hold,
    LiveState,
    Open,
    Opened,
    Release,
    SwitchClosure,
    Tune,
)
from hapticmech_ros.live.grip import Dragging
from hapticmech_ros.live.settings import VISER, checked_address
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.assembly import consistent_initial_state
from hapticmech_ros.mechanism.grasp import flat_grasps, grasp_of
from hapticmech_ros.nodes.actor import ClockedActor
from hapticmech_ros.nodes.host import Host
from hapticmech_ros.nodes.parameters import LiveParameters
from hapticmech_ros.nodes.qos import STREAM_PUBLISHER
from hapticmech_ros.nodes.viewer.graph_commands import GraphCommands
from hapticmech_ros.nodes.viewer.page_link import PageLink
from hapticmech_ros.nodes.viewer.scene_inputs import Heard, SceneInput, SceneInputs
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.counter import rigid_count
from hapticmech_ros.operational.observation import Observation
from hapticmech_ros.times import NANOSECONDS, nanoseconds
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.layouts import DeviceSample, unpack_device
from hapticmech_ros.wire.state import WireState
from hapticmech_ros.wire.topic import DEVICE
from hapticmech_ros.wire.topics import DEVICE_STATE, DIAGNOSTICS, STATE

# Between two wrenches of a drag, s, and ticks between two states that are told: 33 a second.
TICK_S, TICKS_TOLD = 0.005, 6
# From a sample to the end of what answers it: the sample's age, its way, a tick, and the way back.
_DELAYED_S = 2.0 * TICK_S
# What is older (ns) nobody is pushed by.
_STALE_NS = NANOSECONDS // 20
# How long the page's thread is given to end, s.
_END_S = 5.0
# Diagnostics come once a second; older ones (ns) are not shown.
_TOLD_NS = 3 * NANOSECONDS


class LivePageNode(ClockedActor[LiveParameters]):
    """Serves the page, tells it what it hears, and does what is asked for there.

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
        self._mechanism = Mechanism(self.scene)
        self._analyser = Analyser(self._mechanism, self.point)
        self._grasps = flat_grasps(self.scene)
        self._inputs = SceneInputs(self, self._mechanism)
        self._device = SceneInput(
            self, DEVICE_STATE.name, Float64MultiArray, lambda data: unpack_device(decode(data))
        )
        self._dragging = Dragging(self._mechanism, _DELAYED_S, time.monotonic())
        self._link = PageLink()
        self._commands = GraphCommands(
            self, self._mechanism, lambda why: self._link.tell(Failed(why))
        )
        self.input(DIAGNOSTICS.name, DiagnosticArray, STREAM_PUBLISHER, self._on_diagnostics)
        self._rates: dict[str, str] = {}
        self._rates_ns = 0
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

    def apply_parameters(self, parameters: LiveParameters) -> None:
        """Take new parameters."""
        super().apply_parameters(parameters)
        self._timeout_ns = nanoseconds(parameters.input_timeout)

    def activate(self) -> None:
        """Begin with what comes from now on."""
        self._inputs.forget()
        self._device.forget()
        self._dragging.grip = None

    def deactivate(self) -> None:
        """Push nothing, and listen to nobody."""
        self._dragging.grip = None
        self._commands.push(None, {}, self.now_ns())
        self._listen(False)

    def close(self) -> None:
        """Serve the page no more."""
        self._stop.set()
        self._link.close()
        self._thread.join(_END_S)
        self._page.close()

    def ready(self, deadline_ns: int) -> bool:
        """Return whether a tick can be done: always, with what there is."""
        del deadline_ns
        return True

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return where the page is, and whether anybody looks."""
        looks = "somebody looks" if self._page.looked_at else "nobody looks"
        dragged = self._dragging.grip
        figures = {
            "address": self._page.address,
            "dragged": "nothing" if dragged is None else dragged.link or HAND,
            **self.clock_figures(),
        }
        return not self._ended, self._ended or f"{self._page.address}: {looks}", figures

    def tick(self, periods: int, deadline_ns: int) -> None:
        """Do what was asked for, push what is dragged, and tell what is heard to those who look."""
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
            self._dragging.grip = None
        self._push(now)
        self._ticks += 1
        if looked_at and self._ticks % TICKS_TOLD == 0:
            self._tell(now)

    def _serve(self) -> None:
        try:
            self._page.serve(self._stop.is_set)
        except Exception as error:  # noqa: BLE001 - whatever it was: nothing is pushed any more
            if not self._stop.is_set():
                self._ended = f"the page has ended: {type(error).__name__}: {error}"
                self.node.get_logger().error(self._ended)

    def _listen(self, wanted: bool) -> None:
        self._inputs.listen(wanted)
        if wanted:
            self._device.open()
        else:
            self._device.close()

    def _do(self, command: Command, now_ns: int, clock: float) -> None:
        if isinstance(command, Drag):
            if not command.link and self._device.value(now_ns, _STALE_NS) is None:
                rule = f"is dragged where {DEVICE_STATE.name} is heard, which it is not"
                raise InvalidInputError(HAND, "no message", rule)
            self._dragging.drag_to(command, self._seen.analysis, clock)
        elif isinstance(command, Release):
            self._dragging.grip = None
        elif isinstance(command, DragStiffness):
            self._dragging.stiffen(command.factor, self._seen.analysis)
        elif isinstance(command, Tune):
            self._commands.tune(command)
        elif isinstance(command, SwitchClosure):
            self._commands.switch(command)
        elif isinstance(command, Hold):
            self._commands.hold(command, now_ns)

    def _push(self, now_ns: int) -> None:
        """Push what is dragged as it is now; nothing where that is not known."""
        on_device: Array | None = None
        on_links: dict[str, Array] = {}
        grip = self._dragging.grip
        if grip is not None:
            state = self._inputs.state(now_ns, _STALE_NS)
            device: DeviceSample | None = self._device.value(now_ns, _STALE_NS)
            if grip.link and state is not None:
                nowhere = np.zeros(3)
                on_device, on_links = self._dragging.wrenches(nowhere, nowhere, state.q, state.v)
            elif not grip.link and device is not None:
                place, twist = device.measured.pose.translation, device.measured.twist
                no_state = np.zeros(0)
                on_device, _ = self._dragging.wrenches(place, twist[:3], no_state, no_state)
        self._commands.push(on_device, on_links, now_ns)

    def _tell(self, now_ns: int) -> None:
        """Tell the page what is known now; where nothing comes any more, what was known last."""
        heard = self._inputs.now(now_ns, self._timeout_ns)
        if heard is not None:
            self._first_ns = self._first_ns or heard.state.stamp_ns
            self.ages.add(now_ns - heard.state.stamp_ns)
            try:
                if (heard.state.grasps != self._grasps).any():
                    self._follow(heard.state.grasps)
                self._seen, self._last = self._observed(heard), heard
            except HapticMechError as error:
                problem = InvalidInputError(
                    "state", heard.state.q.tolist(), f"cannot be drawn: {error}"
                )
                self.node.refuse(STATE.name, problem)
                return
        self._link.tell(self._dragging.on(self._state(self._last, heard is not None, now_ns)))

    def _state(self, known: Heard, fresh: bool, now_ns: int) -> LiveState:
        state, seen = known.state, self._seen
        pose = seen.point.pose if known.device is None else known.device
        count = known.count
        if count is None:
            count = rigid_count(seen.s, self.scene.perception)
        return LiveState(
            number=self._number,
            time=(state.stamp_ns - (self._first_ns or state.stamp_ns)) / NANOSECONDS,
            paused=False,
            factor=self._factor(state.stamp_ns, now_ns),
            q=state.q,
            active=state.active,
            observation=seen.numbers,
            count=count,
            device=np.column_stack((pose.rotation, pose.translation)),
            hand_wrench=_or_none(known.hand_wrench),
            on_hand=_or_none(known.device_command),
            on_mechanism=_or_none(known.point_commands.get(self.point)),
            contact=state.contacts[self._analyser.index],
            changed=tuple(f"{key}={value:g}" for key, value in self._commands.changed.items()),
            told=self._said_of_rate(now_ns) if fresh else f"nothing on {STATE.name}",
        )

    def _factor(self, stamp_ns: int, now_ns: int) -> float:
        """Return how much the mechanism's time has gone on over this node's, in the last second."""
        times = self._times
        times.append((now_ns, stamp_ns))
        while len(times) > 2 and now_ns - times[1][0] >= NANOSECONDS:
            times.popleft()
        (began, first), (ended, last) = times[0], times[-1]
        return (last - first) / (ended - began) if ended > began else 0.0

    def _observed(self, heard: Heard) -> Observation:
        state = heard.state
        return self._analyser.observe(state.q, state.v, state.active)

    def _at_the_start(self) -> Heard:
        """Return what is drawn before anything is heard."""
        mechanism = self._mechanism
        q, v = consistent_initial_state(mechanism)
        points = len(mechanism.point_names)
        state = WireState(
            0,
            mechanism.initially_active,
            q,
            v,
            np.zeros((points, 6)),
            self._grasps,
            (False,) * points,
        )
        return Heard(state, None, None, None, {}, None)

    def _follow(self, grasps: Array) -> None:
        """Draw operational points where the mechanism says that they are from now on."""
        mechanism = self._mechanism
        for name, numbers in zip(mechanism.point_names, grasps, strict=True):
            mechanism.set_operational_point(grasp_of(mechanism.scene, name, numbers))
        self._analyser = Analyser(mechanism, self.point)
        self._grasps = grasps
        self._dragging.grip = None
        self._open()

    def _open(self) -> None:
        self._number += 1
        scene = self._mechanism.scene
        self._link.tell(Opened(self._number, Open(self.parameters.scene), scene, self.point))
        # At once, for the page to have its view before anybody opens it.
        self._link.tell(self._state(self._last, False, self.now_ns()))

    def _on_diagnostics(self, message: DiagnosticArray, now_ns: int) -> None:
        wanted = self.node.resolve_topic_name(DEVICE).lstrip("/")
        for status in message.status:
            if status.name == wanted:
                self._rates = {pair.key: pair.value for pair in status.values}
                self._rates_ns = now_ns

    def _said_of_rate(self, now_ns: int) -> str:
        if now_ns - self._rates_ns > _TOLD_NS:
            return f"nothing of {DEVICE} on {DIAGNOSTICS.name}"
        rate, missed = (self._rates.get(k, "-") for k in ("achieved_rate_hz", "missed_deadlines"))
        return f"{DEVICE} {rate} Hz, {missed} deadlines missed"


def _or_none(wrench: Array | None) -> Array:
    """Return a wrench, or no wrench where none is heard."""
    return np.zeros(6) if wrench is None else wrench
