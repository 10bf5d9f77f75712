# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of a graph's nodes from a bag."""

import pytest
from rosbags.typesys import Stores, get_typestore

from hapticmech_ros.errors import BagError
from hapticmech_ros.experiment import health_from_bag

KIND = "diagnostic_msgs/msg/DiagnosticArray"


def status(name, level=0, **values):
    types = get_typestore(Stores.ROS2_JAZZY).types
    pairs = [types["diagnostic_msgs/msg/KeyValue"](k, v) for k, v in values.items()]
    return types["diagnostic_msgs/msg/DiagnosticStatus"](level, name, "all well", "five_bar", pairs)


def diagnostics(time_ns, *statuses):
    types = get_typestore(Stores.ROS2_JAZZY).types
    header = types["std_msgs/msg/Header"](
        types["builtin_interfaces/msg/Time"](*divmod(time_ns, 10**9)), ""
    )
    return "/diagnostics", KIND, time_ns, types[KIND](header, list(statuses))


def test_last_status_of_each_node(make_bag):
    device = {"missed_deadlines": "7", "loop_latency_p99_us": "612.5", "state": "held"}
    bag = make_bag(
        extra=[
            diagnostics(10, status("haptic_device", missed_deadlines="1", old="1")),
            diagnostics(20, status("haptic_device", **device), status("controller", level=1)),
            diagnostics(30, status("mechanism_simulator", 2, missed_deadlines="2", worst="nan")),
        ]
    )
    health = health_from_bag(bag)
    assert list(health.nodes) == ["controller", "haptic_device", "mechanism_simulator"]
    assert health.nodes["haptic_device"].figures == {
        "missed_deadlines": 7,
        "loop_latency_p99_us": 612.5,
        "state": "held",
    }
    levels = {name: node.level for name, node in health.nodes.items()}
    assert levels == {
        "controller": "warning",
        "haptic_device": "ok",
        "mechanism_simulator": "error",
    }
    assert health.total("missed_deadlines") == 9
    assert health.total("nothing") is None
    assert health.total("state") is None
    assert health.one("loop_latency_p99_us") == 612.5
    assert health.one("nothing") is None
    # JSON has no NaN: it stays text.
    assert health.nodes["mechanism_simulator"].figures["worst"] == "nan"


def test_bag_without_diagnostics(make_bag):
    assert health_from_bag(make_bag()).nodes == {}


def test_refuses_other_diagnostics(make_bag, messages):
    _, kind, time_ns, message = messages[0]
    bag = make_bag(extra=[("/diagnostics", kind, time_ns, message)])
    with pytest.raises(BagError, match="/diagnostics is std_msgs"):
        health_from_bag(bag)
