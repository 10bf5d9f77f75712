# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Nobody finds a graph from the network, unless its user asked for that."""

import os
import socket
from pathlib import Path

import pytest

from hapticmech_ros.files import shared
from hapticmech_ros.graph.processes import private_environment
from hapticmech_ros.system import discovery
from hapticmech_ros.system.discovery import PEERS, PROFILES, RANGE, choose_discovery, exposure

LOOPBACK = str(shared("config/dds/loopback_udp.xml"))
NETWORK = str(shared("config/dds/discovery.xml"))


def chosen(asked=None, **given):
    environment = dict(given)
    choose_discovery(environment, asked)
    once = dict(environment)
    # A child of a child has the same.
    choose_discovery(environment)
    assert environment == once
    return environment


@pytest.mark.parametrize(
    "given", [{}, {RANGE: "LOCALHOST"}, {RANGE: "localhost"}, {"ROS_LOCALHOST_ONLY": "1"}]
)
def test_by_default_and_where_ros_says_localhost_only_loopback_is_used(given):
    found = chosen(**given)
    assert found[PROFILES] == LOOPBACK
    # ROS's own way would open sockets on all interfaces, and shared memory.
    assert RANGE not in found
    assert "ROS_LOCALHOST_ONLY" not in found


@pytest.mark.parametrize(
    "given", [{RANGE: "SUBNET"}, {RANGE: "SYSTEM_DEFAULT"}, {PEERS: "192.0.2.7"}]
)
def test_who_asks_for_the_network_gets_it(given):
    found = chosen(**given)
    assert found[PROFILES] == NETWORK
    assert {name: found[name] for name in given} == given


def test_what_is_asked_of_a_command_goes_first():
    assert chosen("subnet")[PROFILES] == NETWORK
    assert chosen("subnet", **{PROFILES: LOOPBACK, "ROS_LOCALHOST_ONLY": "1"})[RANGE] == "SUBNET"
    found = chosen("localhost", **{RANGE: "SUBNET", PEERS: "192.0.2.7"})
    assert found[PROFILES] == LOOPBACK
    assert RANGE not in found
    assert PEERS not in found


def test_the_profile_of_another_installation_is_no_profile_of_the_users_own(tmp_path):
    """A program from a clone starts commands that are installed elsewhere."""
    copy = tmp_path / "copy.xml"
    copy.write_bytes(Path(LOOPBACK).read_bytes())
    found = chosen("localhost", **{PROFILES: str(copy)})
    assert found[PROFILES] == str(copy)
    assert RANGE not in found
    assert chosen("subnet", **{PROFILES: str(copy)})[PROFILES] == NETWORK


def test_a_profile_of_the_users_own_is_left_alone():
    given = {PROFILES: "/home/me/mine.xml", RANGE: "LOCALHOST"}
    assert {**chosen(**given), "FASTDDS_BUILTIN_TRANSPORTS": ""} == {
        **given,
        "FASTDDS_BUILTIN_TRANSPORTS": "",
    }


@pytest.mark.parametrize(("given", "expected"), [({}, "LOCALHOST"), ({RANGE: "SUBNET"}, "SUBNET")])
def test_another_middleware_is_told_by_the_range(given, expected):
    found = chosen(RMW_IMPLEMENTATION="rmw_cyclonedds_cpp", **given)
    assert found[RANGE] == expected
    assert PROFILES not in found


def test_a_private_graph_is_closed_whatever_is_exported(monkeypatch):
    monkeypatch.setenv(RANGE, "SUBNET")
    monkeypatch.setenv(PEERS, "192.0.2.7")
    monkeypatch.delenv(PROFILES, raising=False)
    found = private_environment()
    assert found[PROFILES] == LOOPBACK
    assert not {RANGE, PEERS} & set(found)


@pytest.mark.parametrize(
    ("family", "kind", "address", "told"),
    [
        (socket.AF_INET, socket.SOCK_DGRAM, "127.0.0.1", ""),
        (socket.AF_INET, socket.SOCK_DGRAM, "239.255.0.1", ""),
        (socket.AF_INET, socket.SOCK_DGRAM, "0.0.0.0", "UDP 0.0.0.0"),
        (socket.AF_INET, socket.SOCK_STREAM, "0.0.0.0", "TCP 0.0.0.0"),
        (socket.AF_INET, socket.SOCK_STREAM, "127.0.0.1", ""),
        (socket.AF_INET6, socket.SOCK_DGRAM, "::1", ""),
        (socket.AF_INET6, socket.SOCK_DGRAM, "::", "UDP ::"),
    ],
)
def test_sockets_tell_who_can_reach_a_process(family, kind, address, told, monkeypatch):
    monkeypatch.setenv(RANGE, "SUBNET")
    monkeypatch.setenv(PROFILES, "/home/me/mine.xml")
    before = {address for _, address in discovery.listening(os.getpid())}
    try:
        opened = socket.socket(family, kind)
        opened.bind((address, 0))
    except OSError:
        pytest.skip(f"this machine has no address {address}")
    with opened:
        if kind == socket.SOCK_STREAM:
            opened.listen()
        found = [f"{k} {a}" for k, a in discovery.listening(os.getpid()) if a not in before]
        assert found == ([told] if told else [])
        if told:
            assert told in exposure()
            closing = f"unset {PROFILES}; export {RANGE}=LOCALHOST"
            assert closing in exposure()
