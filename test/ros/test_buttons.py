# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Buttons of a handle: told as they change, and what they do where somebody wants it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.duration import Duration
from sensor_msgs.msg import Joy
from std_msgs.msg import UInt8MultiArray

from benchmarks.haply.emulated import emulated
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes.buttons import ButtonOutput, joy_buttons
from hapticmech_ros.nodes.mechanism_ports import closure_button
from hapticmech_ros.nodes.messages import LATCHED
from hapticmech_ros.numerics.times import NANOSECONDS
from nodes.stand_ins import Publisher
from ros.harness import OTHERS, WAIT_S, Peer, Statuses, refuses, running, scene_like, six

TOPIC = "device/buttons"
# A hand that holds still.
HAND = "hand={kind: arm, impedance: firm, start_delay: 0.0, waypoints: [{time: 0.0}]}"


@pytest.fixture
def scene(tmp_path: Path) -> str:
    return scene_like(tmp_path, "five_bar", "device={preset: inverse3}", HAND)


def told(messages: list[Joy]) -> list[list[int]]:
    return [list(message.buttons) for message in messages]


def test_a_handles_buttons_are_told_and_one_is_the_clutch(
    domain: int, peer: Peer, statuses: Statuses, scene: str
) -> None:
    received = peer.listen(TOPIC, Joy, LATCHED)
    commands = peer.listen("device/servo_cf", WrenchStamped)
    controller = "teleoperation_controller"

    presses = ("--press", "a 6s 9s", "--press", "c 12s 1000s")
    with (
        emulated("--scene", scene, *presses) as service,
        running(OTHERS, domain, scene, diagnostics_period=0.1, clutch_button=1),
        running("haply_device", domain, scene, uri=service.uri, diagnostics_period=0.1),
    ):
        peer.until(
            lambda: statuses.sentence(controller) == "engaged", "the controller to engage", 40.0
        )
        peer.until(lambda: told(received)[-1] == [1, 0, 0], "the button to be pressed", 40.0)
        peer.until(
            lambda: (
                statuses.sentence(controller) == "disengaged: the button of the clutch is pressed"
            ),
            "the open clutch",
        )
        # Zero at once, and then nothing more: the device is free, the mechanism is let go.
        assert not np.any(six(commands[-1]))
        said = len(commands)
        peer.until(lambda: told(received)[-1] == [0, 0, 0], "the button to be released", 40.0)
        peer.until(
            lambda: statuses.sentence(controller) == "engaged", "the controller to engage again"
        )
        peer.until(lambda: len(commands) > said + 50, "commands again")
        # Another button is not the clutch.
        peer.until(lambda: told(received)[-1] == [0, 0, 1], "the other button", 40.0)
        peer.until(
            lambda: statuses.sentence(controller) == "engaged", "the controller to be engaged"
        )
    changes = [
        one for i, one in enumerate(told(received)) if i == 0 or one != told(received)[i - 1]
    ]
    assert changes == [[0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 0, 1]]


def test_a_button_opens_and_closes_a_loop(domain: int, peer: Peer, statuses: Statuses) -> None:
    closures = peer.listen("mechanism/closures", UInt8MultiArray, LATCHED)
    node, given = "mechanism_simulator", "ground_pin 2"
    with running(node, domain, closure_button=given, diagnostics_period=0.02):
        # As drivers of other people do: nothing is latched.
        buttons = peer.publisher(TOPIC, Joy)
        peer.until(lambda: closures, "the loops")

        def press(*pressed: int) -> None:
            buttons.publish(Joy(buttons=pressed))

        # Pressed before it was heard of: nobody knows for how long. What comes after a message that
        # has been acknowledged, which takes seconds, arrives in its order.
        press(0, 1)
        assert buttons.wait_for_all_acked(Duration(seconds=WAIT_S))
        # Nor has the other one a loop.
        for pressed in ((1, 1), (0, 0), (1, 0), (0, 0), (0, 1)):
            press(*pressed)
        peer.until(lambda: list(closures[-1].data) == [0], "the open loop")
        for pressed in ((1, 1), (0, 1), (0, 0), (0, 1)):
            press(*pressed)
        peer.until(lambda: list(closures[-1].data) == [1], "the closed loop")
        # Each press has switched once, and the other button nothing.
        assert [list(one.data) for one in closures] == [[1], [0], [1]]
        for bad in ("nobody 1", "ground_pin", "ground_pin 0", "ground_pin x", "ground_pin 33"):
            assert not peer.set_parameters(node, closure_button=bad).successful, bad
        assert peer.set_parameters(node, closure_button="").successful
        refuses(peer, statuses, node, buttons, Joy(buttons=[0] * 33))


def test_changes_alone_are_told_and_a_handle_that_is_gone_is_released() -> None:
    told_to = Publisher()
    output = ButtonOutput(SimpleNamespace(output=lambda *_: told_to))  # type: ignore[arg-type]
    for time_ns, pressed in enumerate(((), (False, True), (False, True), (True, True), (), ())):
        output.publish(pressed, time_ns)
    assert told(told_to.sent) == [[0, 1], [1, 1], [0, 0]]
    assert [message.header.stamp.nanosec for message in told_to.sent] == [1, 3, 4]
    # Once a second for whoever comes late.
    for time_ns in (NANOSECONDS, NANOSECONDS + 4, NANOSECONDS + 5, 2 * NANOSECONDS + 4):
        output.publish((), time_ns)
    assert [message.header.stamp.sec for message in told_to.sent[3:]] == [1, 2]


def test_what_is_no_button_is_refused() -> None:
    assert joy_buttons(Joy(buttons=[0, 1, 7])) == (False, True, True)
    with pytest.raises(InvalidInputError, match="buttons: must be at most 32"):
        joy_buttons(Joy(buttons=[0] * 33))
    assert closure_button("", ["a"]) is None
    assert closure_button("left pin 3", ["left pin"]) == ("left pin", 3)
    with pytest.raises(InvalidInputError, match="must be one of a, and a number from 1 to"):
        closure_button("b 1", ["a"])
