# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The simulated device alone: what it carries."""

from pathlib import Path

import pytest
from geometry_msgs.msg import WrenchStamped

from ros.harness import Peer, running, scene_like, six

pytestmark = pytest.mark.ros
QUICK = {"wait_for_start": True, "view_rate": 1000.0}


WEIGHT = {
    "compensation": {"gravity": True},
    "gravity_load": [0.0, -0.4, 0.0],
    "coulomb_friction": 0.5,
}


def test_compensation_begins_and_ends_with_the_commands(
    domain: int, peer: Peer, tmp_path: Path
) -> None:
    scene = scene_like(tmp_path, "five_bar", device=WEIGHT)
    applied = peer.listen("device/setpoint_cf", WrenchStamped)
    with running("haptic_device", domain, scene=scene, **QUICK):
        command = peer.publisher("device/servo_cf", WrenchStamped)
        peer.until(lambda: len(applied) > 20, "samples")
        assert all(six(message) == [0.0] * 6 for message in applied)

        peer.until(
            lambda: six(applied[-1]) == [0.0, 0.4, 0.0, 0.0, 0.0, 0.0],
            "the weight to be carried",
            doing=lambda: command.publish(peer.wrench(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
        )
        peer.until(lambda: six(applied[-1]) == [0.0] * 6, "the end of it")
