# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The simulated device alone: CRTK topics, obedience, and zero force when commands stop."""

import math
import time

import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped

from hapticmech_ros import Session, load_scene
from ros.harness import Peer, refuses, running, six

pytestmark = pytest.mark.ros
MASS = load_scene("five_bar").device.mass
QUICK = {"view_rate": 1000.0, "diagnostics_period": 0.02}
STILL = {"wait_for_start": True, **QUICK}


def test_measures_pose_twist_and_hand_wrench_in_world(domain: int, peer: Peer) -> None:
    poses = peer.listen("device/measured_cp", PoseStamped)
    twists = peer.listen("device/measured_cv", TwistStamped)
    forces = peer.listen("device/hand/measured_cf", WrenchStamped)
    with running("haptic_device", domain, **STILL):
        peer.until(lambda: min(len(poses), len(twists), len(forces)) > 50, "measurements")
    start = Session(load_scene("five_bar")).tick().point.pose.translation
    position = poses[-1].pose.position
    # The device starts at the operational point and nothing pushes it: equal to the last bit but
    # for the scene's own closing to 1e-12.
    assert math.dist((position.x, position.y, position.z), start) < 1e-11
    for message in (poses[-1], twists[-1], forces[-1]):
        assert message.header.frame_id == "world"
    # One sample has one stamp, whichever of its messages was heard first and last.
    assert len(set.intersection(*({_time(m) for m in s} for s in (poses, twists, forces)))) > 40
    assert six(twists[-1]) == [0.0] * 6
    assert six(forces[-1]) == [0.0] * 6


def test_accelerates_under_servo_cf_and_coasts_when_it_stops(domain: int, peer: Peer) -> None:
    twists = peer.listen("device/measured_cv", TwistStamped)
    with running("haptic_device", domain, **STILL):
        command = peer.publisher("device/servo_cf", WrenchStamped)
        peer.until(lambda: twists, "twists")

        def moves() -> bool:
            command.publish(peer.wrench(0.06, 0.0, 0.0, 0.0, 0.0, 0.0))
            return six(twists[-1])[0] > 0.03

        peer.until(moves, "the device to move")
        pushed_until = time.time()

        def coasting() -> list[TwistStamped]:
            return [m for m in twists if _time(m) > pushed_until + 0.1]

        peer.until(lambda: len(coasting()) > 50, "the device to coast")
        after = coasting()
    speeds = [six(m)[0] for m in after]
    # 0.06 N on 0.3 kg; then nothing pushes and nothing brakes.
    assert 0.01 < speeds[0] < 0.2
    assert max(speeds) == min(speeds)


def test_hand_lets_go_and_takes_hold_with_the_commands(domain: int, peer: Peer) -> None:
    forces = peer.listen("device/hand/measured_cf", WrenchStamped)
    with running("haptic_device", domain, **QUICK):
        command = peer.publisher("device/servo_cf", WrenchStamped)
        peer.until(lambda: forces, "forces")
        assert six(forces[-1]) == [0.0] * 6

        def pushing() -> bool:
            command.publish(peer.wrench(0.5, 0.0, 0.0, 0.0, 0.0, 0.0025))
            return six(forces[-1])[0] == -0.5

        for _ in range(2):
            peer.until(pushing, "the hand pushing")
            peer.until(lambda: six(forces[-1]) == [0.0] * 6, "the hand letting go")


def test_bad_commands_are_refused_and_counted(domain: int, peer: Peer) -> None:
    twists = peer.listen("device/measured_cv", TwistStamped)
    statuses = peer.statuses()
    with running("haptic_device", domain, **STILL) as process:
        command = peer.publisher("device/servo_cf", WrenchStamped)
        stale = peer.wrench(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        stale.header.stamp.sec -= 10
        for bad in (
            peer.wrench(math.nan, 0.0, 0.0, 0.0, 0.0, 0.0),
            peer.wrench(0.0, 0.0, 0.0, 0.0, 0.0, math.inf),
            peer.wrench(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, frame="base_link"),
            stale,
        ):
            refuses(peer, statuses, "haptic_device", command, bad)
        assert process.poll() is None
    assert all(six(m) == [0.0] * 6 for m in twists)


def test_hand_wrench_topic_pushes_and_expires(domain: int, peer: Peer) -> None:
    forces = peer.listen("device/hand/measured_cf", WrenchStamped)
    with running("haptic_device", domain, hand_timeout=0.1, **STILL):
        push = peer.publisher("device/hand_cf", WrenchStamped)
        unstamped = WrenchStamped()
        unstamped.header.frame_id = "world"
        unstamped.wrench.force.y = 0.25

        def pushed() -> bool:
            push.publish(unstamped)
            return bool(forces) and six(forces[-1])[1] == 0.25

        peer.until(pushed, "the push")
        peer.until(lambda: six(forces[-1]) == [0.0] * 6, "its end")


def _time(message: PoseStamped | TwistStamped | WrenchStamped) -> float:
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
