# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of device and controller: within what their scene allows, and kept as they are."""

import math

import pytest

from hapticmech_ros.device.safety import SafetyLimits
from hapticmech_ros.errors import SceneError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.nodes.device_driver import limits_of
from hapticmech_ros.nodes.parameters import (
    SAFETY,
    ControllerParameters,
    DeviceParameters,
    ParameterError,
    locked_by,
)
from hapticmech_ros.scene import document_of, scene_from_document
from hapticmech_ros.scene.device import Device, Safety

PERIOD = 1e-3
DEVICE = Device(
    force_limit=8.0,
    torque_limit=0.4,
    safety=Safety(
        force_slew=900.0,
        torque_slew=30.0,
        start_ramp=0.2,
        workspace_radius=0.3,
        command_timeout=0.05,
    ),
)
# Parameter, what the scene allows just so, what is less safe, the scene's key.
BOUNDS = [
    ("force_limit", 8.0, 8.001, "device.force_limit, 8"),
    ("torque_limit", 0.4, 0.5, "device.torque_limit, 0.4"),
    ("force_slew", 900.0, 1e6, "device.safety.force_slew, 900"),
    ("torque_slew", 30.0, 31.0, "device.safety.torque_slew, 30"),
    ("start_ramp", 0.2, 0.19, "device.safety.start_ramp, 0.2"),
    ("workspace_radius", 0.3, 0.4, "device.safety.workspace_radius, 0.3"),
    ("command_timeout", 0.05, 0.051, "device.safety.command_timeout, 0.05"),
]
# What of it a device has.
OF_DEVICE = [name for name, _, _, _ in BOUNDS] + ["message_age_limit"]


SAFER = DeviceParameters(
    force_limit=1.0,
    torque_limit=0.1,
    force_slew=10.0,
    torque_slew=1.0,
    start_ramp=2.0,
    workspace_radius=0.1,
    command_timeout=0.005,
)
# Of a scene that says nothing of them.
PLAIN = {"force_slew": 2000.0, "torque_slew": 100.0, "ramp": 0.1, "radius": math.inf}


@pytest.mark.parametrize(
    ("parameters", "device", "limits"),
    [
        (DeviceParameters(), DEVICE, SafetyLimits(8.0, 0.4, 900.0, 30.0, 0.2, 0.3)),
        (
            DeviceParameters(),
            Device(force_limit=5.0, torque_limit=0.2),
            SafetyLimits(5.0, 0.2, **PLAIN),
        ),
        (SAFER, DEVICE, SafetyLimits(1.0, 0.1, 10.0, 1.0, 2.0, 0.1)),
    ],
    ids=["the scene's", "every device's", "safer"],
)
def test_they_are_the_scenes_or_safer(parameters, device, limits):
    assert limits_of(parameters, device, PERIOD) == limits


@pytest.mark.parametrize(("name", "allowed", "beyond", "rule"), BOUNDS)
def test_none_can_be_less_safe_than_the_scene_allows(name, allowed, beyond, rule):
    limits_of(DeviceParameters(**{name: allowed}), DEVICE, PERIOD)
    with pytest.raises(ParameterError, match=rule) as refused:
        limits_of(DeviceParameters(**{name: beyond}), DEVICE, PERIOD)
    assert str(refused.value).startswith(f"{name}: must be")
    assert f"got {beyond:g}" in str(refused.value)


def test_all_that_is_wrong_is_named():
    beyond = DeviceParameters(**{name: value for name, _, value, _ in BOUNDS})
    with pytest.raises(ParameterError) as refused:
        limits_of(beyond, DEVICE, PERIOD)
    assert all(f"{name}: must be" in str(refused.value) for name, _, _, _ in BOUNDS)


def test_every_bounded_parameter_can_be_locked():
    assert {name for name, _, _, _ in BOUNDS} < set(SAFETY)
    assert set(OF_DEVICE) == set(SAFETY) & set(DeviceParameters.model_fields)
    assert set(SAFETY) - set(OF_DEVICE) <= set(ControllerParameters.model_fields)


LOCKED = {
    DeviceParameters: [*OF_DEVICE, "scene", "control_rate", "hand", "use_sim_time"],
    ControllerParameters: [
        *("input_timeout", "message_age_limit", "soften", "scene", "network_delay"),
        "use_sim_time",
    ],
}
# A controller is tuned while it renders.
FREE = {
    DeviceParameters: ["view_rate", "diagnostics_period", "hand_timeout"],
    ControllerParameters: ["view_rate", "c1", "constraint_stiffness"],
}


@pytest.mark.parametrize(
    ("kind", "name", "locked_by_it"),
    [
        (kind, name, by)
        for table, by in ((LOCKED, "lock_safety"), (FREE, ""))
        for kind, names in table.items()
        for name in names
    ],
)
def test_a_lock_keeps_what_safety_hangs_on_and_leaves_the_rest(kind, name, locked_by_it):
    assert locked_by(kind(lock_safety=True), name) == locked_by_it
    assert locked_by(kind(), name) == ""


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("force_slew", 0.0),
        ("start_ramp", -1.0),
        ("command_timeout", 2.0),
        ("command_timeout", 0.01),
    ],
)
def test_a_scene_cannot_say_nonsense(key, value):
    document = document_of(load_scene("five_bar"))
    document["device"]["safety"][key] = value
    with pytest.raises(SceneError, match=f"device.safety.{key}"):
        scene_from_document(document)
