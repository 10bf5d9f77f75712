# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The node drives a realistic device, held by an arm, as the session does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.bag.reader import BagReader
from hapticmech_ros.graph.lockstep import LockstepRun, run_lockstep
from hapticmech_ros.graph.processes import private_environment
from hapticmech_ros.wire.bounds import read
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.messages import DeviceStateMessage
from ros.harness import next_domain, scene_like

DEVICE = {
    "coulomb_friction": 0.05,
    "angular_coulomb_friction": 1e-4,
    "gravity_load": [0.1, -0.2, 0.0],
    "actuator_bandwidth": 150.0,
    "compensation": {"gravity": True, "friction": 0.5},
    "workspace": {"radius": 0.05},
    # The arm lets go within a period: a jump that the node's envelope, which sessions have not,
    # would spread over several.
    "safety": {"force_slew": 1e6, "torque_slew": 1e5},
}
HAND = {
    "kind": "arm",
    "start_delay": 0.05,
    "waypoints": [{"time": 0.3, "xyz": [-0.02, 0.01, 0.0]}],
    "release_at": [0.15],
    "grab_at": [0.2],
    "tremor": {"frequency": 9.0, "force": [0.0, 0.05, 0.0]},
}


@pytest.mark.parametrize("sensor", ["estimated", "absent"])
def test_a_run_in_lockstep_is_the_session(tmp_path: Path, sensor: str) -> None:
    device = {**DEVICE, "force_sensor": sensor}
    path = scene_like(tmp_path, "five_bar", device=device, hand=HAND)
    out = tmp_path / "bag"
    run = LockstepRun(path, duration=0.35, out=out, composed=True)
    run_lockstep(run, private_environment(next_domain()), lambda: False)
    with BagReader(out) as bag:
        received = [
            read(DeviceStateMessage, decode(data)) for _, _, data in bag.serialized("/device/state")
        ]
    session = Session(load_scene(path))
    samples = [session.tick() for _ in received]
    for found, expected in (
        (
            [d.sample.position for d in received],
            [s.device.pose.translation for s in samples],
        ),
        ([d.sample.twist for d in received], [s.device.twist for s in samples]),
        ([d.sample.hand_wrench for d in received], [s.hand_wrench for s in samples]),
        ([d.applied for d in received], [s.device.applied for s in samples]),
    ):
        one, two = np.array(found), np.array(expected)
        # Poses travel as quaternions, 1e-16 off; differences of speeds over a period, in the arm's
        # wrench and in the estimate, are a thousand times of that, and stiff controllers more.
        assert np.abs(one - two).max() <= 1e-9 * max(np.abs(two).max(), 1e-3)
    reported = np.array([d.sample.hand_wrench for d in received])
    assert reported.any() == (sensor != "absent")
    assert np.array([s.device.hand_wrench for s in samples]).any()
