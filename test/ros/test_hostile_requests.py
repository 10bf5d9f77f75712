# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Requests of services that every node has from rclpy: answered, whatever they hold."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from type_description_interfaces.srv import GetTypeDescription

from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.wire.topics import VIEWER
from ros.harness import Peer, Statuses, running

EVERY = (*NODES, VIEWER)
NO_TYPE = 77
# As parameters of ROS are numbered.
TYPES = range(10)
NAMES = ("", ".", "..", "a" * 100_000, "\0", "use_sim_time\n", "\u2028", "\U0001f527", "{0}", "%s")


def said(value: int | float | str, kind: int = NO_TYPE, name: str = "view_rate") -> Parameter:
    """Return a parameter that says to be of a type."""
    field = {int: "integer_value", float: "double_value", str: "string_value"}[type(value)]
    return Parameter(name=name, value=ParameterValue(type=kind, **{field: value}))


@pytest.fixture
def engaged(domain: int, peer: Peer, statuses: Statuses) -> Iterator[dict[str, Any]]:
    """Yield the last status of every node of a graph that renders, and does so afterwards."""
    renders = lambda: statuses.sentence("teleoperation_controller") == "engaged"  # noqa: E731

    with running(",".join(EVERY), domain, diagnostics_period=0.1) as process:
        peer.until(renders, "the engagement")
        yield statuses
        statuses.clear()
        peer.until(renders, "rendering after it")
        assert process.poll() is None


def test_a_parameter_of_no_type_is_refused_and_keeps_no_other_from_being_set(
    peer: Peer, engaged: dict[str, Any]
) -> None:
    good = said(123.0, kind=3)
    for node in EVERY:
        request = SetParameters.Request(parameters=[said(1), good, said(2, name="none")])
        results = peer.call(SetParameters, f"{node}/set_parameters", request).results
        assert [result.successful for result in results] == [False, True, False]
        assert all(str(NO_TYPE) in result.reason for result in (results[0], results[2]))
        assert peer.parameters_of(node, "view_rate") == [123.0]
        atomic = SetParametersAtomically.Request(parameters=[said(50.0, kind=3), said(1)])
        name = f"{node}/set_parameters_atomically"
        result = peer.call(SetParametersAtomically, name, atomic).result
        assert not result.successful
        assert str(NO_TYPE) in result.reason
        # All or none.
        assert peer.parameters_of(node, "view_rate") == [123.0]
    assert not peer.call(
        SetParameters, name[: -len("_atomically")], SetParameters.Request()
    ).results


def test_requests_of_all_kinds_are_answered(peer: Peer, engaged: dict[str, Any]) -> None:
    node = "haptic_device"
    own = list(
        peer.call(ListParameters, f"{node}/list_parameters", ListParameters.Request()).result.names
    )
    given = peer.parameters_of(node, *own)
    # What is empty of every type; and nothing, which would take a parameter away.
    for names, kinds in ((NAMES, (*TYPES, NO_TYPE)), (own, (0, NO_TYPE))):
        parameters = [
            Parameter(name=name, value=ParameterValue(type=kind))
            for name in names
            for kind in kinds
        ]
        request = SetParameters.Request(parameters=parameters)
        found = peer.call(SetParameters, f"{node}/set_parameters", request).results
        assert len(found) == len(parameters)
        assert not any(result.successful for result in found)
    for kind, service in (
        (GetParameters, "get_parameters"),
        (GetParameterTypes, "get_parameter_types"),
        (DescribeParameters, "describe_parameters"),
    ):
        for asked in (list(NAMES), ["view_rate"] * 10_000):
            assert peer.call(kind, f"{node}/{service}", kind.Request(names=asked)) is not None
    for depth in (0, 1, 2**64 - 1):
        request = ListParameters.Request(prefixes=list(NAMES), depth=depth)
        assert peer.call(ListParameters, f"{node}/list_parameters", request) is not None
    for type_hash in (*NAMES, "RIHS01_" + "0" * 64):
        described = GetTypeDescription.Request(type_name="a/b", type_hash=type_hash)
        assert not peer.call(
            GetTypeDescription, f"{node}/get_type_description", described
        ).successful
    steps = [(number, "") for number in (0, 2, NO_TYPE, 255)] + [(0, name) for name in NAMES]
    for number, label in steps:
        wanted = ChangeState.Request(transition=Transition(id=number, label=label))
        assert not peer.call(ChangeState, f"{node}/change_state", wanted).success
    transitions = GetAvailableTransitions.Request()
    name = f"{node}/get_available_transitions"
    assert peer.call(GetAvailableTransitions, name, transitions).available_transitions
    assert peer.state_of(node) == "active"
    assert peer.parameters_of(node, *own) == given
