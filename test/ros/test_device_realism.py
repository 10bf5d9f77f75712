# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The device node with weight and without a force sensor: it fails closed all the same."""

from pathlib import Path

import pytest
from geometry_msgs.msg import WrenchStamped
from ruamel.yaml import YAML

from hapticmech_ros import load_scene
from hapticmech_ros.scene import document_of
from ros.harness import Peer, running, six

pytestmark = pytest.mark.ros
QUICK = {"view_rate": 1000.0, "wait_for_start": True}
# Less than the friction, so that it stays where it is when nothing carries it.
WEIGHT = {"gravity_load": [0.0, -0.4, 0.0], "coulomb_friction": 0.5}


def scene_with(folder: Path, **device: object) -> str:
    """Return the file of a scene with a device."""
    document = {**document_of(load_scene("five_bar")), "device": device}
    path = folder / "own.yaml"
    with path.open("w") as stream:
        YAML(typ="safe", pure=True).dump(document, stream)
    return str(path)


def test_compensation_begins_and_ends_with_the_commands(
    domain: int, peer: Peer, tmp_path: Path
) -> None:
    scene = scene_with(tmp_path, compensation={"gravity": True}, **WEIGHT)
    applied = peer.listen("device/setpoint_cf", WrenchStamped)
    with running("haptic_device", domain, scene=scene, **QUICK):
        command = peer.publisher("device/servo_cf", WrenchStamped)
        peer.until(lambda: len(applied) > 20, "samples")
        assert all(six(message) == [0.0] * 6 for message in applied)

        def carried() -> bool:
            command.publish(peer.wrench(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
            return six(applied[-1]) == [0.0, 0.4, 0.0, 0.0, 0.0, 0.0]

        peer.until(carried, "the weight to be carried")
        peer.until(lambda: six(applied[-1]) == [0.0] * 6, "the end of it")


def test_a_push_is_not_reported_without_a_sensor(domain: int, peer: Peer, tmp_path: Path) -> None:
    scene = scene_with(tmp_path, force_sensor="absent", coulomb_friction=0.5)
    forces = peer.listen("device/hand/measured_cf", WrenchStamped)
    with running("haptic_device", domain, scene=scene, **QUICK):
        push = peer.publisher("device/hand_cf", WrenchStamped)
        peer.until(lambda: forces, "forces")
        for _ in range(40):
            push.publish(peer.wrench(0.3, 0.0, 0.0, 0.0, 0.0, 0.0))
            peer.run(0.005)
    assert all(six(message) == [0.0] * 6 for message in forces)
