# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Two devices on one mechanism: each engages by itself, and each feels what the other does."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from std_msgs.msg import Float64MultiArray

from hapticmech_ros import SharedSession, load_scene
from hapticmech_ros.bag.reader import BagReader
from hapticmech_ros.errors import BagError
from hapticmech_ros.experiment import compare
from hapticmech_ros.experiment.demo import record_graph
from hapticmech_ros.experiment.from_bag import HAND, read_series, shared_record_from_bag
from hapticmech_ros.experiment.from_session import run_shared_session
from hapticmech_ros.files import shared
from hapticmech_ros.graph import Graph, private_environment
from hapticmech_ros.loading.loader import copy_scene
from hapticmech_ros.lockstep import LockstepRun, replay, run_lockstep
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.scene.document import Limits
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.layouts import CouplingMatrices, CouplingWire
from hapticmech_ros.wire.messages import DeviceStateMessage
from hapticmech_ros.wire.state import StateLayout
from hapticmech_ros.wire.topics import DEVICE_STATE, users_of
from ros.harness import Peer, figures, next_domain, six

pytestmark = pytest.mark.ros
TRIO = [name for name in NODES if name != "mechanism_simulator"]


# s: seven processes at 1 kHz are more than two cores bear, and starve who listens to them.
SLOW = 0.004


def two_points(folder: Path, period: float = 0.001) -> Path:
    """Return a file with the spatial arm, whose hand (a) and elbow (b) two hands hold in place."""
    shipped = shared("config/scenes/spatial_arm.yaml")
    assert shipped is not None
    document = yaml.safe_load(shipped.read_text(encoding="utf-8"))
    document["operational_points"] = [
        {"name": "a", "link": "hand", "origin": {"xyz": [0, 0, 0.06]}},
        {"name": "b", "link": "upper_arm", "origin": {"xyz": [0, 0, 0.2]}},
    ]
    document["simulation"] = {"period": period}
    document.setdefault("device", {})["safety"] = {"command_timeout": 0.2}
    # Hands that let go would leave the devices to drift, in the end against their end stops.
    document["hand"] = {
        "kind": "spring_damper",
        "stiffness": 100.0,
        "damping": 5.0,
        "angular_stiffness": 1.0,
        "angular_damping": 0.01,
        "waypoints": [{"time": 0.0}],
    }
    path = folder / "two_points.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


@pytest.mark.alone
def test_two_devices_feel_each_other(domain: int, peer: Peer, tmp_path: Path) -> None:
    statuses = peer.statuses()
    commands = {name: peer.listen(f"{name}/device/servo_cf", WrenchStamped) for name in "ab"}
    stray = peer.listen("device/servo_cf", WrenchStamped)
    environment = private_environment(domain)
    # Five nodes more than usual on one machine: patient with each other's messages.
    patient = {
        "teleoperation_controller.input_timeout": 0.2,
        "haptic_device.command_timeout": 0.2,
        "diagnostics_period": 0.1,
    }
    scene = str(two_points(tmp_path, SLOW))
    with Graph(scene, True, parameters=patient, environment=environment, hold=("a", "b")) as graph:
        names = {"mechanism_simulator", *(f"{point}/{node}" for point in "ab" for node in TRIO)}

        def engaged() -> bool:
            return all(
                f"{point}/teleoperation_controller" in statuses
                and statuses[f"{point}/teleoperation_controller"].message == "engaged"
                for point in "ab"
            )

        peer.until(engaged, "both controllers to engage", 40.0)
        peer.until(lambda: names <= set(statuses), f"diagnostics of {names}")
        assert set(statuses) == names
        peer.until(lambda: all(len(received) > 100 for received in commands.values()), "commands")
        for pusher, other in (("a", "b"), ("b", "a")):
            push = peer.publisher(f"{pusher}/device/hand_cf", WrenchStamped)
            forces = commands[other]

            def settled(forces=forces) -> bool:
                """Return whether no push is left, nor what one, or a pause, has set in motion."""
                devices = [figures(statuses[f"{point}/haptic_device"]) for point in "ab"]
                if any(device["pushed_by"] != "nobody" for device in devices):
                    return False
                last = np.array([six(message)[:3] for message in forces[-100:]])
                return np.ptp(last, axis=0).max() < 0.03

            peer.until(settled, f"{other} to come to rest", 60.0)
            # A push may as well make smaller what is felt at rest: the vectors are compared.
            before = np.mean([six(message)[:3] for message in forces[-50:]], axis=0)

            def felt(push=push, forces=forces, before=before) -> bool:
                push.publish(peer.wrench(0.6, 0.4, -0.3, 0.0, 0.0, 0.0))
                return np.linalg.norm(six(forces[-1])[:3] - before) > 0.1

            peer.until(felt, f"{other} to feel {pusher}")
            peer.until(engaged, "both to be engaged still")
        graph.check()
        codes = graph.stop()
    assert set(codes) == {"mechanism_simulator", *(f"{point}/{','.join(TRIO)}" for point in "ab")}
    assert set(codes.values()) == {0}
    assert not stray


def test_two_devices_in_lockstep_repeat_to_the_bit(tmp_path: Path) -> None:
    scene, found = str(two_points(tmp_path)), []
    for index, composed in enumerate((True, False)):
        bag = tmp_path / str(index)
        run = LockstepRun(scene, duration=0.05, hold=("a", "b"), composed=composed, out=bag)
        assert run_lockstep(run, private_environment(next_domain()), lambda: False) == 50
        with BagReader(bag) as reader:
            control = [name for name, topic in reader.topics.items() if topic.count == 50]
            found.append({name: [data for *_, data in reader.serialized(name)] for name in control})
    for point in "ab":
        assert {f"/{point}/device/servo_cf", f"/mechanism/{point}/servo_cf"} <= set(found[0])
    assert found[0] == found[1]


ARM = {"kind": "arm", "start_delay": 0.05, "impedance": "firm"}
WAY = [{"time": 0.0}, {"time": 0.2, "xyz": [0.01, 0.02, -0.01]}]


def two_hands(folder: Path, period: float = 0.001) -> Path:
    """Return a file with that arm, moved at its hand and held at its elbow, by two devices."""
    path = two_points(folder, period)
    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    lighter = {**document["device"], "mass": 0.2}
    document["hands"] = [
        {"point": "b", "hand": ARM | {"waypoints": [{"time": 0.0}]}},
        {"point": "a", "hand": ARM | {"waypoints": WAY}, "device": lighter},
    ]
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


def test_several_hands_in_lockstep_move_as_a_shared_session_does(tmp_path: Path) -> None:
    path, bag = two_hands(tmp_path), tmp_path / "bag"
    scene = load_scene(path)
    run = LockstepRun(str(path), duration=0.4, hold=scene.held_points, composed=True, out=bag)
    assert run_lockstep(run, private_environment(next_domain()), lambda: False) == 400
    session, late = SharedSession(scene), SharedSession(scene)
    rows, layout = session.run(400), StateLayout(session.simulator.mechanism)
    # What devices get of each other at once is part of it.
    late._direct = {point: {} for point in "ab"}
    other = late.run(400)
    assert np.abs(other["a"]["q"] - rows["a"]["q"]).max() > 1e-6
    with BagReader(bag) as reader:
        states = [layout.unpack(decode(data)) for *_, data in reader.serialized("/mechanism/state")]
        commands = {
            point: [
                np.frombuffer(data[-48:], dtype="<f8")
                for *_, data in reader.serialized(f"/{point}/device/servo_cf")
            ]
            for point in "ab"
        }
    assert len(states) == 400
    q = np.array([state.q for state in states])
    assert np.abs(q - rows["a"]["q"]).max() < 1e-10
    assert np.abs(q[-1] - q[0]).max() > 0.01
    for point, found in commands.items():
        # By rounding of poses that are sent as quaternions, as in test_lockstep.py.
        expected = rows[point]["device_command"]
        assert np.abs(np.array(found) - expected).max() < 1e-10 * np.abs(expected).max()
        assert np.abs(expected).max() > 0.1


def test_the_record_of_a_bag_is_that_of_the_session(tmp_path: Path) -> None:
    """In lockstep: poses are sent as quaternions, and all else as it is."""
    changes = ("hands[0].hand.release_at=[0.4]", "hands[1].hand.waypoints[0].time=0.0")
    copy_scene("two_users", tmp_path / "two_users.yaml", changes)
    path, bag = str(tmp_path / "two_users.yaml"), tmp_path / "bag"
    scene = load_scene(path)
    run = LockstepRun(path, duration=0.9, hold=scene.held_points, composed=True, out=bag)
    assert run_lockstep(run, private_environment(next_domain()), lambda: False) == 900
    graph = shared_record_from_bag(bag, scene, duration=0.6)
    session = run_shared_session(scene, 0.6)
    assert graph.source == "graph"
    for point, user in graph.users.items():
        found = compare(user, session.users[point])
        assert found["samples"] >= 599
        for body in ("device", "point"):
            assert found[f"{body}_deviation_max_mm"] < 1e-9
            assert found[f"{body}_deviation_max_deg"] < 1e-9
        assert found["same_sequence_of_counts"]
    # The bag's begins with the second tick of the session's, and the mechanism tells each tenth.
    rows = slice(1, 1 + graph.times.size)
    assert graph.times.size > 80
    assert graph.times == pytest.approx(session.times[rows], abs=1e-9)
    for name in ("wrenches", "felt", "coupling"):
        found, expected = getattr(graph, name), getattr(session, name)[rows]
        assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()
    assert np.abs(graph.felt).max() > 1.0
    again = LockstepRun("", feed_from=bag, feed=("hand",), out=tmp_path / "again")
    with pytest.raises(BagError, match="left, right, and a replay feeds one alone"):
        replay(again, private_environment(next_domain()), lambda: False)


@pytest.mark.alone
def test_hands_wait_for_the_recorder_and_start_together(tmp_path: Path) -> None:
    """A parameter of one kind of node reaches it in each user's namespace."""
    # Seven nodes at 1 kHz are more than two processors bear that have other work.
    changes = ("device.safety.command_timeout=0.5", f"simulation.period={SLOW}")
    copy_scene("two_users", tmp_path / "two_users.yaml", changes)
    bag = tmp_path / "bag"
    record_graph(str(tmp_path / "two_users.yaml"), bag, composed=True, seconds=1.0)
    pushes = {}
    for user, point in users_of(("left", "right")):
        stamps, rows = read_series(bag, point, "", user)[DEVICE_STATE]
        wrenches = rows[:, HAND]
        (pushing,) = np.nonzero(wrenches.any(axis=1))
        # Held by nobody from when the first sample was recorded.
        assert pushing[0] > 0
        pushes[point] = int(stamps[pushing[0]])
    # Left moves at once, and right is moved by it.
    assert abs(pushes["left"] - pushes["right"]) < 0.5 * NANOSECONDS


def test_a_device_that_dies_frees_nobody_else(domain: int, peer: Peer, tmp_path: Path) -> None:
    statuses = peer.statuses()
    told = {point: peer.listen(f"mechanism/{point}/servo_cf", WrenchStamped) for point in "ab"}
    gains = peer.listen("b/device/coupling_gain", Float64MultiArray)
    patient = {
        "teleoperation_controller.input_timeout": 0.1,
        "haptic_device.command_timeout": 0.1,
        "diagnostics_period": 0.1,
        "/b/haptic_device.force_limit": 9.0,
    }
    path = two_hands(tmp_path, SLOW)
    with Graph(
        str(path),
        parameters=patient,
        environment=private_environment(domain),
        nodes=NODES,
        hold=load_scene(path).held_points,
    ) as graph:

        def engaged(point: str) -> bool:
            name = f"{point}/teleoperation_controller"
            return name in statuses and statuses[name].message == "engaged"

        peer.until(lambda: engaged("a") and engaged("b"), "both controllers to engage", 40.0)
        # Settings of a node are those of it in every namespace, or in the one that they name.
        assert peer.parameters_of("a/teleoperation_controller", "input_timeout") == [0.1]
        limits = [peer.parameters_of(f"{point}/haptic_device", "force_limit") for point in "ab"]
        assert limits == [[0.0], [9.0]]
        peer.until(lambda: len(told["b"]) > 100, "commands of b")
        peer.until(lambda: gains and np.any(gains[-1].data[2:]), "b to be corrected for a's hand")
        graph.kill("a/haptic_device")
        peer.until(lambda: not engaged("a"), "a to be let go")
        peer.until(lambda: not np.any(gains[-1].data[2:]), "b to be corrected for nobody")
        received = len(told["b"])
        peer.until(lambda: len(told["b"]) > received + 300, "b to go on")
        assert engaged("b")
        assert not np.any(six(told["a"][-1]))
        graph.restart("a/haptic_device")
        peer.until(lambda: engaged("a"), "a to engage again", 40.0)
        assert engaged("b")
        peer.until(lambda: np.any(gains[-1].data[2:]), "b to be corrected for a's hand again")
        graph.check()


class Users:
    """Both users' nodes, and what their diagnostics say."""

    def __init__(self, graph: Graph, peer: Peer) -> None:
        self.graph, self.peer = graph, peer
        self.statuses = peer.statuses()

    def engaged(self, point: str) -> bool:
        """Return whether a user's controller renders."""
        status = self.statuses.get(f"{point}/teleoperation_controller")
        return status is not None and status.message == "engaged"

    def device(self, key: str) -> str:
        """Return a figure of b's device."""
        status = self.statuses.get("b/haptic_device")
        return "" if status is None else figures(status).get(key, "")

    def corrects(self) -> bool:
        """Return whether b's commands are corrected for a's hand: for a hundred more."""
        before = int(self.device("corrected_for_others") or 0)
        enough = before + 100
        self.peer.until(lambda: int(self.device("corrected_for_others") or 0) > enough, "more")
        return self.device("coupling_fault") == ""

    def intrude(self, topic: str, first: str, message: Callable[[], Float64MultiArray]) -> None:
        """Be a second publisher of a topic until b's device names both, and goes on without it."""
        second = self.peer.publisher(topic, Float64MultiArray)

        def told() -> bool:
            second.publish(message())
            fault = self.device("coupling_fault")
            named = "/peer" in fault and first in fault
            return named and f"more than one publisher of /{topic}: " in fault

        self.peer.until(told, f"b to name both publishers of {topic}")
        fault = self.device("coupling_fault")
        status = self.statuses["b/haptic_device"]
        assert status.level == DiagnosticStatus.WARN
        assert status.message == f"rendering, not corrected by what two say: {fault}"
        before = int(self.device("corrected_for_others"))
        answers = "b/teleoperation_controller"
        received = int(figures(self.statuses[answers])["answers"])

        def went_on() -> bool:
            second.publish(message())
            more = int(figures(self.statuses[answers])["answers"]) > received + 200
            return more and self.engaged("b")

        self.peer.until(went_on, "b to go on")
        assert self.device("fault") == ""
        assert int(self.device("corrected_for_others")) == before


@pytest.fixture
def users(domain: int, peer: Peer, tmp_path: Path) -> Iterator[Users]:
    patient = {
        "teleoperation_controller.input_timeout": 0.2,
        "haptic_device.command_timeout": 0.2,
        "diagnostics_period": 0.1,
    }
    path, environment = str(two_hands(tmp_path, SLOW)), private_environment(domain)
    with Graph(path, True, parameters=patient, environment=environment, hold=("a", "b")) as graph:
        found = Users(graph, peer)
        peer.until(lambda: found.engaged("a") and found.engaged("b"), "both to engage", 40.0)
        assert found.corrects()
        yield found
        graph.check()


def test_a_second_publisher_of_the_coupling_gain_ends_no_more_than_the_correction(
    users: Users, peer: Peer
) -> None:
    wire = CouplingWire(["a"], Limits())

    def message() -> Float64MultiArray:
        now = peer.node.get_clock().now().nanoseconds
        found = wire.pack(CouplingMatrices(now, {"a": 20.0 * np.eye(6)}))
        return Float64MultiArray(data=found.tolist())

    users.intrude("b/device/coupling_gain", "/b/teleoperation_controller", message)
    peer.until(lambda: users.engaged("a"), "a to be engaged still")
    peer.until(lambda: users.device("coupling_fault") == "", "the second one to be forgotten")
    assert users.corrects()


def test_a_second_device_of_another_user_stops_that_user_alone(users: Users, peer: Peer) -> None:
    sent = peer.listen("a/device/state", Float64MultiArray)
    peer.until(lambda: sent, "a sample of a")

    def message() -> Float64MultiArray:
        values = np.array(sent[0].data)
        values[:2] = divmod(peer.node.get_clock().now().nanoseconds, NANOSECONDS)
        values[DeviceStateMessage.layout.slice("hand_wrench")] = 3.0, -2.0, 1.0, 0.0, 0.0, 0.0
        return Float64MultiArray(data=values.tolist())

    users.intrude("a/device/state", "/a/haptic_device", message)
    stopped = "disengaged: more than one publisher of /a/device/state: "
    status = users.statuses["a/teleoperation_controller"]
    assert status.message.startswith(stopped)
    peer.until(lambda: users.device("coupling_fault") == "", "the second one to be forgotten")
    peer.until(lambda: users.engaged("a"), "a to engage again", 40.0)
    assert users.corrects()
