# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The graph as a CRTK client sees it, who knows the convention and nothing of this package."""

from __future__ import annotations

import importlib
import itertools
import os
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from subprocess import Popen
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from hapticmech_ros.wire.topics import TOPICS
from ros.crtk_messages import build
from ros.harness import WAIT_S, Peer, Statuses, figures, running, six, unstamped

# Of the convention: what a verb's last two letters say of its payload.
CRTK_TYPES = {
    "cp": "geometry_msgs/msg/PoseStamped",
    "cv": "geometry_msgs/msg/TwistStamped",
    "cf": "geometry_msgs/msg/WrenchStamped",
    "js": "sensor_msgs/msg/JointState",
    "jp": "sensor_msgs/msg/JointState",
    "jv": "sensor_msgs/msg/JointState",
    "jf": "sensor_msgs/msg/JointState",
}
CRTK_NAME = re.compile(r"(?:measured|setpoint|servo|interpolate|move|goal)_([cj][pvfs])")
ACTORS = {"device": "haptic_device", "mechanism/handle": "mechanism_simulator"}
EVERY = [pytest.param(namespace, node, id=node) for namespace, node in ACTORS.items()]
# Samples under a command, of which powers are compared.
ENOUGH = 20
TURNING = (0.03, 0.02, 0.01, 0.001, 0.002, 0.003)


def _qos(reliability: ReliabilityPolicy) -> QoSProfile:
    return QoSProfile(depth=100, history=HistoryPolicy.KEEP_LAST, reliability=reliability)


RELIABLE = _qos(ReliabilityPolicy.RELIABLE)
BEST_EFFORT = _qos(ReliabilityPolicy.BEST_EFFORT)


class CrtkClient:
    """Measurements of one actor, and a wrench for it.

    Args:
        peer: who asks.
        namespace: of the actor, such as an arm's name.
        qos: of all topics.
    """

    def __init__(self, peer: Peer, namespace: str, qos: QoSProfile) -> None:
        self._peer = peer
        node = peer.node
        self.measured_cp: list[PoseStamped] = []
        self.measured_cv: list[TwistStamped] = []
        self.measured_cf: list[WrenchStamped] = []
        self.measured_js: list[JointState] = []
        for kind, name in (
            (PoseStamped, "measured_cp"),
            (TwistStamped, "measured_cv"),
            (WrenchStamped, "measured_cf"),
            (JointState, "measured_js"),
        ):
            received = getattr(self, name)
            node.create_subscription(kind, f"{namespace}/{name}", received.append, qos)
        self._servo_cf = node.create_publisher(WrenchStamped, f"{namespace}/servo_cf", qos)

    @property
    def measured(self) -> tuple[list[Any], ...]:
        """Return all that was measured."""
        return self.measured_cp, self.measured_cv, self.measured_cf, self.measured_js

    def servo_cf(self, *wrench: float, frame: str = "world") -> None:
        """Command a wrench; stamps of commands are free in CRTK."""
        self._servo_cf.publish(unstamped(*wrench, frame=frame))

    def resist(self) -> None:
        """Command viscous friction, until it has slowed the actor down along its way."""
        start = np.array(six(self.measured_cv[-1]))[:3]

        self._peer.until(
            lambda: start @ six(self.measured_cv[-1])[:3] < 0.5 * start @ start,
            "the actor to be slowed down",
            doing=lambda: self.servo_cf(
                *(-3.0 * value for value in six(self.measured_cv[-1])[:3]), 0.0, 0.0, 0.0
            ),
        )

    def push(self, speed: float, *wrench: float, frame: str = "world") -> None:
        """Command a wrench until the actor moves faster along it than before."""
        direction = np.array(wrench) / np.linalg.norm(wrench)

        def along() -> float:
            return float(direction @ six(self.measured_cv[-1])) if self.measured_cv else 0.0

        self._peer.until(lambda: self.measured_cv, "a twist")
        start = along()

        self._peer.until(
            lambda: along() > start + speed,
            f"the actor to follow {wrench}",
            10.0,
            doing=lambda: self.servo_cf(*wrench, frame=frame),
        )


def actor(node: str, domain: int, **given: object) -> AbstractContextManager[Popen[str]]:
    """Run an actor of a spatial arm; nobody but the client holds a device."""
    hand = {"hand": "commanded"} if node == "haptic_device" else {}
    return running(node, domain, "spatial_arm", **hand, **given)


@pytest.mark.parametrize(("namespace", "node"), EVERY)
def test_a_crtk_client_moves_an_actor_and_understands_it(
    domain: int, peer: Peer, namespace: str, node: str
) -> None:
    client = CrtkClient(peer, namespace, RELIABLE)
    with actor(node, domain, view_rate=500.0):
        client.push(0.01, *TURNING)
        setpoints = peer.listen(f"{namespace}/setpoint_cf", WrenchStamped)
        back = [-2.0 * value for value in TURNING]
        client.push(0.01, *back)

        def enough() -> bool:
            given = sum(any(six(message)) for message in setpoints)
            return min(map(len, client.measured)) > 20 and (
                node != "haptic_device" or given > ENOUGH
            )

        peer.until(enough, "samples under the command", doing=lambda: client.servo_cf(*back))
    poses, twists, forces, joints = client.measured
    for message in (*poses, *twists, *forces, *joints):
        assert message.header.frame_id == "world"
    for stream in client.measured:
        stamps = [_time(message) for message in stream]
        assert stamps == sorted(set(stamps))
        now = peer.node.get_clock().now().nanoseconds * 1e-9
        assert now - 60.0 < stamps[0] < stamps[-1] < now + 1.0
    # What belongs to one sample has one stamp.
    assert len({_time(m) for m in poses} & {_time(m) for m in joints}) > 20
    names = list(joints[0].name)
    assert len(names) == len(set(names)) > 0
    for joint in joints:
        assert list(joint.name) == names
        assert len(joint.position) == len(joint.velocity) == len(names)
        assert len(joint.effort) in (0, len(names))
        assert np.isfinite([*joint.position, *joint.velocity, *joint.effort]).all()
    _check_rates(poses, twists)
    slips = [
        np.subtract(after.position, before.position) / (_time(after) - _time(before))
        - np.add(after.velocity, before.velocity) / 2.0
        for before, after in itertools.pairwise(joints)
    ]
    speed = np.abs([m.velocity for m in joints]).max()
    assert np.median(np.abs(slips).max(axis=1)) < 0.02 * speed
    if node == "haptic_device":
        _check_powers(setpoints, twists, joints)


@pytest.mark.parametrize(("namespace", "node"), EVERY)
def test_reliable_and_best_effort_peers_both_get_through(
    domain: int, peer: Peer, namespace: str, node: str
) -> None:
    clients = [CrtkClient(peer, namespace, qos) for qos in (RELIABLE, BEST_EFFORT)]
    with actor(node, domain):
        for client in clients:
            # CRTK: stamp and frame of servo commands are recommended, not used, and may be left
            # empty; its own clients leave them so.
            client.push(0.005, *TURNING, frame="")
            peer.until(lambda client=client: min(map(len, client.measured)) > 5, "measurements")


class StateClient:
    """An actor's state as CRTK's Python client asks for it: ``enable(30)``, ``home(30)``.

    It subscribes without what was latched, latches its commands, and after each waits for a message
    that says what it asked for, unless it knows it already.

    Args:
        peer: who asks.
        namespace: of the actor.
        kinds: of state and command.
    """

    def __init__(self, peer: Peer, namespace: str, kinds: tuple[Any, Any]) -> None:
        self._peer, (state, self._kind) = peer, kinds
        self.received = peer.listen(f"{namespace}/operating_state", state, RELIABLE)
        latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        # As its check_connections does.
        self._commands = peer.publisher(f"{namespace}/state_command", self._kind, latched)
        there = peer.node.count_publishers
        peer.until(lambda: there(f"{namespace}/operating_state") > 0, "an operating state")

    @property
    def state(self) -> str:
        """The last state that was heard."""
        return (
            "" if not self.received else getattr(self.received[-1], FIELDS[type(self.received[-1])])
        )

    def command(self, word: str, state: str) -> None:
        """Ask for a state, and wait until it is told."""
        message = self._kind()
        setattr(message, FIELDS.get(self._kind, "string"), word)
        before = len(self.received)
        known = self.state == state
        self._commands.publish(message)
        self._peer.until(
            lambda: known or (len(self.received) > before and self.state == state),
            f"{state} after {word}",
        )


FIELDS: dict[Any, str] = {String: "data"}


@pytest.fixture(scope="session")
def crtk_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ``crtk_msgs`` in it."""
    if shutil.which("g++") is None:
        pytest.skip("no C++ compiler")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AMENT_PREFIX_PATH", sys.prefix)
        return build(tmp_path_factory.mktemp("crtk"))


@pytest.fixture(params=["std_msgs", "crtk_msgs"])
def state_kinds(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[Any, Any]]:
    """Types of state and command, which nodes that are started here have too."""
    if request.param == "std_msgs":
        yield String, String
        return
    folder = request.getfixturevalue("crtk_folder")
    monkeypatch.syspath_prepend(folder)
    search = os.environ.get("PYTHONPATH", "")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(folder), search]).rstrip(os.pathsep))
    messages = importlib.import_module("crtk_msgs.msg")
    FIELDS[messages.OperatingState] = "state"
    yield messages.OperatingState, messages.StringStamped
    for name in [name for name in sys.modules if name.split(".")[0] == "crtk_msgs"]:
        del sys.modules[name]


@pytest.mark.parametrize(("namespace", "node"), EVERY)
def test_a_client_enables_reads_renders_pauses_and_disables(
    domain: int,
    peer: Peer,
    statuses: Statuses,
    namespace: str,
    node: str,
    state_kinds: tuple[Any, Any],
) -> None:
    """As the scripts of CRTK's own client do, in its types: with a mechanism that runs already."""
    motion = CrtkClient(peer, namespace, RELIABLE)
    waits = node == "haptic_device"
    with actor(node, domain, diagnostics_period=0.1, autostart=not waits):
        assert not waits or peer.transition(node, "configure")
        peer.until(lambda: node in statuses, "diagnostics", 2 * WAIT_S)
        # Its state was told before this client came.
        client = StateClient(peer, namespace, state_kinds)
        client.command("enable", "ENABLED")
        motion.push(0.005, *TURNING)
        motion.resist()
        client.command("pause", "PAUSED")
        client.command("unhome", "PAUSED")
        client.command("home", "PAUSED")
        client.command("resume", "ENABLED")
        client.command("disable", "DISABLED")
        assert peer.state_of(node) == "inactive"
        read = len(motion.measured_cp)
        peer.run(0.2)
        assert len(motion.measured_cp) <= read + 1
        client.command("enable", "ENABLED")
        motion.push(0.005, *TURNING)
        statuses.clear()
        peer.until(lambda: node in statuses, "diagnostics of it")
    assert figures(statuses[node])["refused_messages"] == "0"
    if state_kinds[0] is not String:
        assert {message.is_homed for message in client.received} == {True, False}
        assert not any(message.is_busy for message in client.received)
        stamps = [_time(message) for message in client.received]
        assert stamps == sorted(stamps)
        assert stamps[0] > 0.0


def test_verbs_of_crtk_have_its_types() -> None:
    named = {topic.name: topic.type for topic in TOPICS}
    verbs = {
        name: match.group(1)
        for name in named
        if (match := CRTK_NAME.fullmatch(name.rsplit("/", 1)[-1]))
    }
    assert {"device/servo_cf", "device/measured_cp", "mechanism/{point}/measured_js"} <= set(verbs)
    assert {name: named[name] for name in verbs} == {
        name: CRTK_TYPES[payload] for name, payload in verbs.items()
    }


def _check_rates(poses: list[PoseStamped], twists: list[TwistStamped]) -> None:
    """Check that twists are the rates of poses, in the axes of the frame."""
    moving = {_time(message): np.array(six(message)) for message in twists}
    samples = [(_time(m), _pose(m), moving[_time(m)]) for m in poses if _time(m) in moving]
    slips = []
    for (t, pose, twist), (u, after, then) in itertools.pairwise(samples):
        turned = pin.log3(after.rotation @ pose.rotation.T)
        rate = np.concatenate((after.translation - pose.translation, turned)) / (u - t)
        slips.append(np.abs(rate - (twist + then) / 2.0))
    largest = np.abs([twist for _, _, twist in samples])
    # The median pair: after a stall of the machine a sample makes up for lost time. A trapezium
    # of 2 ms is off by the change of acceleration, and by what the last period holds still.
    for part in (slice(0, 3), slice(3, 6)):
        assert np.median(np.max(np.array(slips)[:, part], axis=1)) < 0.02 * largest[:, part].max()


def _check_powers(
    setpoints: list[WrenchStamped], twists: list[TwistStamped], joints: list[JointState]
) -> None:
    """Check that efforts do the work on joints that the wrench does on the body."""
    applied = {_time(m): six(m) for m in setpoints if any(six(m))}
    moving = {_time(m): six(m) for m in twists}
    pairs = [
        (np.dot(applied[t], moving[t]), np.dot(joint.effort, joint.velocity))
        for joint in joints
        if (t := _time(joint)) in applied and t in moving
    ]
    assert len(pairs) > 3
    for power, by_joints in pairs:
        # Rounding of a rotation vector's Jacobian and its inverse.
        assert by_joints == pytest.approx(power, rel=1e-9, abs=1e-12)


def _time(message: Any) -> float:
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


def _pose(message: PoseStamped) -> pin.SE3:
    p, o = message.pose.position, message.pose.orientation
    return pin.SE3(pin.Quaternion(o.w, o.x, o.y, o.z).matrix(), np.array((p.x, p.y, p.z)))
