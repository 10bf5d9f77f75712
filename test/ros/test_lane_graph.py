# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The graph on the lane: who carries what, beside tools, strangers and the dead."""

from __future__ import annotations

import re
import signal
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import WrenchStamped
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.bag import BagReader
from hapticmech_ros.graph.processes import Graph, private_environment
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.nodes.lane import Lane, lane_folder
from ros.bag_processes import bag_command, ended
from ros.harness import RATE, Peer, Statuses, figures, six

# Each control topic's sender.
SENDERS = {
    "/device/state": "haptic_device",
    "/device/servo_cf": "teleoperation_controller",
    "/mechanism/state": "mechanism_simulator",
    "/mechanism/handle/servo_cf": "teleoperation_controller",
    "/analysis/handle/operational_model": "nullspace_analyser",
}
OFTEN = {"diagnostics_period": 0.1, "control_rate": RATE}


def ways(statuses: Statuses, topic: str) -> str:
    return statuses.figure(SENDERS[topic], f"transport of {topic}")


def all_go(statuses: Statuses, way: str) -> Callable[[], bool]:
    return lambda: all(ways(statuses, topic) == way for topic in SENDERS)


def renders(statuses: Statuses) -> Callable[[], bool]:
    return lambda: statuses.well("haptic_device", "teleoperation_controller")


def answers(peer: Peer, statuses: Statuses, number: int) -> None:
    """Wait until the controller has answered so many samples more, and nobody takes one for two."""
    node = "teleoperation_controller"
    enough = statuses.count(node, "answers") + number
    peer.until(lambda: statuses.count(node, "answers") > enough, "answers")
    assert not any(statuses.figure(name, "fault") for name in statuses)


@contextmanager
def rendering(peer: Peer, domain: int, **given: Any) -> Iterator[tuple[Graph, Statuses]]:
    """Run a graph that renders; yield it, and what its nodes say."""
    statuses = peer.statuses()
    parameters = {**OFTEN, **given.pop("parameters", {})}
    environment = private_environment(domain)
    with Graph("five_bar", parameters=parameters, environment=environment, **given) as graph:
        peer.until(renders(statuses), "rendering")
        yield graph, statuses


def is_heard(peer: Peer, topic: str, node: str) -> bool:
    """Return whether a node subscribes to a topic."""
    readers = peer.node.get_subscriptions_info_by_topic(topic)
    return any(reader.node_name == node for reader in readers)


def folder_of(domain: int) -> Path:
    return lane_folder(private_environment(domain))


def test_control_topics_take_the_lane_and_the_middleware_serves_whoever_listens(
    domain: int, peer: Peer
) -> None:
    with rendering(peer, domain) as (graph, statuses):
        peer.until(all_go(statuses, "lane"), "the lane to carry everything")
        assert {statuses.figure(n, "transport") for n in NODES} == {"lane and middleware"}
        received = peer.listen("device/state", Float64MultiArray)
        topic = "/device/state"
        peer.until(lambda: ways(statuses, topic) == "lane, middleware", "both to carry it")
        peer.until(lambda: len(received) > 200, "samples")
        stamps = [round(message.data[0] * 1e9 + message.data[1]) for message in received]
        assert stamps == sorted(set(stamps))
        # Nobody takes the copies that come to the nodes for another publisher's.
        assert renders(statuses)()
        assert statuses.count("teleoperation_controller", "engagements")
        assert not any(statuses.figure(name, "fault") for name in statuses)
        assert len(list(folder_of(domain).iterdir())) == len(NODES)
        graph.stop()
    assert not [path for path in folder_of(domain).iterdir() if not path.name.startswith(".")]


def test_without_it_everything_takes_the_middleware(domain: int, peer: Peer) -> None:
    # A test that killed nodes may have had this domain before.
    before = set(folder_of(domain).iterdir())
    with rendering(peer, domain, parameters={"transport": "middleware"}) as (_, statuses):
        assert {figures(statuses[node])["transport"] for node in NODES} == {"middleware"}
        assert not any("transport of" in key for s in statuses.values() for key in figures(s))
        assert set(folder_of(domain).iterdir()) <= before


@pytest.mark.parametrize("transitions", [["active_shutdown"], ["deactivate", "cleanup"]])
def test_a_node_that_is_shut_down_or_cleaned_up_stays_and_has_said_that_all_is_at_zero(
    domain: int, peer: Peer, transitions: list[str]
) -> None:
    with rendering(peer, domain) as (graph, _):
        setpoints = peer.listen("device/setpoint_cf", WrenchStamped)
        peer.until(lambda: setpoints and any(six(setpoints[-1])), "a force")
        assert peer.transition("haptic_device", *transitions)
        peer.until(lambda: not any(six(setpoints[-1])), "the last one to be zero")
        peer.run(0.5)
        assert graph.ended() == []
        wanted = "finalized" if "active_shutdown" in transitions else "unconfigured"
        assert peer.state_of("haptic_device") == wanted


# Who acts by a clock, and who answers.
@pytest.mark.parametrize("alone", ["mechanism_simulator", "nullspace_analyser"])
def test_a_node_that_keeps_off_the_lane_is_served_by_the_middleware(
    domain: int, peer: Peer, alone: str
) -> None:
    given = {f"{alone}.transport": "middleware"}
    with rendering(peer, domain, parameters=given) as (_, statuses):
        peer.until(
            lambda: {ways(statuses, topic) for topic in SENDERS} >= {"lane", "middleware"},
            "some to take the lane, and others the middleware",
        )
        answers(peer, statuses, 500)


def test_a_topic_that_is_remapped_takes_the_lane_by_its_new_name(domain: int, peer: Peer) -> None:
    remapped = ["-r", "device/servo_cf:=/omega/servo_cf"]
    with rendering(peer, domain, arguments=remapped) as (_, statuses):
        told = "teleoperation_controller", "transport of /omega/servo_cf"
        peer.until(lambda: statuses.figure(*told) == "lane", "the lane to carry the new topic")
        assert peer.node.count_publishers("/omega/servo_cf") == 1
        assert peer.node.count_publishers("/device/servo_cf") == 0


def test_a_topic_that_is_remapped_at_one_end_alone_reaches_nobody(
    environment: dict[str, str], peer: Peer, statuses: Statuses
) -> None:
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
        peer.until(lambda: statuses.count("haptic_device", "periods") > 1000, "samples")
        assert figures(statuses["haptic_device"])["times_held"] == "0"
        assert ways(statuses, "/device/servo_cf") == "nobody"


@pytest.mark.alone
def test_crtk_at_the_control_rate_takes_the_lane(
    environment: dict[str, str], peer: Peer, statuses: Statuses
) -> None:
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
        answers(peer, statuses, 1000)
        # Of samples with gaps the device was driven faster than any hand.
        assert statuses.figure("haptic_device", "failures") == "0"
        with closing(Lane.open(environment)) as lane:

            def received() -> bool:
                lane.look()
                lane.collect()
                return all(lane.readers(topic) for topic in samples)

            peer.until(received, "the controller to hear the device's samples on the lane")
            assert not lane.readers("/device/setpoint_cf WrenchStamped")


def test_graphs_of_two_namespaces_are_apart_on_the_lane(
    domain: int, environment: dict[str, str], peer: Peer
) -> None:
    forces = {
        name: peer.listen(f"/{name}/device/setpoint_cf", WrenchStamped)
        for name in ("left", "right")
    }
    outside = peer.listen("/device/setpoint_cf", WrenchStamped)
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
        peer.until_more(forces["right"], 200, "samples of the right one")
        assert not any(value for one in forces["right"] for value in six(one))
        assert not outside


def test_a_stranger_that_commands_is_noticed_on_the_lane_too(domain: int, peer: Peer) -> None:
    forces = peer.listen("device/setpoint_cf", WrenchStamped)
    with rendering(peer, domain) as (_, statuses):
        peer.until(all_go(statuses, "lane"), "the lane to carry everything")
        peer.until(lambda: forces and any(six(forces[-1])), "a force")
        stranger = peer.publisher("device/servo_cf", WrenchStamped)

        peer.until(
            lambda: "more than one publisher" in figures(statuses["haptic_device"])["fault"],
            "the device to tell of a second publisher",
            doing=lambda: stranger.publish(peer.wrench(4.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
        )
        peer.until(lambda: six(forces[-1]) == [0.0] * 6, "no force", 2.0)
        # The stranger's was never more than slew and ramp let through.
        assert max(abs(value) for message in forces for value in six(message)) < 1.0
        peer.until(renders(statuses), "rendering again")


@pytest.mark.alone
def test_a_bag_is_recorded_from_the_lane_without_the_middleware(
    domain: int, peer: Peer, tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    # Slow enough that nobody falls behind on two slow cores: then nothing may be lost.
    with rendering(peer, domain) as (_, statuses):
        peer.until(all_go(statuses, "lane"), "the lane to carry everything")
        with bag_command(domain, "record", "--all", "-o", bag) as recorder:
            peer.until(
                lambda: all(is_heard(peer, topic, "bag_recorder") for topic in SENDERS),
                "the recorder's subscriptions",
            )
            enough = statuses.count("haptic_device", "periods") + 1250
            peer.until(
                lambda: statuses.count("haptic_device", "periods") > enough,
                "samples on the lane alone",
            )
            # The middleware carries all for a second more: it may know of the recorder only then.
            peer.until(all_go(statuses, "lane"), "the lane to carry everything alone again")
            text = ended(recorder, signal.SIGINT)
            late = statuses.count("haptic_device", "missed_deadlines")
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


# Who acts by a clock, and who answers; the others: test_restarts.py, and test_reliability.py.
@pytest.mark.parametrize("victim", ["haptic_device", "teleoperation_controller"])
def test_a_killed_nodes_socket_is_removed_and_its_successor_is_on_the_lane(
    domain: int, peer: Peer, victim: str
) -> None:
    with rendering(peer, domain) as (graph, statuses):
        peer.until(all_go(statuses, "lane"), "the lane to carry everything")

        def sockets() -> set[str]:
            return {path.name for path in folder_of(domain).iterdir()}

        before = sockets()
        graph.kill(victim)
        graph.restart(victim)
        statuses.clear()
        peer.until(renders(statuses), "rendering again")
        peer.until(
            # The dead stand in the middleware's list for a while, as if they listened.
            lambda: all("lane" in ways(statuses, topic) for topic in SENDERS),
            "the lane to carry everything again",
        )
        peer.until(
            lambda: len(sockets() & before) == len(before) - 1, "its socket to be removed", 5.0
        )
        assert len(sockets() - before) == 1
