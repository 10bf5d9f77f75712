# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The same messages on the wire: as bytes, through the middleware, to a graph of real processes.

Once on all topics. Most have an owner, and the device is at zero while there are two publishers: so
once more on those that have none, while the graph renders.
"""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from functools import partial
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.experimental import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from std_msgs.msg import Float64MultiArray

from benchmarks.children import BenchError, output_to, wait_until
from benchmarks.reliability.caller import Stranger
from benchmarks.reliability.figure import Figure, figures_of
from benchmarks.reliability.free_topics import free_topics, gentler
from benchmarks.reliability.hostile import Hostile
from benchmarks.reliability.memory_growth import MemoryGrowth, worst_growth
from benchmarks.reliability.outputs import Outputs
from benchmarks.reliability.usage import resident
from hapticmech_ros.graph.processes import Graph, private_environment
from hapticmech_ros.loading import load_scene
from hapticmech_ros.nodes.loop import wait_for_messages
from hapticmech_ros.nodes.messages import LATCHED
from hapticmech_ros.wire.topics import CONTROLLER, DEVICE

SCENE, POINT = "five_bar", "handle"
DEVICE_OUT, MECHANISM_OUT = "device/state", "mechanism/state"
POINT_MODEL_OUT, GAIN_OUT = f"analysis/{POINT}/operational_model", "device/local_feedback_gain"
COMMANDS = ("device/servo_cf", f"mechanism/{POINT}/servo_cf")
CRTK = {
    "device/measured_cp": PoseStamped,
    "device/measured_cv": TwistStamped,
    "device/measured_cf": WrenchStamped,
    "device/hand/measured_cf": WrenchStamped,
}
# Who has to be well for the graph to render. The mechanism goes on telling of energy that it lost.
RENDERING = (DEVICE, CONTROLLER)
# So many at once, and then a pause in which they are read: subscribers keep one message each.
AT_ONCE, PAUSE_S = 14, 0.005
# Without an owner fewer, and pushes of 1.5 times what the device can give, so that it goes on
# rendering; but one in so many of any size, which may tear the hand away.
FREE_AT_ONCE, GENTLE, WILD_EVERY = 4, (30.0, 1.5), 500
STARTS_WITHIN_S, BACK_WITHIN_S, HANG_S = 30.0, 10.0, 5.0
RECOVERS_S = 2.0
# Refused in a second, at least: a run ends without its messages if there are fewer.
RATE, FREE_RATE = 100.0, 30.0
# Topics of the control rate that it listens to.
LISTENED = 6
SENT_RELIABLY = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
# One that is lost does not keep back those after it until the publisher's heartbeat, 3 s later: it
# would be the middleware that is silent.
AS_THEY_COME = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
SEED = 20270
# Types of parameters from this number on there are not.
NO_TYPE, TYPE_NUMBERS = 10, 256
ASKED = ("view_rate", "scene", "use_sim_time", "nobody's", "")


def run_wire(count: int, out: Path, free: bool = False) -> list[Figure]:
    """Send until so many were refused by the nodes they were for, which is how we know of them.

    Args:
        count: messages.
        out: folder for what nodes said.
        free: only on topics that have no owner, while the graph renders.
    """
    name = "messages_on_free_topics" if free else "messages_on_the_wire"
    environment = private_environment()
    os.environ.update(environment)
    # A machine that is busy with all this pauses now and then.
    parameters = {
        "diagnostics_period": 0.1,
        "view_rate": 50.0,
        "haptic_device.command_timeout": 0.05,
        "teleoperation_controller.input_timeout": 0.05,
    }
    with (
        output_to(out / f"{name}.log"),
        Graph(SCENE, False, "", parameters) as graph,
        closing(Attack(graph, environment, free)) as attack,
    ):
        attack.wait(attack.renders, STARTS_WITHIN_S, "the graph to render")
        attack.run(count)
    notes = [f"{name}: {text}" for name, text in sorted(attack.told.items())]
    (out / f"{name}.txt").write_text("\n".join(notes), "utf-8")
    return attack.figures(count)


class Attack(Stranger):
    """A stranger in the graph: sends what nobody should send, and listens to what comes of it.

    Args:
        graph: of real processes.
        environment: of these.
        free: only on topics that have no owner.
    """

    def __init__(self, graph: Graph, environment: dict[str, str], free: bool = False) -> None:
        self._graph = graph
        self._free = free
        self._where = "on topics without owner" if free else "on the wire"
        super().__init__("stranger", environment, EventsExecutor)
        scene = load_scene(SCENE)
        self.seen = Outputs(scene.device)
        links = [link.name for link in scene.links]
        self._hostile = Hostile(SEED, [POINT, *links, "device", f"{POINT}_world"])
        self.sent = 0
        self.silence_s = 0.0
        self.memory = {name: MemoryGrowth() for name in graph.processes}
        self.ended: list[str] = []
        self.told: dict[str, str] = {}
        # By node: when it was heard last, s; whether it is well; how many messages it has refused.
        self._said: dict[str, tuple[float, bool, int]] = {}
        self._samples: dict[str, bytes] = {}
        received: dict[str, Any] = {
            **dict.fromkeys(
                (DEVICE_OUT, MECHANISM_OUT, POINT_MODEL_OUT, GAIN_OUT), Float64MultiArray
            ),
            **dict.fromkeys(COMMANDS, WrenchStamped),
        }
        self._kinds = free_topics(scene, "stranger")
        if not free:
            self._kinds |= {**received, **CRTK}
        self._own: set[bytes] = set()
        for topic, kind in received.items():
            self._listen(topic, kind)
        self.node.create_subscription(
            DiagnosticArray, "/diagnostics", self._on_status, AS_THEY_COME
        )
        self._clients = [
            self.node.create_client(SetParameters, f"{name}/set_parameters")
            for name in graph.processes
        ]
        self._asked: list[Future | None] = [None] * len(self._clients)
        self._spin = partial(wait_for_messages, self.executor)
        self.requests = self.answered = 0
        self._grasped: list[PoseStamped] = []
        grasped = f"mechanism/{POINT}/operational_point"
        self.node.create_subscription(PoseStamped, grasped, self._grasped.append, LATCHED)

    @property
    def refused(self) -> int:
        """How many messages nodes have refused."""
        return sum(refused for _, _, refused in self._said.values())

    def renders(self) -> bool:
        """Return whether every node says that all is well."""
        return len(self._said) >= 4 and all(well for _, well, _ in self._said.values())

    def wait(self, condition: Callable[[], object], timeout_s: float, what: str) -> None:
        """Handle messages until a condition holds.

        Raises:
            BenchError: it does not.
        """
        wait_until(condition, timeout_s, what, lambda: self._spin(0.02), look_again_s=0.0)

    def run(self, count: int) -> None:
        """Send until so many were refused; then be silent, and see whether the graph comes back."""
        self.wait(lambda: len(self._samples) == LISTENED, STARTS_WITHIN_S, "all topics' messages")
        publishers = [
            (topic, kind, self.node.create_publisher(kind, topic, SENT_RELIABLY))
            for topic, kind in self._kinds.items()
        ]
        self._spin(1.0)
        end = time.monotonic() + max(60.0, count / (FREE_RATE if self._free else RATE))
        while self.refused < count and not self._graph.ended() and time.monotonic() < end:
            for _ in range(FREE_AT_ONCE if self._free else AT_ONCE):
                topic, kind, publisher = publishers[self._hostile.index(len(publishers))]
                sample = self._samples.get(topic, b"")
                message = self._hostile.message(kind, sample, time.time_ns())
                if self._free and self.sent % WILD_EVERY:
                    message = gentler(kind, message, *GENTLE)
                self._own.add(_known(message))
                try:
                    publisher.publish(message)
                except rclpy_implementation.RCLError:
                    # Readers without a processor: a reliable publisher takes no more for a while.
                    continue
                self.sent += 1
            self._ask()
            self._spin(PAUSE_S)
            silences = (time.monotonic() - heard_s for heard_s, _, _ in self._said.values())
            self.silence_s = max(self.silence_s, *silences, 0.0)
            for name, process in self._graph.processes.items():
                if self.memory[name].due(self.sent, count):
                    self.memory[name].add(self.sent, resident(process.pid))
        self._undo(publishers)
        for _, _, publisher in publishers:
            self.node.destroy_publisher(publisher)
        self._spin(RECOVERS_S)
        with suppress(BenchError):
            self.wait(
                lambda: all(one is None or one.done() for one in self._asked),
                BACK_WITHIN_S,
                "answers to the last requests",
            )
        with suppress(BenchError):
            self.wait(self._is_back, BACK_WITHIN_S, "the graph's return")
        if self.seen.examples:
            self.told["wrong"] = "; ".join(self.seen.examples)
        self.ended = self._graph.ended()
        for name in self.ended:
            self.told[f"ended: {name}"] = f"exit code {self._graph.processes[name].poll()}"

    def figures(self, count: int) -> list[Figure]:
        """Return what was found."""
        figure = figures_of(self._where, self.sent)
        warning = sorted(name for name, (_, well, _) in self._said.items() if not well)
        note = "as counted by the nodes that refused them; more were taken"
        return [
            figure("messages delivered", self.refused, least=count, note=note),
            figure("processes that ended", len(self.ended), most=0.0),
            figure("longest silence of a node", self.silence_s, "s", most=HANG_S),
            figure("requests without a refusal", self.requests - self.answered, most=0.0),
            figure("outputs not finite", self.seen.not_finite, most=0.0),
            *self.seen.figures(self._where, renders=self._free),
            figure("graphs that did not come back", int(not self._is_back()), most=0.0),
            figure(
                "nodes that still warn",
                len(warning),
                trials=len(self._said),
                note=", ".join(warning),
            ),
            worst_growth(self._where, list(self.memory.values()), self.sent),
            figure("outputs looked at", self.seen.messages),
        ]

    def _is_back(self) -> bool:
        # Device and controller: what others warn of may last.
        return all(name in self._said and self._said[name][1] for name in RENDERING)

    def _ask(self) -> None:
        """Ask a node for parameters of types that there are not, unless it has yet to answer."""
        which = self._hostile.index(len(self._clients))
        before, client = self._asked[which], self._clients[which]
        if not client.service_is_ready() or (before is not None and not before.done()):
            return
        kind = NO_TYPE + self._hostile.index(TYPE_NUMBERS - NO_TYPE)
        parameters = [Parameter(name=name, value=ParameterValue(type=kind)) for name in ASKED]
        asked = client.call_async(SetParameters.Request(parameters=parameters))
        self._asked[which] = asked
        self.requests += 1
        asked.add_done_callback(self._on_answer)

    def _on_answer(self, answer: Future) -> None:
        results = answer.result().results
        self.answered += len(results) == len(ASKED) and not any(one.successful for one in results)

    def _listen(self, topic: str, kind: Any) -> None:
        """Look at what nodes send, not at what this one does."""

        def received(message: bytes) -> None:
            if _known(message) in self._own:
                return
            self._samples.setdefault(topic, message)
            self.seen.look(topic, kind, message)

        self.node.create_subscription(kind, topic, received, SENT_RELIABLY, raw=True)

    def _on_status(self, message: DiagnosticArray) -> None:
        for status in message.status:
            figures = {pair.key: pair.value for pair in status.values}
            well, refused = status.level == DiagnosticStatus.OK, figures.get("refused_messages", 0)
            self._said[status.name] = time.monotonic(), well, int(refused)
            keys = ("refused_messages", "last_refusal", "failures", "last_failure")
            told = ", ".join(f"{key} {figures.get(key, '')}" for key in keys)
            self.told[status.name] = f"{status.message}; {told}"

    def _undo(self, publishers: Sequence[tuple[str, Any, Any]]) -> None:
        """Let go of what is held for ever, and put the point that is held where it was."""
        zero = WrenchStamped()
        zero.header.frame_id = "world"
        for topic, _, publisher in publishers:
            if "/persistent" in topic:
                publisher.publish(zero)
            elif topic.endswith("/set_operational_point") and self._grasped:
                publisher.publish(self._grasped[0])
        self._spin(0.5)


def _known(message: bytes) -> bytes:
    """Return a digest of what the middleware leaves as it is of a message, filled up as it does."""
    kept = message[4:].ljust(-(-len(message) // 4) * 4 - 4, b"\0")
    return hashlib.blake2b(kept, digest_size=16).digest()
