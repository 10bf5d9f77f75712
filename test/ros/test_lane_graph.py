# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The graph on the lane: who carries what, beside tools, strangers and the dead."""

from __future__ import annotations

import re
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from geometry_msgs.msg import WrenchStamped
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.bag import BagReader
from hapticmech_ros.graph import Graph, private_environment
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.nodes.lane import Lane, lane_folder
from ros.bag_processes import bag_command
from ros.harness import RATE, Peer, figures, six

pytestmark = pytest.mark.ros

# Each control topic's sender.
SENDERS = {
    "/device/state": "haptic_device",
    "/device/servo_cf": "teleoperation_controller",
    "/mechanism/state": "mechanism_simulator",
    "/mechanism/handle/servo_cf": "teleoperation_controller",
    "/analysis/handle/operational_model": "nullspace_analyser",
}
OFTEN = {"diagnostics_period": 0.1, "control_rate": RATE}


def ways(statuses: dict, topic: str) -> str:
    status = statuses.get(SENDERS[topic])
    return "" if status is None else figures(status).get(f"transport of {topic}", "")


def all_go(statuses: dict, way: str) -> Callable[[], bool]:
    return lambda: all(ways(statuses, topic) == way for topic in SENDERS)


def renders(statuses: dict) -> Callable[[], bool]:
    return lambda: all(
        node in statuses and ord(statuses[node].level) == 0
        for node in ("haptic_device", "teleoperation_controller")
    )


def is_heard(peer: Peer, topic: str, node: str) -> bool:
    """Return whether a node subscribes to a topic."""
    readers = peer.node.get_subscriptions_info_by_topic(topic)
    return any(reader.node_name == node for reader in readers)


def folder_of(domain: int) -> Path:
    return lane_folder(private_environment(domain))


def test_control_topics_take_the_lane_and_the_middleware_serves_whoever_listens(
    domain: int, peer: Peer
) -> None:
    statuses = peer.statuses()
    with Graph("five_bar", parameters=OFTEN, environment=private_environment(domain)) as graph:
        peer.until(renders(statuses), "rendering")
        peer.until(all_go(statuses, "lane"), "the lane to carry everything")
        assert all(figures(statuses[node])["transport"] == "lane and middleware" for node in NODES)
        received = peer.listen("device/state", Float64MultiArray)
        topic = "/device/state"
        peer.until(lambda: ways(statuses, topic) == "lane, middleware", "both to carry it")
        peer.until(lambda: len(received) > 200, "samples")
        stamps = [round(message.data[0] * 1e9 + message.data[1]) for message in received]
        assert stamps == sorted(set(stamps))
        # Nobody takes the copies that come to the nodes for another publisher's.
        assert renders(statuses)()
        assert figures(statuses["teleoperation_controller"])["engagements"] != "0"
        assert not any(figures(status).get("fault") for status in statuses.values())
        assert len(list(folder_of(domain).iterdir())) == len(NODES)
        graph.stop()
    assert not [path for path in folder_of(domain).iterdir() if not path.name.startswith(".")]


def test_without_it_everything_takes_the_middleware(domain: int, peer: Peer) -> None:
    statuses = peer.statuses()
    parameters = {**OFTEN, "transport": "middleware"}
    # A test that killed nodes may have had this domain before.
    before = set(folder_of(domain).iterdir())
    with Graph("five_bar", parameters=parameters, environment=private_environment(domain)):
        peer.until(renders(statuses), "rendering")
        assert {figures(statuses[node])["transport"] for node in NODES} == {"middleware"}
        assert not any("transport of" in key for s in statuses.values() for key in figures(s))
        assert set(folder_of(domain).iterdir()) <= before


@pytest.mark.parametrize("transitions", [["active_shutdown"], ["deactivate", "cleanup"]])
def test_a_node_that_is_shut_down_or_cleaned_up_stays_and_has_said_that_all_is_at_zero(
    domain: int, peer: Peer, transitions: list[str]
) -> None:
    statuses = peer.statuses()
    with Graph("five_bar", parameters=OFTEN, environment=private_environment(domain)) as graph:
        peer.until(renders(statuses), "rendering")
        setpoints = peer.listen("device/setpoint_cf", WrenchStamped)
        peer.until(lambda: setpoints and any(six(setpoints[-1])), "a force")
        assert peer.transition("haptic_device", *transitions)
        peer.until(lambda: not any(six(setpoints[-1])), "the last one to be zero")
        peer.run(0.5)
        assert graph.ended() == []
        wanted = "finalized" if "active_shutdown" in transitions else "unconfigured"
        assert peer.state_of("haptic_device") == wanted


@pytest.mark.parametrize("alone", list(NODES))
def test_a_node_that_keeps_off_the_lane_is_served_by_the_middleware(
    domain: int, peer: Peer, alone: str
) -> None:
    statuses = peer.statuses()
    parameters = {**OFTEN, f"{alone}.transport": "middleware"}
    with Graph("five_bar", parameters=parameters, environment=private_environment(domain)):
        peer.until(renders(statuses), "rendering")
        peer.until(
            lambda: {ways(statuses, topic) for topic in SENDERS} >= {"lane", "middleware"},
            "some to take the lane, and others the middleware",
        )
        before = int(figures(statuses["teleoperation_controller"])["answers"])
        peer.until(
            lambda: int(figures(statuses["teleoperation_controller"])["answers"]) > before + 500,
            "answers",
        )
        assert not any(figures(status).get("fault") for status in statuses.values())


def test_a_topic_that_is_remapped_takes_the_lane_by_its_new_name(domain: int, peer: Peer) -> None:
    statuses = peer.statuses()
    remapped = ["-r", "device/servo_cf:=/omega/servo_cf"]
    environment = private_environment(domain)
    with Graph("five_bar", parameters=OFTEN, environment=environment, arguments=remapped):
        peer.until(renders(statuses), "rendering")

        def way() -> str:
            status = figures(statuses["teleoperation_controller"])
            return status.get("transport of /omega/servo_cf", "")

        peer.until(lambda: way() == "lane", "the lane to carry the new topic")
        assert peer.node.count_publishers("/omega/servo_cf") == 1
        assert peer.node.count_publishers("/device/servo_cf") == 0


def test_a_topic_that_is_remapped_at_one_end_alone_reaches_nobody(domain: int, peer: Peer) -> None:
    statuses = peer.statuses()
    environment = private_environment(domain)
    elsewhere = ["-r", "device/servo_cf:=/omega/servo_cf"]
    others = [name for name in NODES if name != "haptic_device"]
    with (
        Graph("five_bar", parameters=OFTEN, environment=environment, nodes=others),
        Graph(
            "five_bar",
            parameters=OFTEN,
            environment=environment,
            nodes=["haptic_device"],
            arguments=elsewhere,
        ),
    ):
        topic = "/device/state"
        peer.until(lambda: ways(statuses, topic) == "lane", "the lane to carry samples")
        peer.until(
            lambda: int(figures(statuses["haptic_device"])["periods"]) > 1000, "a thousand samples"
        )
        assert figures(statuses["haptic_device"])["times_held"] == "0"
        assert ways(statuses, "/device/servo_cf") == "nobody"


@pytest.mark.alone
def test_crtk_at_the_control_rate_takes_the_lane(domain: int, peer: Peer) -> None:
    statuses = peer.statuses()
    environment = private_environment(domain)
    elsewhere = ["-r", "device/state:=/omega/state"]
    samples = [
        "/device/measured_cp PoseStamped",
        "/device/measured_cv TwistStamped",
        "/device/measured_cf WrenchStamped",
        "/device/hand/measured_cf WrenchStamped",
    ]
    with (
        Graph(
            "five_bar",
            parameters=OFTEN,
            environment=environment,
            nodes=[name for name in NODES if name != "haptic_device"],
        ),
        Graph(
            "five_bar",
            parameters={**OFTEN, "view_rate": 1000.0},
            environment=environment,
            nodes=["haptic_device"],
            arguments=elsewhere,
        ),
    ):
        peer.until(renders(statuses), "rendering by CRTK alone")
        before = int(figures(statuses["teleoperation_controller"])["answers"])
        peer.until(
            lambda: int(figures(statuses["teleoperation_controller"])["answers"]) > before + 1000,
            "answers",
        )
        assert not any(figures(status).get("fault") for status in statuses.values())
        lane = Lane.open(environment)
        try:

            def received() -> bool:
                lane.look()
                lane.collect()
                return all(lane.readers(topic) for topic in samples)

            peer.until(received, "the controller to hear the device's samples on the lane")
            assert not lane.readers("/device/setpoint_cf WrenchStamped")
        finally:
            lane.close()


def test_graphs_of_two_namespaces_are_apart_on_the_lane(domain: int, peer: Peer) -> None:
    environment = private_environment(domain)
    forces = {
        name: peer.listen(f"/{name}/device/setpoint_cf", WrenchStamped)
        for name in ("left", "right")
    }
    with (
        Graph("five_bar", parameters=OFTEN, environment=environment, namespace="left"),
        # Nobody commands it.
        Graph(
            "five_bar",
            parameters=OFTEN,
            environment=environment,
            namespace="right",
            nodes=["haptic_device"],
        ),
    ):
        peer.until(
            lambda: forces["left"] and abs(six(forces["left"][-1])[0]) > 0.3, "the left one's force"
        )
        # All of both are in one folder.
        peer.until(
            lambda: len(list(folder_of(domain).iterdir())) == len(NODES) + 1, "all nodes' sockets"
        )
        before = len(forces["right"])
        peer.until(lambda: len(forces["right"]) > before + 200, "samples of the right one")
        assert not any(value for one in forces["right"] for value in six(one))


def test_a_stranger_that_commands_is_noticed_on_the_lane_too(domain: int, peer: Peer) -> None:
    statuses = peer.statuses()
    forces = peer.listen("device/setpoint_cf", WrenchStamped)
    with Graph("five_bar", parameters=OFTEN, environment=private_environment(domain)):
        peer.until(renders(statuses), "rendering")
        peer.until(all_go(statuses, "lane"), "the lane to carry everything")
        peer.until(lambda: forces and any(six(forces[-1])), "a force")
        stranger = peer.publisher("device/servo_cf", WrenchStamped)

        def told() -> bool:
            stranger.publish(peer.wrench(4.0, 0.0, 0.0, 0.0, 0.0, 0.0))
            return "more than one publisher" in figures(statuses["haptic_device"])["fault"]

        peer.until(told, "the device to tell of a second publisher")
        peer.until(lambda: six(forces[-1]) == [0.0] * 6, "no force", 2.0)
        # The stranger's was never more than slew and ramp let through.
        assert max(abs(value) for message in forces for value in six(message)) < 1.0
        peer.until(renders(statuses), "rendering again")


@pytest.mark.alone
def test_a_bag_is_recorded_from_the_lane_without_the_middleware(
    domain: int, peer: Peer, tmp_path: Path
) -> None:
    statuses = peer.statuses()
    bag = tmp_path / "bag"
    # Slow enough that nobody falls behind on two slow cores: then nothing may be lost.
    with Graph("five_bar", parameters=OFTEN, environment=private_environment(domain)):
        peer.until(all_go(statuses, "lane"), "the lane to carry everything")
        with bag_command(domain, "record", "--all", "-o", bag) as recorder:
            peer.until(
                lambda: all(is_heard(peer, topic, "bag_recorder") for topic in SENDERS),
                "the recorder's subscriptions",
            )
            before = int(figures(statuses["haptic_device"])["periods"])
            peer.until(
                lambda: int(figures(statuses["haptic_device"])["periods"]) > before + 1250,
                "samples on the lane alone",
            )
            # The middleware carries all for a second more: it may know of the recorder only then.
            peer.until(all_go(statuses, "lane"), "the lane to carry everything alone again")
            recorder.send_signal(signal.SIGINT)
            assert recorder.wait(30.0) == 0
            assert recorder.stdout is not None
            text = recorder.stdout.read()
            late = int(figures(statuses["haptic_device"])["missed_deadlines"])
    for topic in SENDERS:
        assert re.search(rf"{topic}: \d+ messages, 0 lost", text), text
    with BagReader(bag) as reader:
        stamps = [
            round(item.message.data[0] * 1e9) + round(item.message.data[1])
            for item in reader.messages("/device/state")
        ]
    assert len(stamps) > 1000
    # A period begun too late has no message of its own; no message is missing or there twice.
    assert stamps == sorted(set(stamps))
    assert round((stamps[-1] - stamps[0]) / 4e6) + 1 - len(stamps) <= late


@pytest.mark.parametrize("victim", list(NODES))
def test_a_killed_nodes_socket_is_removed_and_its_successor_is_on_the_lane(
    domain: int, peer: Peer, victim: str
) -> None:
    statuses = peer.statuses()
    with Graph("five_bar", parameters=OFTEN, environment=private_environment(domain)) as graph:
        peer.until(all_go(statuses, "lane"), "the lane to carry everything")
        before = {path.name for path in folder_of(domain).iterdir()}
        graph.kill(victim)
        graph.restart(victim)
        statuses.clear()
        peer.until(renders(statuses), "rendering again")
        peer.until(
            # The dead stand in the middleware's list for a while, as if they listened.
            lambda: all("lane" in ways(statuses, topic) for topic in SENDERS),
            "the lane to carry everything again",
        )

        def sockets() -> set[str]:
            return {path.name for path in folder_of(domain).iterdir()}

        peer.until(lambda: len(sockets()) == len(NODES), "its socket to be removed", 5.0)
        assert len(sockets() & before) == len(NODES) - 1
