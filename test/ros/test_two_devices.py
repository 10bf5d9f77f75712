# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Two devices on one mechanism: each engages by itself, and each feels what the other does."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from std_msgs.msg import Float64MultiArray

from hapticmech_ros import load_scene
from hapticmech_ros.bag.reader import BagReader
from hapticmech_ros.errors import BagError
from hapticmech_ros.experiment import compare
from hapticmech_ros.experiment.from_bag import HAND, read_series, shared_record_from_bag
from hapticmech_ros.experiment.from_session import run_shared_session
from hapticmech_ros.graph.demo import record_graph
from hapticmech_ros.graph.lockstep import LockstepRun, replay, run_lockstep
from hapticmech_ros.graph.processes import Graph, private_environment
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.wire.messages import DeviceStateMessage
from hapticmech_ros.wire.topics import DEVICE_STATE, users_of
from ros.harness import Peer, next_domain, scene_like, six

TRIO = [name for name in NODES if name != "mechanism_simulator"]


# s: seven processes at 1 kHz are more than two cores bear, and starve who listens to them.
SLOW = 0.004
PATIENT = {"command_timeout": 0.2}


def two_points(folder: Path, period: float = 0.001, **parts: object) -> str:
    """Return a file with the spatial arm, whose hand (a) and elbow (b) two hands hold in place."""
    points = [
        {"name": "a", "link": "hand", "origin": {"xyz": [0, 0, 0.06]}},
        {"name": "b", "link": "upper_arm", "origin": {"xyz": [0, 0, 0.2]}},
    ]
    # Hands that let go would leave the devices to drift, in the end against their end stops.
    hand = {
        "kind": "spring_damper",
        "stiffness": 100.0,
        "damping": 5.0,
        "angular_stiffness": 1.0,
        "angular_damping": 0.01,
        "waypoints": [{"time": 0.0}],
    }
    own = {"simulation": {"period": period}, "device": {"safety": PATIENT}}
    return scene_like(folder, "spatial_arm", operational_points=points, hand=hand, **own, **parts)


def test_two_devices_in_lockstep_repeat_to_the_bit(tmp_path: Path) -> None:
    scene, found = two_points(tmp_path), []
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


def two_hands(folder: Path, period: float = 0.001) -> str:
    """Return a file with that arm, moved at its hand and held at its elbow, by two devices."""
    stays = {"point": "b", "hand": ARM | {"waypoints": WAY[:1]}}
    moves = {"point": "a", "hand": ARM | {"waypoints": WAY}}
    lighter = {"device": {"mass": 0.2, "safety": PATIENT}}
    return two_points(folder, period, hands=[stays, moves | lighter])


def test_the_record_of_a_bag_is_that_of_the_session(tmp_path: Path) -> None:
    """In lockstep: poses are sent as quaternions, and all else as it is."""
    changes = ("hands[0].hand.release_at=[0.4]", "hands[1].hand.waypoints[0].time=0.0")
    path, bag = scene_like(tmp_path, "two_users", *changes), tmp_path / "bag"
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
    bag = tmp_path / "bag"
    record_graph(scene_like(tmp_path, "two_users", *changes), bag, composed=True, seconds=1.0)
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


class Users:
    """Both users' nodes, and what their diagnostics say.

    Args:
        graph: two hands' one.
        peer: who watches.
    """

    def __init__(self, graph: Graph, peer: Peer) -> None:
        self.graph, self.peer = graph, peer
        self.statuses = peer.statuses()

    def engaged(self, *points: str) -> bool:
        """Return whether these users' controllers render."""
        names = [f"{point}/teleoperation_controller" for point in points]
        return all(self.statuses.sentence(name) == "engaged" for name in names)

    def corrected(self) -> int:
        """Return how many of b's commands were corrected for a's hand."""
        return self.statuses.count("b/haptic_device", "corrected_for_others")

    def fault(self) -> str:
        """Return whom b's device knows that nobody should listen to."""
        return self.statuses.figure("b/haptic_device", "coupling_fault")

    def render(self) -> None:
        """Wait until both do, and b's commands are corrected for a's hand."""
        self.peer.until(lambda: self.engaged("a", "b"), "both to engage", 40.0)
        self.peer.until(lambda: self.fault() == "", "no second publisher")
        enough = self.corrected() + 100
        self.peer.until(lambda: self.corrected() > enough, "corrected commands")


@pytest.fixture
def users(domain: int, peer: Peer, tmp_path: Path) -> Iterator[Users]:
    # A machine that is slower than its nodes starves each of them for tens of milliseconds.
    patient = {
        "teleoperation_controller.input_timeout": 0.2,
        "haptic_device.command_timeout": 0.2,
        "diagnostics_period": 0.1,
        "/b/haptic_device.force_limit": 9.0,
    }
    path, environment = two_hands(tmp_path, SLOW), private_environment(domain)
    stray = peer.listen("device/servo_cf", WrenchStamped)
    with Graph(path, parameters=patient, environment=environment, hold=("a", "b")) as graph:
        found = Users(graph, peer)
        found.render()
        each = [f"{point}/{node}" for point in "ab" for node in TRIO]
        peer.until(lambda: {"mechanism_simulator", *each} == set(found.statuses), "all nodes")
        yield found
        graph.check()
        assert set(graph.stop().values()) == {0}
    assert not stray


def test_a_device_that_dies_frees_nobody_else(users: Users, peer: Peer) -> None:
    told = {point: peer.listen(f"mechanism/{point}/servo_cf", WrenchStamped) for point in "ab"}
    gains = peer.listen("b/device/coupling_gain", Float64MultiArray)
    # Settings of a node are those of it in every namespace, or in the one that they name.
    assert peer.parameters_of("a/teleoperation_controller", "input_timeout") == [0.2]
    limits = [peer.parameters_of(f"{point}/haptic_device", "force_limit") for point in "ab"]
    assert limits == [[0.0], [9.0]]
    peer.until(lambda: gains and np.any(gains[-1].data[2:]), "b to be corrected for a's hand")
    users.graph.kill("a/haptic_device")
    peer.until(lambda: not users.engaged("a"), "a to be let go")
    peer.until(lambda: not np.any(gains[-1].data[2:]), "b to be corrected for nobody")
    peer.until_more(told["b"], 300, "b to go on")
    assert users.engaged("b")
    assert not np.any(six(told["a"][-1]))
    users.graph.restart("a/haptic_device")
    peer.until(lambda: users.engaged("a"), "a to engage again", 40.0)
    assert users.engaged("b")
    peer.until(lambda: np.any(gains[-1].data[2:]), "b to be corrected for a's hand again")


def test_a_second_device_of_another_user_stops_that_user_alone(users: Users, peer: Peer) -> None:
    """Its wrench corrects nobody else either; a second coupling gain: test_other_users.py."""
    topic, statuses = "a/device/state", users.statuses
    sent = peer.listen(topic, Float64MultiArray)
    peer.until(lambda: sent, "a sample of a")
    second = peer.publisher(topic, Float64MultiArray)
    values = np.array(sent[0].data)
    values[DeviceStateMessage.layout.slice("hand_wrench")] = 3.0, -2.0, 1.0, 0.0, 0.0, 0.0

    def tell() -> None:
        values[:2] = divmod(peer.node.get_clock().now().nanoseconds, NANOSECONDS)
        second.publish(Float64MultiArray(data=values.tolist()))

    named = f"more than one publisher of /{topic}: ", "/peer", "/a/haptic_device"
    peer.until(lambda: all(one in users.fault() for one in named), "both to be named", doing=tell)
    status = statuses["b/haptic_device"]
    assert status.level == DiagnosticStatus.WARN
    assert status.message == f"rendering, not corrected for other hands: {users.fault()}"
    before, answers = users.corrected(), ("b/teleoperation_controller", "answers")
    enough = statuses.count(*answers) + 200
    peer.until(
        lambda: statuses.count(*answers) > enough and users.engaged("b"), "b to go on", doing=tell
    )
    assert statuses.figure("b/haptic_device", "fault") == ""
    assert users.corrected() == before
    assert statuses.sentence("a/teleoperation_controller").startswith(
        f"disengaged: more than one publisher of /{topic}: "
    )
    users.render()
