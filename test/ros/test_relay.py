# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The relay's process, with a fake of forcedimension_ros2's topics.

How the mechanism is felt through it: test/nodes/test_relay_device.py.
"""

from __future__ import annotations

from pathlib import Path

from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.nodes.messages import LATCHED
from ros.harness import Peer, running, scene_like


def test_efforts_are_commands_buttons_are_passed_and_its_end_leaves_nobody_under_a_force(
    domain: int, peer: Peer, tmp_path: Path
) -> None:
    scene = scene_like(tmp_path, "five_bar", "device={preset: omega_3}")
    told = peer.listen("device/buttons", Joy, LATCHED)
    efforts = peer.listen("/fd/fd_controller/commands", Float64MultiArray)
    given = {"button_topic": "/fd/buttons", "command_timeout": 0.1}
    with running("relay_device", domain, scene, **given) as relay:
        states = peer.publisher("/fd/joint_states", JointState)
        buttons = peer.publisher("/fd/buttons", Joy)
        commands = peer.publisher("device/servo_cf", WrenchStamped)

        def go_on(*pressed: int) -> None:
            message = JointState(name=["fd_x", "fd_y", "fd_z"], position=[0.0] * 3)
            message.velocity, message.header.stamp = [0.0] * 3, peer.now()
            states.publish(message)
            buttons.publish(Joy(buttons=pressed))
            commands.publish(peer.wrench(-0.5, 0.0, 0.0, 0.0, 0.0, 0.0))

        for pressed in ([1, 0], [0, 1]):
            peer.until(
                lambda pressed=pressed: told and list(told[-1].buttons) == pressed,
                f"the buttons {pressed}",
                doing=lambda pressed=pressed: go_on(*pressed),
            )
        peer.until(
            lambda: efforts and list(efforts[-1].data) == [-0.5, 0.0, 0.0], "efforts", doing=go_on
        )
        relay.terminate()
        peer.until(lambda: relay.poll() is not None, "its end", doing=go_on)
        peer.until(lambda: not any(efforts[-1].data), "no efforts")
