# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What graph tests share: a domain of their own, processes that always end, waits that time out."""

from __future__ import annotations

import itertools
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import QoSProfile
from rclpy.task import Future

from hapticmech_ros.graph.processes import (
    _end_with_parent,
    private_environment,
    ros_arguments,
    stop_process,
)
from hapticmech_ros.loading.loader import copy_scene
from hapticmech_ros.nodes.entry import NODES
from ros.forked import start

RELIABLE = QoSProfile(depth=1000)
WAIT_S = 20.0
# Hz, of graphs whose rate is not what is tested: a machine of half the speed keeps it.
RATE = 250.0
LOOK_S = 0.002
# The graph without its device.
OTHERS = ",".join(name for name in NODES if name != "haptic_device")
_counter = itertools.count()


def next_domain() -> int:
    """Return a domain id that no test uses at the same time: 1 to 100 are safe on Linux.

    Each of two processes that share a run comes back to one after 50 tests.
    """
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:])
    each = 100 // int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    return 1 + each * worker + (os.getpid() + next(_counter)) % each


class Statuses(dict[str, Any]):
    """The last status of every node, by name."""

    def keep(self, message: DiagnosticArray) -> None:
        """Take what is told."""
        self.update({status.name: status for status in message.status})

    def sentence(self, node: str) -> str:
        """Return what a node says of itself; nothing before it has."""
        return self[node].message if node in self else ""

    def figure(self, node: str, key: str) -> str:
        """Return a figure of a node; nothing before it has told one."""
        return figures(self[node]).get(key, "") if node in self else ""

    def count(self, node: str, key: str) -> int:
        """Return a figure that is a number; 0 before it is told."""
        return int(self.figure(node, key) or 0)

    def well(self, *nodes: str) -> bool:
        """Return whether all these nodes have said that all is well."""
        return all(node in self and self[node].level == DiagnosticStatus.OK for node in nodes)


class Peer:
    """A node of the test's own: publishes, listens, and waits for conditions."""

    def __init__(self, domain: int) -> None:
        os.environ.update(private_environment(domain))
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node("peer", context=self.context)
        self.executor = EventsExecutor(context=self.context)
        self.executor.add_node(self.node)
        self._never = Future()
        self._clients: dict[str, Any] = {}

    def listen(self, topic: str, kind: Any, qos: QoSProfile = RELIABLE) -> list[Any]:
        """Return a list that grows by every message."""
        messages: list[Any] = []
        self.node.create_subscription(kind, topic, messages.append, qos)
        return messages

    def publisher(self, topic: str, kind: Any, qos: QoSProfile = RELIABLE) -> Any:
        """Return a publisher that has met a subscriber."""
        publisher = self.node.create_publisher(kind, topic, qos)
        self.until(lambda: publisher.get_subscription_count() > 0, f"a subscriber of {topic}")
        return publisher

    def run(self, duration: float) -> None:
        """Handle messages for a while."""
        end = time.monotonic() + duration
        while (left := end - time.monotonic()) > 0.0:
            self.executor.spin_until_future_complete(self._never, timeout_sec=min(left, 0.05))

    def until(
        self,
        condition: Callable[[], object],
        what: str,
        timeout: float = WAIT_S,
        doing: Callable[[], object] = lambda: None,
    ) -> None:
        """Handle messages until the condition holds; before each look at it do something.

        It is looked at when a message has come, but not more often than messages may be sent
        meanwhile, nor, up to 10 ms, for more than half of the time.
        """
        end = time.monotonic() + timeout
        while True:
            begun = time.monotonic()
            doing()
            if condition():
                return
            looked = time.monotonic()
            if looked > end:
                raise TimeoutError(f"waited {timeout:g} s in vain for {what}")
            again = looked + min(max(looked - begun, LOOK_S), 0.01)
            self.executor.spin_once(timeout_sec=0.01)
            while (left := again - time.monotonic()) > 0.0:
                self.executor.spin_once(timeout_sec=left)

    def statuses(self) -> Statuses:
        """Return a mapping that always holds the last status of every node, by name."""
        found = Statuses()
        self.node.create_subscription(DiagnosticArray, "/diagnostics", found.keep, RELIABLE)
        return found

    def client(self, kind: Any, name: str) -> Any:
        """Return the client of a service, which is there."""
        client = self._clients.get(name)
        if client is None:
            client = self._clients[name] = self.node.create_client(kind, name)
        self.until(client.service_is_ready, f"the service {name}")
        return client

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """Return a service's response."""
        answer = self.client(kind, name).call_async(request)
        self.until(answer.done, f"an answer of {name}")
        return answer.result()

    def state_of(self, node: str) -> str:
        """Return the lifecycle state of a node: ``unconfigured``, ``inactive``, ``active``..."""
        return str(self.call(GetState, f"{node}/get_state", GetState.Request()).current_state.label)

    def transition(self, node: str, *names: str) -> bool:
        """Take a node through transitions such as ``configure``; return whether all succeeded."""
        for name in names:
            step = Transition(id=getattr(Transition, f"TRANSITION_{name.upper()}"))
            request = ChangeState.Request(transition=step)
            if not self.call(ChangeState, f"{node}/change_state", request).success:
                return False
        return True

    def set_parameters(self, node: str, **values: object) -> SetParametersResult:
        """Set parameters of a node one by one; return the first refusal, or the last result."""
        request = SetParameters.Request(parameters=_parameters(values))
        results = self.call(SetParameters, f"{node}/set_parameters", request).results
        return next((result for result in results if not result.successful), results[-1])

    def set_atomically(self, node: str, **values: object) -> SetParametersResult:
        """Set parameters of a node all at once, or none."""
        request = SetParametersAtomically.Request(parameters=_parameters(values))
        name = f"{node}/set_parameters_atomically"
        return self.call(SetParametersAtomically, name, request).result

    def parameters_of(self, node: str, *names: str) -> list[Any]:
        """Return values of parameters of a node."""
        request = GetParameters.Request(names=list(names))
        values = self.call(GetParameters, f"{node}/get_parameters", request).values
        return [parameter_value_to_python(value) for value in values]

    def now(self) -> Any:
        """Return the present time as a message stamp."""
        return self.node.get_clock().now().to_msg()

    def wrench(self, *values: float, frame: str = "world") -> WrenchStamped:
        """Return a wrench stamped now."""
        message = unstamped(*values, frame=frame)
        message.header.stamp = self.now()
        return message

    def twist(self, *values: float, frame: str = "world") -> TwistStamped:
        """Return a twist stamped now."""
        message = self._stamped(TwistStamped, frame)
        _fill(message.twist.linear, message.twist.angular, values)
        return message

    def pose(
        self, x: float = 0.0, y: float = 0.0, w: float = 1.0, z: float = 0.0, frame: str = "world"
    ) -> PoseStamped:
        """Return a pose stamped now, turned about z by the quaternion (0, 0, z, w)."""
        message = self._stamped(PoseStamped, frame)
        message.pose.position.x, message.pose.position.y = x, y
        message.pose.orientation.w, message.pose.orientation.z = w, z
        return message

    def _stamped(self, kind: Any, frame: str) -> Any:
        message = kind()
        message.header.frame_id, message.header.stamp = frame, self.now()
        return message

    def until_more(self, messages: Sequence[Any], number: int, what: str) -> None:
        """Handle messages until more than so many more have come."""
        before = len(messages)
        self.until(lambda: len(messages) > before + number, what)

    def close(self) -> None:
        """Leave the graph."""
        self.node.destroy_node()
        self.context.try_shutdown()


def refuses(peer: Peer, statuses: Statuses, node: str, publisher: Any, message: Any) -> None:
    """Publish a message until the node's diagnostics count a refusal that was not there before.

    Needs a short ``diagnostics_period``.
    """
    peer.until(lambda: node in statuses, f"diagnostics of {node}")
    peer.run(0.1)
    before = statuses.count(node, "refused_messages")
    peer.until(
        lambda: statuses.count(node, "refused_messages") > before,
        f"a refusal of {message}",
        doing=lambda: publisher.publish(message),
    )


def unstamped(*values: float, frame: str = "world") -> WrenchStamped:
    """Return a wrench without a stamp, as CRTK allows."""
    message = WrenchStamped()
    message.header.frame_id = frame
    _fill(message.wrench.force, message.wrench.torque, values)
    return message


def figures(status: Any) -> dict[str, str]:
    """Return the key-value pairs of a status."""
    return {pair.key: pair.value for pair in status.values}


def six(wrench_or_twist: Any) -> list[float]:
    """Return the six numbers of a wrench or twist message."""
    body = getattr(wrench_or_twist, "wrench", None)
    if body is not None:
        parts: Sequence[Any] = (body.force, body.torque)
    else:
        parts = (wrench_or_twist.twist.linear, wrench_or_twist.twist.angular)
    return [value for part in parts for value in (part.x, part.y, part.z)]


def scene_like(folder: Path, scene: str, *changes: str, **parts: object) -> str:
    """Return a file with a shipped scene of which some keys are set, and whole parts."""
    path = folder / f"{scene}_{next(_counter)}.yaml"
    copy_scene(scene, path, [*changes, *(f"{key}={json.dumps(parts[key])}" for key in parts)])
    return str(path)


def allowing(folder: Path, **safety: float) -> str:
    """Return a scene like the five-bar whose device may be set to less safe values."""
    changes = [f"device.safety.{name}={value}" for name, value in safety.items()]
    return scene_like(folder, "five_bar", *changes)


def refused(peer: Peer, node: str, words: Sequence[str], **values: object) -> None:
    """Set parameters of a node, which refuses one of them, in all these words."""
    result = peer.set_parameters(node, **values)
    assert not result.successful
    assert all(word in result.reason for word in words), result.reason


@contextmanager
def program(
    domain: int, *command: str | Path, environment: Mapping[str, str] | None = None, **options: Any
) -> Iterator[subprocess.Popen[str]]:
    """Run a program, as a user starts it, that ends with the block.

    Args:
        domain: that it is in.
        command: program and arguments.
        environment: of it, besides.
        options: of ``subprocess.Popen``.
    """
    given = private_environment(domain) | dict(environment or {})
    process = subprocess.Popen(
        list(map(str, command)), env=given, text=True, preexec_fn=_end_with_parent, **options
    )
    try:
        yield process
    finally:
        stop_process(process)
        if process.stdout is not None:
            process.stdout.close()


@contextmanager
def running(
    name: str,
    domain: int,
    scene: str = "five_bar",
    remaps: Mapping[str, str] | None = None,
    arguments: Sequence[str] = (),
    **parameters: object,
) -> Iterator[subprocess.Popen[str]]:
    """Run one node, or several joined by commas, in a process that ends with the block.

    At :data:`RATE` unless ``control_rate`` is given (0: the scene's), or it advances by messages.
    """
    rate = {} if parameters.get("lockstep") else {"control_rate": RATE}
    given = ros_arguments({"scene": scene, **rate, **parameters})
    for old, new in (remaps or {}).items():
        given += ["-r", f"{old}:={new}"]
    command = [sys.executable, "-m", "hapticmech_ros.nodes.entry", name, *given, *arguments]
    process = start(command, private_environment(domain))
    try:
        yield process
    finally:
        stop_process(process)


def child_of(parent: int, name: bytes) -> int:
    """Return a child whose command has a name, 0 if there is none."""
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    for pid in map(int, children):
        try:
            command = Path(f"/proc/{pid}/cmdline").read_bytes()
            alive = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
        except FileNotFoundError:
            continue
        if alive and name in command.split(b"\0"):
            return pid
    return 0


def _parameters(values: Mapping[str, object]) -> list[Any]:
    return [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]


def _fill(first: Any, second: Any, values: Sequence[float]) -> None:
    first.x, first.y, first.z, second.x, second.y, second.z = values
