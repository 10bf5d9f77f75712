# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `hapticmech run` shows of nodes, from what they tell."""

from __future__ import annotations

import os

import pytest

from hapticmech_ros.cli import graph
from hapticmech_ros.cli.graph import line_of, nothing_rendered, show_ends
from hapticmech_ros.system.readiness import ADDRESS, Readiness, Report, report_ready, send_report

DEVICE = Report(
    "/haptic_device",
    True,
    "rendering",
    {
        "periods": "4000",
        "missed_deadlines": "40",
        "achieved_rate_hz": "990.0",
        "times_held": "1",
        "message_age_p50_us": "170",
        "message_age_p99_us": "1190",
    },
)
MECHANISM = Report("/mechanism_simulator", True, "closed loops: pin", {"periods": "4000"})
ANALYSER = Report("/nullspace_analyser", True, "2 joint constraints", {})
CONTROLLER = Report("/teleoperation_controller", True, "engaged", {"engagements": "1"})
ALL = {one.node: one for one in (DEVICE, MECHANISM, ANALYSER, CONTROLLER)}


def changed(report: Report, **figures: str) -> Report:
    return Report(report.node, report.well, report.sentence, {**report.figures, **figures})


@pytest.fixture
def listener():
    readiness = Readiness()
    yield readiness
    if readiness.is_open:
        readiness.close()


def test_what_nodes_tell_is_heard_by_name_the_last_apart(listener: Readiness) -> None:
    environment = {ADDRESS: listener.address}
    send_report(DEVICE, environment)
    send_report(ANALYSER, environment)
    send_report(changed(ANALYSER, count="3"), environment)
    last = Report(DEVICE.node, False, "no commands: actuators at zero", {"periods": "5000"}, True)
    send_report(last, environment)
    report_ready(environment)
    assert listener.pids() == {os.getpid()}
    assert listener.reports == {
        DEVICE.node: DEVICE,
        ANALYSER.node: changed(ANALYSER, count="3"),
    }
    assert listener.endings == {DEVICE.node: last}


@pytest.mark.parametrize(
    "said", [b"X_HAPTICMECH_REPORT=", b"X_HAPTICMECH_REPORT={}", b'X_HAPTICMECH_REPORT=[1, "a"]']
)
def test_what_is_no_report_is_passed_over(listener: Readiness, said: bytes) -> None:
    import socket

    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.connect("\0" + listener.address[1:])
        sender.send(said)
    assert listener.pids() == frozenset()
    assert not listener.reports


def test_a_report_is_also_the_status_of_a_service(listener: Readiness) -> None:
    send_report(DEVICE, {ADDRESS: listener.address})
    text = listener._socket.recv(1 << 16)
    assert text.splitlines()[0] == b"STATUS=/haptic_device: rendering"


def test_telling_never_waits(listener: Readiness) -> None:
    """Also where the listener reads nothing: ten messages fill its queue."""
    for _ in range(2000):
        send_report(DEVICE, {ADDRESS: listener.address})
    listener.close()
    send_report(DEVICE, {ADDRESS: listener.address})
    send_report(DEVICE, {})


def test_the_line_says_what_is_rendered_and_felt() -> None:
    assert line_of(ALL) == "rendering, 990.0 Hz, missed 1.0%; 2 joint constraints"
    waiting = Report(CONTROLLER.node, False, "waiting for /device/state", {})
    assert line_of({**ALL, waiting.node: waiting}).endswith(
        "; teleoperation_controller: waiting for /device/state"
    )
    real = Report(
        "/haply_device", True, "rendering", {**DEVICE.figures, "periods_without_sample": "132"}
    )
    assert line_of({real.node: real}) == "rendering, 990.0 Hz, missed 1.0%, no sample in 3.3%"
    left = Report("/left/haptic_device", True, "rendering", {})
    assert line_of({left.node: left}) == "left: rendering, - Hz, missed -"


def test_nothing_rendered_is_said_with_the_reason() -> None:
    assert nothing_rendered(ALL, ALL) == ""
    waiting = Report(CONTROLLER.node, False, "waiting for /device/state", {"engagements": "0"})
    ends = {**ALL, waiting.node: waiting}
    said = nothing_rendered(ends, ends)
    assert said == "nothing was rendered: /teleoperation_controller: waiting for /device/state"
    # Nodes that run elsewhere may render all the same.
    assert nothing_rendered({}, {waiting.node: waiting}) == ""


@pytest.mark.parametrize("width", [80, 100])
def test_the_table_says_how_each_node_was(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], width: int
) -> None:
    monkeypatch.setattr(graph.console, "width", width)
    ending = Report(DEVICE.node, False, "no commands", changed(DEVICE, failures="2").figures)
    show_ends(ALL, {**ALL, ending.node: ending})
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= width
    for name in ALL:
        assert name in shown
    # What it did while the others were there.
    assert "rendering" in shown
    assert "990.0" in shown
    assert "0.17 / 1.19" in shown
    assert "/haptic_device: 2 failures" in shown
