# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The simulated device alone: what it measures, by CRTK's topics, and what it carries."""

import math
from pathlib import Path

from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped

from hapticmech_ros import Session, load_scene
from hapticmech_ros.nodes.messages import stamp_ns
from ros.harness import Peer, running, scene_like, six

QUICK = {"wait_for_start": True, "view_rate": 1000.0}


def test_measures_pose_twist_and_hand_wrench_in_world(domain: int, peer: Peer) -> None:
    poses = peer.listen("device/measured_cp", PoseStamped)
    twists = peer.listen("device/measured_cv", TwistStamped)
    forces = peer.listen("device/hand/measured_cf", WrenchStamped)
    with running("haptic_device", domain, **QUICK):
        peer.until(lambda: min(len(poses), len(twists), len(forces)) > 50, "measurements")
    start = Session(load_scene("five_bar")).tick().point.pose.translation
    position = poses[-1].pose.position
    # The device starts at the operational point and nothing pushes it: equal to the last bit but
    # for the scene's own closing to 1e-12.
    assert math.dist((position.x, position.y, position.z), start) < 1e-11
    for message in (poses[-1], twists[-1], forces[-1]):
        assert message.header.frame_id == "world"
    # One sample has one stamp, whichever of its messages was heard first and last.
    assert (
        len(set.intersection(*({stamp_ns(m.header) for m in s} for s in (poses, twists, forces))))
        > 40
    )
    assert six(twists[-1]) == [0.0] * 6
    assert six(forces[-1]) == [0.0] * 6


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
