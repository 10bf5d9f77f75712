# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The relay in a real graph, with a fake of forcedimension_ros2's topics."""

from __future__ import annotations

import math
import time
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.loading.loader import copy_scene
from ros.harness import OTHERS, WAIT_S, Peer, running

pytestmark = pytest.mark.ros
AXES = ["fd_x", "fd_y", "fd_z"]
MASS, PERIOD = 0.2, 0.002
# A hand that goes to and fro by 20 mm, 1 Hz, and holds by a spring and a
# damper: however late the other nodes start, the device stays in its range.
REACH, STIFFNESS, DAMPING = np.array([-0.02, 0.0, 0.0]), 50.0, 5.0


class Omega:
    """A body that a hand moves in a plane, behind joint states and efforts."""

    def __init__(self, peer: Peer) -> None:
        self._peer = peer
        self._states = peer.node.create_publisher(JointState, "/fd/joint_states", 10)
        self.efforts = np.zeros(3)
        self.place, self._velocity = np.zeros(3), np.zeros(3)
        self._start = self._next = time.monotonic()
        peer.node.create_subscription(
            Float64MultiArray, "/fd/fd_controller/commands", self._obey, 10
        )

    def _obey(self, message: Float64MultiArray) -> None:
        self.efforts = np.array(message.data)

    def go_on(self) -> None:
        """Tell a state, and move on to the next one."""
        self._peer.run(max(0.0, self._next - time.monotonic()))
        self._next = max(self._next + PERIOD, time.monotonic() - 0.02)
        hand = REACH * math.sin(2.0 * math.pi * (self._next - self._start))
        held = STIFFNESS * (hand - self.place) - DAMPING * self._velocity
        force = (self.efforts + held) * (1.0, 1.0, 0.0)
        self._velocity = self._velocity + PERIOD * force / MASS
        self.place = self.place + PERIOD * self._velocity
        stamp = self._peer.now()
        message = JointState(name=AXES)
        message.header.stamp = stamp
        message.position, message.velocity = self.place.tolist(), self._velocity.tolist()
        self._states.publish(message)


def way(points: list[PoseStamped]) -> float:
    """Return how far a point has come along x, m."""
    return float(np.ptp([point.pose.position.x for point in points])) if points else 0.0


def test_a_push_moves_the_mechanism_and_is_resisted(
    domain: int, peer: Peer, tmp_path: Path
) -> None:
    scene = tmp_path / "omega.yaml"
    copy_scene("five_bar", scene, ["device={preset: omega_3}"])
    device = Omega(peer)
    given = {"command_timeout": 0.1}
    with (
        running(OTHERS, domain, str(scene), input_timeout=0.1),
        running("relay_device", domain, str(scene), **given) as relay,
    ):
        points = peer.listen("/mechanism/handle/measured_cp", PoseStamped)
        end = time.monotonic() + WAIT_S
        while not device.efforts.any():
            device.go_on()
            assert time.monotonic() < end
        largest = 0.0
        while largest < 0.05 or way(points) < 0.25 * abs(REACH[0]):
            device.go_on()
            largest = max(largest, float(np.abs(device.efforts).max()))
            assert time.monotonic() < end
        assert largest <= 12.0
        # It ends, and leaves nobody under a force.
        relay.terminate()
        while relay.poll() is None:
            device.go_on()
            assert time.monotonic() < end + WAIT_S
        for _ in range(10):
            device.go_on()
        assert not device.efforts.any()
